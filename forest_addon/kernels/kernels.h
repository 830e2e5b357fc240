/* Contracts of the functions that the library offers; forest_addon/kernels/__init__.py is their one caller.
 *
 * Arrays are the caller's: contiguous, in C order, of the length told at each, never kept after the return.
 * Nothing is allocated, nothing is global, nothing throws: a function may run in many threads at once, each on
 * its own slice of the results. Lengths in metres, times in seconds, angles in radians.
 */
#ifndef FOREST_SENSING_KERNELS_H
#define FOREST_SENSING_KERNELS_H

#include <stdint.h>

#ifdef _WIN32
#define KERNEL __declspec(dllexport)
#else
#define KERNEL __attribute__((visibility("default")))
#endif

/* Returns the hash of the sources that the library was built from, as packaging/build_kernels.py told it. */
KERNEL const char *kernels_sources(void);

/* The amplitudes of scatterers, into values (nodes, count) complex, at wavenumbers (nodes), 1/m.
 *
 * Cubics: a table (cells, 4) complex has in each cell, ``step`` wide from ``first`` on, the coefficients of a
 * cubic in parts of the cell, lowest power first. hankel: of the Hankel function of order 1 times the root of its
 * argument x and without its phase e^{ix}, over 6/x from 0 to 1.
 *
 * paper_discs, piston_discs, exact_discs: the models of acoustics/disc.py times a factor; radius, incidence from
 *     0 to a quarter of a turn, factor (count). The paper's phasor is looked up by the argument of its error
 *     function; exact discs in splines (_, rows) over incidence and size, whose steps (5) are those of
 *     acoustics/disc_table.py: of ka and its shift, of incidence and its shift, the last ka; the first ``margin``
 *     of either axis lie before 0. They are turned by ``later`` times ka.
 * piston_rims: i·level·H1(x)e^{-ix} at the near side (side -1) of a disc's rim, i times the conjugate at the far
 *     one (1); x = 2k·across is at least 6. across, level (count).
 * cylinders: the model of sensing/sonar/wood.py. radius as it is seen, phase of the sinc over k, level (count);
 *     S·e^{2ika}·(1 + ka^1.5)/ka^2 over log(1 + 2ka) up to the size ``largest``, beyond which it bends (1 complex).
 */
KERNEL void paper_discs(int64_t nodes, const double *wavenumber, int64_t count, const double *radius,
                        const double *incidence, const double *factor, double first, double step, int64_t cells,
                        const double *table, double *values);
KERNEL void piston_discs(int64_t nodes, const double *wavenumber, int64_t count, const double *radius,
                         const double *incidence, const double *factor, int64_t cells, const double *hankel,
                         double *values);
KERNEL void piston_rims(int64_t nodes, const double *wavenumber, int64_t count, const double *across,
                        const double *level, double side, int64_t cells, const double *hankel, double *values);
KERNEL void exact_discs(int64_t nodes, const double *wavenumber, int64_t count, const double *radius,
                        const double *incidence, const double *factor, double later, const double *steps,
                        int64_t margin, int64_t rows, const float *table, double *values);
KERNEL void cylinders(int64_t nodes, const double *wavenumber, int64_t count, const double *radius,
                      const double *phase, const double *level, double largest, const double *bend, double first,
                      double step, int64_t cells, const double *table, double *values);

/* Multiplies values (nodes, count) complex by level (count) times e^{sum over d of basis[d, q] term[d, i]};
 * basis (terms, nodes), term (terms, count).
 */
KERNEL void weigh_echoes(int64_t nodes, int64_t count, const double *level, int64_t terms, const double *basis,
                         const double *term, double *values);

/* Lays echoes down on even grids of delays: each is turned back by its cycles and goes, weighted, to the
 * ``width`` points about its place, times a kernel's taps there.
 *
 * count      echoes; nodes: complex values of each; sums: grids
 * place      (count) grid points, from 0 to ``size``; what lies before point 0 goes ``size`` points later
 * cycles     (count)
 * heights    (nodes, count) complex
 * weights    (count, sums) of the echoes in each grid
 * taps_of    (powers, width) polynomials of the taps in twice the offset from the middle between two points,
 *            highest power first; ``width`` is at most 24
 * grid       (sums, size + width, columns) complex, added to; ``columns`` is ``nodes`` up to a multiple of 4
 */
KERNEL void lay_echoes(int64_t count, const double *place, const double *cycles, int64_t nodes, const double *heights,
                       int64_t sums, const double *weights, int64_t width, int64_t powers, const double *taps_of,
                       int64_t size, double *grid);

#endif
