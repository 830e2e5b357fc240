/* Echoes of a ping: how loud each is at some frequencies, and their sum on an even grid of delays. */
#include <math.h>
#include <string.h>

#include "kernels.h"

#define TURN 6.283185307179586
#define QUARTER 1.5707963267948966 /* of a turn */
#define ROUNDER 6755399441055744.0 /* 1.5 times 2^52: added and taken away, it rounds to whole numbers */
#define BLOCK 32                   /* echoes that are computed side by side */
#define TOGETHER 4 /* complex values of an echo that are laid down at once */
#define WIDEST 24   /* taps of a kernel, at most */

/* Cosine and sine of -TURN times some cycles, to rounding: their power series within a quarter of a turn. Unlike
 * the library's functions they are computed of several values at once, and are the same everywhere. */
static inline void turned_back(double cycles, double *cosine, double *sine)
{
    double halves = (2.0 * cycles + ROUNDER) - ROUNDER;
    double odd = halves - 2.0 * ((0.5 * halves + ROUNDER) - ROUNDER);
    double sign = 1.0 - 2.0 * odd * odd;
    double x = -TURN * (cycles - 0.5 * halves);
    double y = x * x;
    double s = -1.0 / 121645100408832000.0;
    s = s * y + 1.0 / 355687428096000.0;
    s = s * y - 1.0 / 1307674368000.0;
    s = s * y + 1.0 / 6227020800.0;
    s = s * y - 1.0 / 39916800.0;
    s = s * y + 1.0 / 362880.0;
    s = s * y - 1.0 / 5040.0;
    s = s * y + 1.0 / 120.0;
    s = s * y - 1.0 / 6.0;
    double c = 1.0 / 2432902008176640000.0;
    c = c * y - 1.0 / 6402373705728000.0;
    c = c * y + 1.0 / 20922789888000.0;
    c = c * y - 1.0 / 87178291200.0;
    c = c * y + 1.0 / 479001600.0;
    c = c * y - 1.0 / 3628800.0;
    c = c * y + 1.0 / 40320.0;
    c = c * y - 1.0 / 720.0;
    c = c * y + 1.0 / 24.0;
    c = c * y - 0.5;
    *sine = sign * (x + x * y * s);
    *cosine = sign * (1.0 + y * c);
}

/* e^x, to rounding, for x from -700 to 700: the power series within half a factor of two. */
static inline double exponential(double x)
{
    double shifted = x * 1.4426950408889634 + ROUNDER;
    double doublings = shifted - ROUNDER;
    double rest = (x - doublings * 0.6931471803691238) - doublings * 1.9082149292705877e-10;
    double sum = 1.0 / 6227020800.0;
    sum = sum * rest + 1.0 / 479001600.0;
    sum = sum * rest + 1.0 / 39916800.0;
    sum = sum * rest + 1.0 / 3628800.0;
    sum = sum * rest + 1.0 / 362880.0;
    sum = sum * rest + 1.0 / 40320.0;
    sum = sum * rest + 1.0 / 5040.0;
    sum = sum * rest + 1.0 / 720.0;
    sum = sum * rest + 1.0 / 120.0;
    sum = sum * rest + 1.0 / 24.0;
    sum = sum * rest + 1.0 / 6.0;
    sum = sum * rest + 0.5;
    sum = sum * rest * rest + rest + 1.0;
    uint64_t exponent, bits;
    memcpy(&exponent, &shifted, sizeof exponent);
    memcpy(&bits, &sum, sizeof bits);
    bits += exponent << 52;
    memcpy(&sum, &bits, sizeof sum);
    return sum;
}

