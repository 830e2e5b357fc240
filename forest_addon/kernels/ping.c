/* Echoes of a ping: how loud each is at some frequencies, and their sum on an even grid of delays. */
#include <math.h>

#include "kernels.h"

#define TURN 6.283185307179586
#define QUARTER 1.5707963267948966 /* of a turn */
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

/* Value at a place, in cells from the first on, of complex cubics: a table has 4 coefficients for each cell,
 * lowest power first. */
static inline void cubic(int64_t cells, const double *table, double place, double *real, double *imaginary)
{
    double within = place < (double)cells ? place : (double)cells; /* also of a place that is no number */
    within = within > 0.0 ? within : 0.0;
    int64_t cell = (int64_t)within < cells ? (int64_t)within : cells - 1;
    double x = within - (double)cell;
    const double *c = table + 8 * cell;
    *real = ((c[6] * x + c[4]) * x + c[2]) * x + c[0];
    *imaginary = ((c[7] * x + c[5]) * x + c[3]) * x + c[1];
}

void weigh_echoes(int64_t nodes, int64_t count, const double *level, int64_t terms, const double *basis,
                  const double *term, double *values)
{
    for (int64_t q = 0; q < nodes; q++) {
        for (int64_t i = 0; i < count; i++) {
            double exponent = 0.0;
            for (int64_t d = 0; d < terms; d++)
                exponent += basis[d * nodes + q] * term[d * count + i];
            double gain = level[i] * exp(exponent);
            double *value = values + 2 * (q * count + i);
            value[0] *= gain;
            value[1] *= gain;
        }
    }
}

void paper_discs(int64_t nodes, const double *wavenumber, int64_t count, const double *radius,
                 const double *incidence, const double *factor, double first, double step, int64_t cells,
                 const double *table, double *values)
{
    for (int64_t i = 0; i < count; i++) {
        double log_radius = log(radius[i]);
        for (int64_t q = 0; q < nodes; q++) {
            double size = wavenumber[q] * radius[i];
            double log_size = log(wavenumber[q]) + log_radius;
            double turn = 0.3999 * exp(-0.9065 * log_size) + 0.9979;
            double steepness = 0.9824 * exp(0.3523 * log_size) - 0.9459;
            double place = (steepness * (QUARTER - incidence[i]) - first) / step;
            double level = 0.5003 * size * size + 0.6867;
            double real, imaginary;
            cubic(cells, table, place, &real, &imaginary);
            level *= cos(turn * incidence[i]) * factor[i] / wavenumber[q];
            double *value = values + 2 * (q * count + i);
            value[0] = size == 0.0 ? 0.0 : level * real;
            value[1] = size == 0.0 ? 0.0 : level * imaginary;
        }
    }
}

/* The Hankel function of order 1 at x >= 6, without its phase e^{ix}; table: of its product with the root of x,
 * over 6/x from 0 to 1. */
static inline void hankel(int64_t cells, const double *table, double x, double *real, double *imaginary)
{
    cubic(cells, table, (double)cells * (6.0 / x), real, imaginary);
    double root = sqrt(x);
    *real /= root;
    *imaginary /= root;
}

/* 2 J1(x)/x: by its power series, or from the Hankel function. */
static inline double jinc(int64_t cells, const double *table, double x)
{
    if (x >= 6.0) {
        double real, imaginary;
        hankel(cells, table, x, &real, &imaginary);
        return 2.0 * (real * cos(x) - imaginary * sin(x)) / x;
    }
    double square = 0.25 * x * x;
    double sum = 1.0;
    for (int n = 20; n > 0; n--)
        sum = 1.0 - square * sum / (double)(n * (n + 1));
    return sum;
}

void piston_discs(int64_t nodes, const double *wavenumber, int64_t count, const double *radius,
                  const double *incidence, const double *factor, int64_t cells, const double *table,
                  double *values)
{
    for (int64_t i = 0; i < count; i++) {
        double across = 2.0 * radius[i] * sin(incidence[i]);
        double face = 0.5 * radius[i] * radius[i] * cos(incidence[i]) * factor[i];
        for (int64_t q = 0; q < nodes; q++) {
            double *value = values + 2 * (q * count + i);
            value[0] = 0.0;
            value[1] = face * wavenumber[q] * jinc(cells, table, wavenumber[q] * across);
        }
    }
}

