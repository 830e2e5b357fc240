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