/* The natural logarithm of x, 1e-300 to 1e300, to rounding: the series of artanh within half a factor of two. */
static inline double logarithm(double x)
{
    uint64_t bits, whole;
    memcpy(&bits, &x, sizeof bits);
    bits += 0x3ff0000000000000 - 0x3fe6a09e667f3bcd; /* less the root of a half: rounds to powers of two */
    whole = (bits >> 52) | 0x4330000000000000;
    bits = (bits & 0x000fffffffffffff) + 0x3fe6a09e667f3bcd;
    double power, rest;
    memcpy(&power, &whole, sizeof power);
    memcpy(&rest, &bits, sizeof rest);
    power -= 4503599627370496.0 + 1023.0;
    double s = (rest - 1.0) / (rest + 1.0);
    double y = s * s;
    double sum = 1.0 / 21.0;
    sum = sum * y + 1.0 / 19.0;
    sum = sum * y + 1.0 / 17.0;
    sum = sum * y + 1.0 / 15.0;
    sum = sum * y + 1.0 / 13.0;
    sum = sum * y + 1.0 / 11.0;
    sum = sum * y + 1.0 / 9.0;
    sum = sum * y + 1.0 / 7.0;
    sum = sum * y + 1.0 / 5.0;
    sum = sum * y + 1.0 / 3.0;
    return power * 0.6931471805599453 + (2.0 * s + 2.0 * s * y * sum);
}

