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

/* Twice in the library, and the loader takes what the CPU can run: the same operations in the same order, four at
 * once in place of two. By gcc alone, since of clang's no symbol has the function's own name. Not for functions that
 * call others of ours: gcc leaves the upper halves of registers in use there, and all that follows is six times slower.
 */
#if defined(__GLIBC__) && defined(__x86_64__) && defined(__GNUC__) && !defined(__clang__)
#define WIDE KERNEL __attribute__((target_clones("default", "avx2")))
#else
#define WIDE KERNEL
#endif

/* As fmin and fmax, which cost a call: b where one of them is no number. */
static inline double smaller(double a, double b)
{
    return a < b ? a : b;
}

static inline double larger(double a, double b)
{
    return a > b ? a : b;
}

static inline double dot(const double *a, const double *b)
{
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
}

/* Returns the hash of the sources that the library was built from, as packaging/build_kernels.py told it. */
KERNEL const char *kernels_sources(void);

/* Embree's rtcIntersect1. */
typedef void (*intersect1)(void *tree, void *ray, void *arguments);

/* Embree's rtcIntersect8. */
typedef void (*intersect8)(const int *valid, void *tree, void *rays, void *arguments);

/* A scene of I instances of meshes. */
struct cast_scene {
    void *tree;               /* Embree's scene of the instances, by number, about the centre */
    intersect1 intersect;     /* of the library that made it, */
    intersect8 intersect8;    /* and this; NULL where it has no packets */
    double low[3], high[3];   /* a box around all, larger by slack */
    double centre[3];
    double slack;             /* metres by which float32 may be wrong */
    int64_t steps;            /* 0 where instances stand; else they are an array of Embree's, whose places go */
    int64_t pieces;           /* straight between so many knots, and these are its size and */
    const int64_t *piece;     /* (pieces) the instances */
    const double *transform;  /* (I, 3, 4) local to world; of an array (steps, pieces, 3, 4) */
    const int32_t *const *triangle; /* (I) of each instance's mesh the triangles (T, 3), rows of */
    const void *const *vertex;      /* (I) its vertices (V, 3), */
    const uint8_t *single;          /* (I) which are float32 where this is 1, else double */
};

/* Finds the closest hit of each ray, as RayCaster in forest_addon/sensing/rays/caster.py promises it.
 *
 * origin, direction: (count, 3). near, far: (count) metres. knot: (count) a ray's time, from 0 to steps - 1.
 * left_instance, left_triangle: (count) what a ray leaves, -1 nothing; they may be instance and triangle, all -1.
 * Written are distance (count) metres, infinite for a miss; instance and triangle (count), -1 for a miss; normal
 * (count, 3), unit vectors in the world, NaN for a miss. A hit depends on its ray and its time alone, not on those
 * beside it.
 */
KERNEL void cast_rays(const struct cast_scene *scene, int64_t count, const double *origin,
                      const double *direction, const double *near, const double *far, const double *knot,
                      const int64_t *left_instance, const int64_t *left_triangle, double *distance,
                      int64_t *instance, int64_t *triangle, double *normal);

/* Sends the rays of a table, RTCRayHit of ``size`` float32 each, into an Embree scene. */
KERNEL void send_rays(intersect1 intersect, void *tree, int64_t count, float *rays, int64_t size);

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
 *     of either axis lie before 0. They are turned by ``later`` (count) times ka.
 *     Of pistons with a side (count) that is not 0 sounds one place of the rim alone, without its delay: i·c·H1(x)e^{-ix}
 *     at the near side (-1), i·c times its conjugate at the far one (1); c is f/i without 2J1(x), x is at least 6.
 * cylinders: the model of sensing/sonar/wood.py. radius as it is seen, phase of the sinc over k, level (count);
 *     S·e^{2ika}·(1 + ka^1.5)/ka^2 over log(1 + 2ka) up to the size ``largest``, beyond which it bends (1 complex),
 *     is in tables, one after the other; wave (count) says in which. Those with an end (count) are times i/k.
 */
WIDE void paper_discs(int64_t nodes, const double *wavenumber, int64_t count, const double *radius,
                        const double *incidence, const double *factor, double first, double step, int64_t cells,
                        const double *table, double *values);