void piston_rims(int64_t nodes, const double *wavenumber, int64_t count, const double *across,
                 const double *level, double side, int64_t cells, const double *table, double *values)
{
    for (int64_t q = 0; q < nodes; q++) {
        for (int64_t i = 0; i < count; i++) {
            double real, imaginary;
            hankel(cells, table, 2.0 * wavenumber[q] * across[i], &real, &imaginary);
            double *value = values + 2 * (q * count + i);
            value[0] = side * level[i] * imaginary;
            value[1] = level[i] * real;
        }
    }
}

/* The four cardinal cubic splines at t, from 0 to 1. */
static inline void splines(double t, double *weight)
{
    double s = 1.0 - t;
    weight[0] = s * s * s / 6.0;
    weight[1] = 2.0 / 3.0 - t * t * (1.0 - 0.5 * t);
    weight[2] = 2.0 / 3.0 - s * s * (1.0 - 0.5 * s);
    weight[3] = t * t * t / 6.0;
}

void exact_discs(int64_t nodes, const double *wavenumber, int64_t count, const double *radius,
                 const double *incidence, const double *factor, double later, const double *steps,
                 int64_t margin, int64_t columns, const float *table, double *values)
{
    for (int64_t i = 0; i < count; i++) {
        double along[4], over[4];
        double place = (sqrt(incidence[i] + steps[3]) - sqrt(steps[3])) / steps[2];
        int64_t cell = place < (double)columns ? (int64_t)place : 0;
        int64_t column = cell + margin - 1;
        splines(place - (double)cell, along);
        for (int64_t q = 0; q < nodes; q++) {
            double size = wavenumber[q] * radius[i];
            double most = size < steps[4] ? size : steps[4];
            place = (sqrt(most + steps[1]) - sqrt(steps[1])) / steps[0];
            int64_t row = (int64_t)place + margin - 1;
            splines(place - floor(place), over);
            double real = 0.0, imaginary = 0.0;
            for (int a = 0; a < 4; a++) {
                const float *four = table + 2 * ((row + a) * columns + column);
                double x = along[0] * four[0] + along[1] * four[2] + along[2] * four[4] + along[3] * four[6];
                double y = along[0] * four[1] + along[1] * four[3] + along[2] * four[5] + along[3] * four[7];
                real += over[a] * x;
                imaginary += over[a] * y;
            }
            double square = size * size;
            double level = square * size / sqrt(4.0 + square) * factor[i] / wavenumber[q];
            double cosine = cos(later * size) * level;
            double sine = sin(later * size) * level;
            double *value = values + 2 * (q * count + i);
            value[0] = real * cosine - imaginary * sine;
            value[1] = real * sine + imaginary * cosine;
        }
    }
}

void cylinders(int64_t nodes, const double *wavenumber, int64_t count, const double *radius,
               const double *phase, const double *level, double largest, const double *bend, double first,
               double step, int64_t cells, const double *table, double *values)
{
    for (int64_t i = 0; i < count; i++) {
        for (int64_t q = 0; q < nodes; q++) {
            double size = wavenumber[q] * radius[i];
            double inside = size < largest ? size : largest;
            double beyond = size > largest ? size / largest : 1.0;
            double real, imaginary;
            cubic(cells, table, (log1p(2.0 * inside) - first) / step, &real, &imaginary);
            double bent = 1.0 - 1.0 / beyond;
            double turn = wavenumber[q] * phase[i];
            double along = fabs(turn) < 1e-8 ? 1.0 : sin(turn) / turn;
            along *= level[i] * inside * inside / (1.0 + inside * sqrt(inside)) * sqrt(beyond);
            double *value = values + 2 * (q * count + i);
            value[0] = along * (real * (1.0 + bent * bend[0]) - imaginary * bent * bend[1]);
            value[1] = -along * (imaginary * (1.0 + bent * bend[0]) + real * bent * bend[1]);
        }
    }
}