void lay_echoes(int64_t count, const double *place, const double *cycles, int64_t nodes, const double *heights,
                int64_t node_step, int64_t echo_step, int64_t sums, const double *weights, int64_t width, int64_t powers, const double *taps_of,
                int64_t size, double *grid, double *largest)
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
        double cosine, sine;
        turned_back(cycles[i], &cosine, &sine);
        if (first < 0)
            first += size;
        double most = 0.0;
        for (int64_t begin = 0; begin < columns; begin += TOGETHER) {
            double turned[2 * TOGETHER] = {0.0};
            for (int64_t r = begin; r < nodes && r < begin + TOGETHER; r++) {
                const double *height = heights + 2 * (r * node_step + i * echo_step);
                most = larger(most, height[0] * height[0] + height[1] * height[1]);
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
        largest[i] = sqrt(most);
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

void weigh_echoes(int64_t nodes, int64_t count, const int64_t *rows, int64_t all, const double *level, int64_t terms,
                  const double *basis, const double *term, double *values)
{
    for (int64_t begin = 0; begin < count; begin += BLOCK) {
        int64_t some = count - begin < BLOCK ? count - begin : BLOCK;
        for (int64_t q = 0; q < nodes; q++) {
            double *value = values + 2 * (q * count + begin);
            double exponent[BLOCK] = {0.0};
            for (int64_t d = 0; d < terms; d++)
                for (int64_t i = 0; i < some; i++)
                    exponent[i] += basis[d * nodes + q] * term[d * all + rows[begin + i]];
            for (int64_t i = 0; i < some; i++)
                exponent[i] = exponent[i] > -700.0 ? exponent[i] : -700.0;
            for (int64_t i = 0; i < some; i++)
                exponent[i] = level[rows[begin + i]] * exponential(exponent[i]);
            for (int64_t i = 0; i < some; i++) {
                value[2 * i] *= exponent[i];
                value[2 * i + 1] *= exponent[i];
            }
        }
    }
}

void paper_discs(int64_t nodes, const double *wavenumber, int64_t count, const double *radius,
                 const double *incidence, const double *factor, double first, double step, int64_t cells,
                 const double *table, double *values)
{
    for (int64_t begin = 0; begin < count; begin += BLOCK) {
        int64_t some = count - begin < BLOCK ? count - begin : BLOCK;
        double turn_of[BLOCK], steep_of[BLOCK], place[BLOCK], level[BLOCK]; /* the first two at 1/m */
        for (int64_t i = 0; i < some; i++) {
            double log_radius = logarithm(radius[begin + i] > 1e-30 ? radius[begin + i] : 1e-30);
            turn_of[i] = 0.3999 * exponential(-0.9065 * log_radius);
            steep_of[i] = 0.9824 * exponential(0.3523 * log_radius);
        }
        for (int64_t q = 0; q < nodes; q++) {
            double k = wavenumber[q];
            double turn_at = pow(k, -0.9065);
            double steep_at = pow(k, 0.3523);
            double *value = values + 2 * (q * count + begin);
            for (int64_t i = 0; i < some; i++) {
                double size = k * radius[begin + i];
                double turn = turn_of[i] * turn_at + 0.9979;
                double steepness = steep_of[i] * steep_at - 0.9459;
                double angle = incidence[begin + i];
                double cosine, sine;
                place[i] = (steepness * (QUARTER - angle) - first) / step;
                turned_back(turn * angle / TURN, &cosine, &sine);
                level[i] = (0.5003 * size * size + 0.6867) * cosine * factor[begin + i] / k;
                level[i] = size == 0.0 ? 0.0 : level[i];
            }
            for (int64_t i = 0; i < some; i++) {
                cubic(cells, table, place[i], value + 2 * i, value + 2 * i + 1);
                value[2 * i] *= level[i];
                value[2 * i + 1] *= level[i];
            }
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
        double real, imaginary, cosine, sine;
        hankel(cells, table, x, &real, &imaginary);
        turned_back(-x / TURN, &cosine, &sine);
        return 2.0 * (real * cosine - imaginary * sine) / x;
    }
    double square = 0.25 * x * x;
    double sum = 1.0;
    for (int n = 20; n > 0; n--)
        sum = 1.0 - square * (1.0 / (double)(n * (n + 1))) * sum;
    return sum;
}

void piston_discs(int64_t nodes, const double *wavenumber, int64_t count, const double *radius,
                  const double *incidence, const double *factor, const int8_t *side, int64_t cells,
                  const double *table, double *values)
{
    for (int64_t begin = 0; begin < count; begin += BLOCK) {
        int64_t some = count - begin < BLOCK ? count - begin : BLOCK;
        double across[BLOCK], face[BLOCK];
        for (int64_t i = 0; i < some; i++) {
            double sine, cosine;
            turned_back(-incidence[begin + i] / TURN, &cosine, &sine);
            across[i] = 2.0 * radius[begin + i] * sine;
            face[i] = 0.5 * radius[begin + i] * radius[begin + i] * cosine * factor[begin + i];
        }
        for (int64_t q = 0; q < nodes; q++) {
            double *value = values + 2 * (q * count + begin);
            for (int64_t i = 0; i < some; i++) {
                double x = wavenumber[q] * across[i];
                double level = face[i] * wavenumber[q];
                double real = 0.0, imaginary = 0.0;
                if (side[begin + i] == 0) {
                    value[2 * i] = 0.0;
                    value[2 * i + 1] = level * jinc(cells, table, x);
                    continue;
                }
                hankel(cells, table, x, &real, &imaginary);
                value[2 * i] = side[begin + i] * (level / x) * imaginary;
                value[2 * i + 1] = level / x * real;
            }
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

/* Four complex values in line: of as many columns of a table, each 2 * rows after the one before, weighted. */
static inline void mixed(const float *column, int64_t rows, const float *weight, float *line)
{
    for (int a = 0; a < 8; a++)
        line[a] = weight[0] * column[a] + weight[1] * column[2 * rows + a] + weight[2] * column[4 * rows + a]
                  + weight[3] * column[6 * rows + a];
}

void exact_discs(int64_t nodes, const double *wavenumber, int64_t count, const double *radius,
                 const double *incidence, const double *factor, const double *later, const double *steps,
                 int64_t margin, int64_t rows, const float *table, double *values)
{
    for (int64_t i = 0; i < count; i++) {
        double at = (sqrt(incidence[i] + steps[3]) - sqrt(steps[3])) / steps[2];
        int64_t cell = at < 1e6 ? (int64_t)at : 0; /* 0 of what is no number, which stays in the weights */
        const float *column = table + 2 * ((cell + margin - 1) * rows + margin - 1);
        double over[4];
        float along[4], line[16]; /* of eight sizes, from four times ``known`` on: nodes go on from there */
        int64_t known = -2;
        splines(at - (double)cell, over);
        for (int b = 0; b < 4; b++)
            along[b] = (float)over[b];
        for (int64_t begin = 0; begin < nodes; begin += BLOCK) {
            int64_t some = nodes - begin < BLOCK ? nodes - begin : BLOCK;
            double size[BLOCK], place[BLOCK], real[BLOCK], imaginary[BLOCK];
            for (int64_t q = 0; q < some; q++) {
                size[q] = wavenumber[begin + q] * radius[i];
                double inside = size[q] < steps[4] ? size[q] : steps[4];
                place[q] = (sqrt(inside + steps[1]) - sqrt(steps[1])) / steps[0];
            }
            for (int64_t q = 0; q < some; q++) {
                int64_t row = (int64_t)place[q];
                int64_t four = row / 4;
                if (four == known + 1)
                    memcpy(line, line + 8, 8 * sizeof *line);
                else if (four != known)
                    mixed(column + 8 * four, rows, along, line);
                if (four != known)
                    mixed(column + 8 * four + 8, rows, along, line + 8);
                known = four;
                const float *l = line + 2 * (row - 4 * four);
                splines(place[q] - (double)row, over);
                real[q] = over[0] * l[0] + over[1] * l[2] + over[2] * l[4] + over[3] * l[6];
                imaginary[q] = over[0] * l[1] + over[1] * l[3] + over[2] * l[5] + over[3] * l[7];
            }
            for (int64_t q = 0; q < some; q++) {
                double square = size[q] * size[q];
                double level = square * size[q] / sqrt(4.0 + square) * factor[i] / wavenumber[begin + q];
                double cosine, sine;
                turned_back(-later[i] * size[q] / TURN, &cosine, &sine);
                double turned = level * (real[q] * cosine - imaginary[q] * sine);
                imaginary[q] = level * (real[q] * sine + imaginary[q] * cosine);
                real[q] = turned;
            }
            for (int64_t q = 0; q < some; q++) {
                values[2 * ((begin + q) * count + i)] = real[q];
                values[2 * ((begin + q) * count + i) + 1] = imaginary[q];
            }
        }
    }
}

void cylinders(int64_t nodes, const double *wavenumber, int64_t count, const double *radius,
               const double *phase, const double *level, const int8_t *wave, const int8_t *end, double largest,
               const double *bend, double first, double step, int64_t cells, const double *tables, double *values)
{
    for (int64_t i = 0; i < count; i++) {
        const double *table = tables + 8 * cells * wave[i];
        for (int64_t begin = 0; begin < nodes; begin += BLOCK) {
            int64_t some = nodes - begin < BLOCK ? nodes - begin : BLOCK;
            const double *k = wavenumber + begin;
            double place[BLOCK], real[BLOCK], imaginary[BLOCK];
            for (int64_t q = 0; q < some; q++) {
                double size = k[q] * radius[i];
                double inside = size < largest ? size : largest;
                place[q] = (logarithm(1.0 + 2.0 * inside) - first) / step;
            }
            for (int64_t q = 0; q < some; q++)
                cubic(cells, table, place[q], real + q, imaginary + q);
            for (int64_t q = 0; q < some; q++) {
                double size = k[q] * radius[i];
                double inside = size < largest ? size : largest;
                double beyond = size > largest ? size / largest : 1.0;
                double bent = 1.0 - 1.0 / beyond;
                double turn = k[q] * phase[i];
                double cosine, sine;
                turned_back(-turn / TURN, &cosine, &sine);
                double along = fabs(turn) < 1e-8 ? 1.0 : sine / turn;
                along *= level[i] * inside * inside / (1.0 + inside * sqrt(inside)) * sqrt(beyond);
                double mixed = along * (real[q] * (1.0 + bent * bend[0]) - imaginary[q] * bent * bend[1]);
                imaginary[q] = -along * (imaginary[q] * (1.0 + bent * bend[0]) + real[q] * bent * bend[1]);
                real[q] = mixed;
            }
            for (int64_t q = 0; q < some; q++) {
                double *value = values + 2 * ((begin + q) * count + i);
                value[0] = end[i] ? -imaginary[q] / k[q] : real[q];
                value[1] = end[i] ? real[q] / k[q] : imaginary[q];
            }
        }
    }
}

void move_discs(int64_t count, const int64_t *rows, const double *centre, const double *normal,
                const double *transform, double scale, double *moved, double *turned)
{
    for (int64_t i = 0; i < count; i++) {
        const double *c = centre + 3 * rows[i];
        const double *n = normal + 3 * rows[i];
        for (int a = 0; a < 3; a++) {
            const double *t = transform + 4 * a;
            moved[3 * i + a] = t[0] * c[0] + t[1] * c[1] + t[2] * c[2] + t[3];
            turned[3 * i + a] = (t[0] * n[0] + t[1] * n[1] + t[2] * n[2]) / scale;
        }
    }
}

/* The angle from 0 to half a turn of which these are a sine, not negative, and a cosine, times any length. */
static inline double angle_of(double sine, double cosine)
{
    double length = sqrt(sine * sine + cosine * cosine) + fabs(cosine);
    double t = length == 0.0 ? 0.0 : sine / length; /* the tangent of half of it, then of an eighth */
    t = t / (1.0 + sqrt(1.0 + t * t));
    t = t / (1.0 + sqrt(1.0 + t * t));
    double y = t * t;
    double sum = 1.0 / 23.0;
    sum = 1.0 / 21.0 - sum * y;
    sum = 1.0 / 19.0 - sum * y;
    sum = 1.0 / 17.0 - sum * y;
    sum = 1.0 / 15.0 - sum * y;
    sum = 1.0 / 13.0 - sum * y;
    sum = 1.0 / 11.0 - sum * y;
    sum = 1.0 / 9.0 - sum * y;
    sum = 1.0 / 7.0 - sum * y;
    sum = 1.0 / 5.0 - sum * y;
    sum = 1.0 / 3.0 - sum * y;
    double angle = 8.0 * (t - t * y * sum);
    return cosine < 0.0 ? 0.5 * TURN - angle : angle;
}

void incidences(int64_t count, const double *centre, const double *normal, const double *point, double *angle)
{
    for (int64_t i = 0; i < count; i++) {
        const double *c = centre + 3 * i;
        const double *n = normal + 3 * i;
        double x = c[0] - point[0];
        double y = c[1] - point[1];
        double z = c[2] - point[2];
        double a = y * n[2] - z * n[1];
        double b = z * n[0] - x * n[2];
        double d = x * n[1] - y * n[0];
        angle[i] = angle_of(sqrt(a * a + b * b + d * d), fabs(x * n[0] + y * n[1] + z * n[2]));
    }
}

void trace_paths(int64_t count, const double *centre, int64_t ends, const double *place, const double *frame,
                 double *direction, double *distance, double *offset)
{
    for (int64_t e = 0; e < ends; e++) {
        const double *from = place + 3 * e;
        const double *f = frame + 9 * e;
        for (int64_t begin = 0; begin < count; begin += BLOCK) {
            int64_t some = count - begin < BLOCK ? count - begin : BLOCK;
            double away[BLOCK], left[BLOCK], up[BLOCK], share[BLOCK];
            for (int64_t i = 0; i < some; i++) {
                const double *c = centre + 3 * (begin + i);
                double x = c[0] - from[0];
                double y = c[1] - from[1];
                double z = c[2] - from[2];
                away[i] = sqrt(x * x + y * y + z * z);
                left[i] = f[3] * x + f[4] * y + f[5] * z;
                up[i] = f[6] * x + f[7] * y + f[8] * z;
                double side = sqrt(left[i] * left[i] + up[i] * up[i]);
                double angle = angle_of(side, f[0] * x + f[1] * y + f[2] * z);
                share[i] = side > 0.0 ? angle / side : 0.0;
                left[i] = side > 0.0 ? share[i] * left[i] : angle;
            }
            for (int64_t i = 0; i < some; i++) {
                int64_t row = begin + i;
                distance[row * ends + e] = away[i];
                offset[2 * (row * ends + e)] = left[i];
                offset[2 * (row * ends + e) + 1] = share[i] * up[i];
                for (int a = 0; e == 0 && a < 3; a++)
                    direction[3 * row + a] = (centre[3 * row + a] - from[a]) / away[i];
            }
        }
    }
}