WIDE void piston_discs(int64_t nodes, const double *wavenumber, int64_t count, const double *radius,
                         const double *incidence, const double *factor, const int8_t *side, int64_t cells,
                         const double *hankel, double *values);
WIDE void exact_discs(int64_t nodes, const double *wavenumber, int64_t count, const double *radius,
                        const double *incidence, const double *factor, const double *later, const double *steps,
                        int64_t margin, int64_t rows, const float *table, double *values);
WIDE void cylinders(int64_t nodes, const double *wavenumber, int64_t count, const double *radius,
                      const double *phase, const double *level, const int8_t *wave, const int8_t *end,
                      double largest, const double *bend, double first, double step, int64_t cells,
                      const double *tables, double *values);

/* Multiplies values (nodes, count) complex of rows (count) by their level (all) times e^{sum over d of
 * basis[d, q] term[d, row]}; basis (terms, nodes), term (terms, all).
 */
WIDE void weigh_echoes(int64_t nodes, int64_t count, const int64_t *rows, int64_t all, const double *level,
                         int64_t terms, const double *basis, const double *term, double *values);

/* The angles (count), from 0 to a quarter of a turn, between normals (count, 3) and the ways from a point (3) to
 * centres (count, 3).
 */
WIDE void incidences(int64_t count, const double *centre, const double *normal, const double *point, double *angle);

/* The ways to centres (count, 3) from places (ends, 3), the mouth of a sonar and its ears, with their frames
 * (ends, 3, 3): axis, left, up. distance (count, ends); offset (count, ends, 2) off the axes, as beam_offsets of
 * sensing/sonar/beam.py.
 */
WIDE void trace_paths(int64_t count, const double *centre, int64_t ends, const double *place, const double *frame,
                        double *distance, double *offset);

/* Opens blocks of leaves of one mesh: moves them into the world, bounds how loud each is, and keeps what may be heard.
 *
 * first, last, transform (3, 4), scale, instance (blocks): each block has the rows first to last of centre,
 *     normal, radius, leaf, which a transform moves that turns, mirrors and scales evenly.
 * ends, place, frame: as of trace_paths. steepness (ends, 2): of the logarithm of the loudest gain in the band over
 *     squared offsets; where one is no number, gains are left out of bounds.
 * told (16): nearest and farthest from the mouth; shortest way back to an ear, longest way in all; nepers a metre
 *     at least; FAR, ASIDE and CLOSEST of sensing/sonar/leaves.py, from where faces stand for discs, and the paper's
 *     are subdued; lowest and highest wavenumber; ka from where exact discs are told by their rims, too; steps as
 *     of exact_discs.
 * model: 0 paper, 1 piston, 2 exact. lobes (2, peaks): of |J1| where, and how high. cells, hankel: as of
 *     piston_discs. margin: as of exact_discs; maxima (_, rows, columns) of acoustics/disc_table.py.
 * kept (2): rows that are kept, and rows for which faces stand; tally (4): not finite, too near, too far, too late;
 *     added to.
 * moved (3), number, turned (3), size, nearness, owner, away (ends), offset (ends, 2), bound: columns of ``room``
 *     rows, for several calls: all that is opened fits in. Leaves that are kept are appended in order; leaves for
 *     which faces stand go, without away, offset and bound, to the end, each before the one before.
 */
WIDE void open_leaves(int64_t blocks, const int64_t *first, const int64_t *last, const double *transform,
                        const double *scale, const int64_t *instance, const double *centre,
                        const double *normal, const double *radius, const int64_t *leaf, int64_t ends,
                        const double *place, const double *frame, const double *steepness, const double *told,
                        int64_t model, int64_t peaks, const double *lobes, int64_t cells, const double *hankel,
                        int64_t margin, int64_t rows, int64_t columns, const float *maxima, int64_t room,
                        int64_t *kept, int64_t *tally, double *moved, int64_t *number, double *turned, double *size,
                        double *nearness, int64_t *owner, double *away, double *offset, double *bound);

