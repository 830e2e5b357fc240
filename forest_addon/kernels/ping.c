/* Echoes of a ping: how loud each is at some frequencies, and their sum on an even grid of delays. */
#include <math.h>

#include "kernels.h"

#define TURN 6.283185307179586
#define TOGETHER 4 /* complex values of an echo that are laid down at once */
#define WIDEST 24   /* taps of a kernel, at most */

void lay_echoes(int64_t count, const double *place, const double *cycles, int64_t nodes, const double *heights,
                int64_t sums, const double *weights, int64_t width, int64_t powers, const double *taps_of,
                int64_t size, double *grid)
{
    int64_t columns = (nodes + TOGETHER - 1) / TOGETHER * TOGETHER;
    for (int64_t i = 0; i < count; i++) {
        double shifted = place[i] - 0.5 * (double)(width - 2);
        double whole = floor(shifted);
        double x = 2.0 * (shifted - whole) - 1.0;
        int64_t first = (int64_t)whole;
        double taps[WIDEST];
        for (int64_t t = 0; t < width; t++)
            taps[t] = taps_of[t];
        for (int64_t p = 1; p < powers; p++)
            for (int64_t t = 0; t < width; t++)
                taps[t] = taps[t] * x + taps_of[p * width + t];
        double angle = -TURN * (cycles[i] - rint(cycles[i]));
        double cosine = cos(angle);
        double sine = sin(angle);
        if (first < 0)
            first += size;
        for (int64_t begin = 0; begin < columns; begin += TOGETHER) {
            double turned[2 * TOGETHER] = {0.0};
            for (int64_t r = begin; r < nodes && r < begin + TOGETHER; r++) {
                const double *height = heights + 2 * (r * count + i);
                turned[2 * (r - begin)] = height[0] * cosine - height[1] * sine;
                turned[2 * (r - begin) + 1] = height[0] * sine + height[1] * cosine;
            }
            for (int64_t n = 0; n < sums; n++) {
                double weight = weights[i * sums + n];
                double *row = grid + 2 * ((n * (size + width) + first) * columns + begin);
                for (int64_t t = 0; t < width; t++) {
                    double tap = weight * taps[t];
                    for (int64_t c = 0; c < 2 * TOGETHER; c++)
                        row[c] += tap * turned[c];
                    row += 2 * columns;
                }
            }
        }
    }
}
