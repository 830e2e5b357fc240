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

#endif