/* Lays echoes down on even grids of delays: each is turned back by its cycles and goes, weighted, to the
 * ``width`` points about its place, times a kernel's taps there.
 *
 * count      echoes; nodes: complex values of each; sums: grids
 * place      (count) grid points, from 0 to ``size``; what lies before point 0 goes ``size`` points later
 * cycles     (count)
 * heights    complex: of node r of echo i at r * node_step + i * echo_step
 * weights    (count, sums) of the echoes in each grid
 * taps_of    (powers, width) polynomials of the taps in twice the offset from the middle between two points,
 *            highest power first; ``width`` is at most 24
 * grid       (sums, size + width, columns) complex, added to; ``columns`` is ``nodes`` up to a multiple of 4
 * largest    (count) size of the largest of the heights of each
 */
WIDE void lay_echoes(int64_t count, const double *place, const double *cycles, int64_t nodes, const double *heights,
                       int64_t node_step, int64_t echo_step, int64_t sums, const double *weights, int64_t width, int64_t powers, const double *taps_of,
                       int64_t size, double *grid, double *largest);

/* Rays of beams (B,), beam by beam, at places (S, 2) x, y across each: from start + x * exit_x + y * exit_y along
 * axis + x * turn_x + y * turn_y, all (B, 3). Writes origin and unit direction (B * S, 3). */
KERNEL void spread_rays(int64_t beams, const double *start, const double *axis, const double *exit_x,
                        const double *exit_y, const double *turn_x, const double *turn_y,
                        int64_t subrays, const double *place, double *origin, double *direction);

/* Light that contacts (C,) send back: energy (C,) = reflectance * light * share * |cos| / distance^2, in air of some
 * extinction; 0 where it is no number or the distance is below nearest.
 * ray (C,): number of the ray, pulse * subrays + sub-ray. share (subrays,): of a pulse's light, of each ray.
 * reflectance, light, distance (C,). normal, direction (C, 3): unit vectors. */
KERNEL void light_back(int64_t count, const int64_t *ray, int64_t subrays, const double *share,
                       const double *reflectance, const double *light, const double *distance,
                       const double *normal, const double *direction, double extinction,
                       double nearest, double *energy);

/* Moves and blurs contacts (C,) on surfaces that go on between the rays of a pulse.
 * order (C,): rows of the contacts, pulse by pulse. ray (C,): number of the ray, pulse * subrays + sub-ray.
 * surface (C,): contacts of one number may lie on one surface, -1 on none that goes on; of a ray the first contact
 * of each number that has energy counts.
 * distance, energy (C,): metres, and any unit. origin, direction (C, 3): of their rays, unit vectors.
 * normal (C, 3): unit vectors. sigma: m, of the pulse. seats (3 * subrays,), room (6 * subrays,): anything.
 * Writes moved (C,), the range of the light of each contact, and blur (C,), its standard deviation, metres. */
KERNEL void blur_patches(int64_t count, const int64_t *order, const int64_t *ray, int64_t subrays,
                         const int8_t *surface, const double *distance, const double *energy,
                         const double *origin, const double *direction, const double *normal,
                         double sigma, int64_t *seats, double *room, double *moved, double *blur);

/* Echoes of those of the contacts (C,) that have energy, by pulse and range; returns how many, at most C.
 * count to energy: as above. blur (C,): m, standard deviation in range of the light of each contact.
 * bins: 0, then echoes are crests of the waveform; else it is sampled, shape (bins,) is the light of a pulse in
 * bins of so many metres, and a bin is an echo that is larger than all within the window, in bins.
 * rows (4 * C + W,), room (6 * C + W,): anything, with W = C * (bins + window + 1) + bins, 0 without bins.
 * Writes of each echo its pulse, the distance of the crest, the total energy, the width, and the row of the
 * contact that stands for it: of those with half the energy of the strongest the one of the innermost sub-ray. */
KERNEL int64_t find_echoes(int64_t count, const int64_t *order, const int64_t *ray, int64_t subrays,
                           const double *distance, const double *energy, const double *blur,
                           double sigma, int64_t bins, int64_t window, const double *shape,
                           double bin, int64_t *rows, double *room, int64_t *pulse, double *crest,
                           double *total, double *width, int64_t *contact);

#endif
