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

enum { PAPER, PISTON, EXACT };                    /* models of discs */
enum { BROKEN, NEAR, FAR, LATE }; /* leaves that are left out */

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
        double turn_at[BLOCK], steep_at[BLOCK]; /* of a radius of 1 m, at as many nodes */
        for (int64_t i = 0; i < some; i++) {
            double log_radius = logarithm(radius[begin + i] > 1e-30 ? radius[begin + i] : 1e-30);
            turn_of[i] = 0.3999 * exponential(-0.9065 * log_radius);
            steep_of[i] = 0.9824 * exponential(0.3523 * log_radius);
        }
        for (int64_t q = 0; q < nodes; q++) {
            double k = wavenumber[q];
            if (q % BLOCK == 0)
                for (int64_t r = 0; r < BLOCK && q + r < nodes; r++) {
                    double log_wavenumber = logarithm(wavenumber[q + r]);
                    turn_at[r] = exponential(-0.9065 * log_wavenumber);
                    steep_at[r] = exponential(0.3523 * log_wavenumber);
                }
            double *value = values + 2 * (q * count + begin);
            for (int64_t i = 0; i < some; i++) {
                double size = k * radius[begin + i];
                double turn = turn_of[i] * turn_at[q % BLOCK] + 0.9979;
                double steepness = steep_of[i] * steep_at[q % BLOCK] - 0.9459;
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

/* 2 J1(x)/x, of at most a BLOCK: by its power series, or from the Hankel function of order 1, of which a table has
 * what is left without its phase e^{ix} and times the root of x, over 6/x from 0 to 1. */
static inline void jincs(int64_t some, int64_t cells, const double *table, const double *x, double *value)
{
    double square[BLOCK], place[BLOCK], real[BLOCK], imaginary[BLOCK];
    for (int64_t i = 0; i < some; i++) {
        square[i] = x[i] < 6.0 ? 0.25 * x[i] * x[i] : 0.0;
        place[i] = (double)cells * (6.0 / larger(x[i], 6.0));
        value[i] = 1.0;
    }
    for (int n = 20; n > 0; n--) {
        double share = 1.0 / (double)(n * (n + 1));
        for (int64_t i = 0; i < some; i++)
            value[i] = 1.0 - square[i] * share * value[i];
    }
    for (int64_t i = 0; i < some; i++)
        cubic(cells, table, place[i], real + i, imaginary + i);
    for (int64_t i = 0; i < some; i++) {
        double cosine, sine;
        turned_back(-x[i] / TURN, &cosine, &sine);
        double beyond = 2.0 * (real[i] * cosine - imaginary[i] * sine) / (x[i] * sqrt(x[i]));
        value[i] = x[i] >= 6.0 ? beyond : value[i];
    }
}

void piston_discs(int64_t nodes, const double *wavenumber, int64_t count, const double *radius,
                  const double *incidence, const double *factor, const int8_t *side, int64_t cells,
                  const double *table, double *values)
{
    for (int64_t begin = 0; begin < count; begin += BLOCK) {
        int64_t some = count - begin < BLOCK ? count - begin : BLOCK;
        double across[BLOCK], face[BLOCK], sign[BLOCK];
        int64_t rims = 0;
        for (int64_t i = 0; i < some; i++) {
            double sine, cosine;
            sign[i] = side[begin + i];
            rims += sign[i] != 0.0;
            turned_back(-incidence[begin + i] / TURN, &cosine, &sine);
            across[i] = 2.0 * radius[begin + i] * sine;
            face[i] = 0.5 * radius[begin + i] * radius[begin + i] * cosine * factor[begin + i];
        }
        for (int64_t q = 0; q < nodes; q++) {
            double *value = values + 2 * (q * count + begin);
            double x[BLOCK], place[BLOCK], rim[BLOCK], whole[BLOCK] = {0.0};
            double real[BLOCK] = {0.0}, imaginary[BLOCK] = {0.0};
            for (int64_t i = 0; i < some; i++) {
                x[i] = wavenumber[q] * across[i];
                double beyond = larger(x[i], 6.0);
                place[i] = (double)cells * (6.0 / beyond);
                rim[i] = face[i] * wavenumber[q] / (beyond * sqrt(beyond));
            }
            if (rims < some)
                jincs(some, cells, table, x, whole);
            for (int64_t i = 0; rims > 0 && i < some; i++)
                cubic(cells, table, place[i], real + i, imaginary + i);
            for (int64_t i = 0; i < some; i++) {
                value[2 * i] = sign[i] * rim[i] * imaginary[i];
                value[2 * i + 1] = sign[i] != 0.0 ? rim[i] * real[i] : face[i] * wavenumber[q] * whole[i];
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
        float along[4];
        splines(at - (double)cell, over);
        for (int b = 0; b < 4; b++)
            along[b] = (float)over[b];
        for (int64_t begin = 0; begin < nodes; begin += BLOCK) {
            int64_t some = nodes - begin < BLOCK ? nodes - begin : BLOCK;
            double size[BLOCK], across[4][BLOCK], real[BLOCK], imaginary[BLOCK];
            float line[BLOCK][8];
            int32_t row[BLOCK];
            for (int64_t q = 0; q < some; q++) {
                size[q] = wavenumber[begin + q] * radius[i];
                double inside = size[q] < steps[4] ? size[q] : steps[4];
                double place = (sqrt(inside + steps[1]) - sqrt(steps[1])) / steps[0];
                row[q] = (int32_t)place;
                splines(place - (double)row[q], over);
                for (int b = 0; b < 4; b++)
                    across[b][q] = over[b];
            }
            for (int64_t q = 0; q < some; q++)
                mixed(column + 2 * (int64_t)row[q], rows, along, line[q]);
            for (int64_t q = 0; q < some; q++) {
                const float *l = line[q];
                real[q] = across[0][q] * l[0] + across[1][q] * l[2] + across[2][q] * l[4] + across[3][q] * l[6];
                imaginary[q] = across[0][q] * l[1] + across[1][q] * l[3] + across[2][q] * l[5] + across[3][q] * l[7];
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
    for (int64_t begin = 0; begin < count; begin += BLOCK) {
        int64_t some = count - begin < BLOCK ? count - begin : BLOCK;
        for (int64_t q = 0; q < nodes; q++) {
            double k = wavenumber[q];
            double *value = values + 2 * (q * count + begin);
            double size[BLOCK], place[BLOCK], real[BLOCK], imaginary[BLOCK];
            for (int64_t i = 0; i < some; i++) {
                size[i] = k * radius[begin + i];
                double inside = size[i] < largest ? size[i] : largest;
                place[i] = (logarithm(1.0 + 2.0 * inside) - first) / step;
            }
            for (int64_t i = 0; i < some; i++)
                cubic(cells, tables + 8 * cells * wave[begin + i], place[i], real + i, imaginary + i);
            for (int64_t i = 0; i < some; i++) {
                double inside = size[i] < largest ? size[i] : largest;
                double beyond = size[i] > largest ? size[i] / largest : 1.0;
                double bent = 1.0 - 1.0 / beyond;
                double turn = k * phase[begin + i];
                double cosine, sine;
                turned_back(-turn / TURN, &cosine, &sine);
                double along = fabs(turn) < 1e-8 ? 1.0 : sine / turn;
                along *= level[begin + i] * inside * inside / (1.0 + inside * sqrt(inside)) * sqrt(beyond);
                double mixed = along * (real[i] * (1.0 + bent * bend[0]) - imaginary[i] * bent * bend[1]);
                imaginary[i] = -along * (imaginary[i] * (1.0 + bent * bend[0]) + real[i] * bent * bend[1]);
                real[i] = mixed;
            }
            for (int64_t i = 0; i < some; i++) {
                value[2 * i] = end[begin + i] ? -imaginary[i] / k : real[i];
                value[2 * i + 1] = end[begin + i] ? real[i] / k : imaginary[i];
            }
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

/* The ways from an end with its frame to as many places as there are: how far they are, and how far off its axis
 * to the left and up, as beam_offsets of sensing/sonar/beam.py. */
static inline void trace(int64_t some, const double *x, const double *y, const double *z, const double *from,
                         const double *frame, double *away, double *left, double *up)
{
    for (int64_t i = 0; i < some; i++) {
        double a = x[i] - from[0];
        double b = y[i] - from[1];
        double c = z[i] - from[2];
        double to_left = frame[3] * a + frame[4] * b + frame[5] * c;
        double upwards = frame[6] * a + frame[7] * b + frame[8] * c;
        double side = sqrt(to_left * to_left + upwards * upwards);
        double angle = angle_of(side, frame[0] * a + frame[1] * b + frame[2] * c);
        double share = side > 0.0 ? angle / side : 0.0;
        away[i] = sqrt(a * a + b * b + c * c);
        left[i] = side > 0.0 ? share * to_left : angle;
        up[i] = share * upwards;
    }
}

void trace_paths(int64_t count, const double *centre, int64_t ends, const double *place, const double *frame,
                 double *distance, double *offset)
{
    for (int64_t begin = 0; begin < count; begin += BLOCK) {
        int64_t some = count - begin < BLOCK ? count - begin : BLOCK;
        double x[BLOCK], y[BLOCK], z[BLOCK], away[BLOCK], left[BLOCK], up[BLOCK];
        for (int64_t i = 0; i < some; i++) {
            x[i] = centre[3 * (begin + i)];
            y[i] = centre[3 * (begin + i) + 1];
            z[i] = centre[3 * (begin + i) + 2];
        }
        for (int64_t e = 0; e < ends; e++) {
            trace(some, x, y, z, place + 3 * e, frame + 9 * e, away, left, up);
            for (int64_t i = 0; i < some; i++) {
                int64_t row = (begin + i) * ends + e;
                distance[row] = away[i];
                offset[2 * row] = left[i];
                offset[2 * row + 1] = up[i];
            }
        }
    }
}

/* What discs are bounded by; arguments of open_leaves. */
struct bounding {
    double lowest, highest;
    int64_t peaks;
    const double *peak, *height;
    int64_t cells;
    const double *hankel;
    double handover;
    const double *steps;
    int64_t margin, rows, columns;
    const float *maxima;
};

/* No |f|/cos of a disc by physical optics is larger in a band: k |J1(x)/x| at its ends, lowest and highest, or where
 * |J1| peaks between. */
static inline double optics_bound(const struct bounding *by, double radius, double across, double lowest, double highest)
{
    double low = by->lowest * across;
    double largest = larger(by->highest * fabs(highest), by->lowest * fabs(lowest));
    int64_t next = low < 1e6 ? (int64_t)(2.0 * low / TURN) - 1 : by->peaks; /* peaks are half a turn apart, about */
    next = next > 0 ? next : 0;
    next = next < by->peaks ? next : by->peaks;
    while (next < by->peaks && by->peak[next] < low)
        next++;
    if (next == by->peaks || by->peak[next] < by->highest * across)
        largest = larger(largest, 2.0 * by->height[next < by->peaks ? next : next - 1] / across);
    return 0.5 * radius * radius * largest;
}

static inline void piston_bounds(const struct bounding *by, int64_t some, const double *radius, const double *angle,
                                 double *bound)
{
    double across[BLOCK], x[BLOCK] = {0.0}, lowest[BLOCK], highest[BLOCK];
    for (int64_t i = 0; i < some; i++) {
        double sine;
        turned_back(-angle[i] / TURN, bound + i, &sine);
        across[i] = 2.0 * radius[i] * sine;
        x[i] = by->lowest * across[i];
    }
    jincs(some, by->cells, by->hankel, x, lowest);
    for (int64_t i = 0; i < some; i++)
        x[i] = by->highest * across[i];
    jincs(some, by->cells, by->hankel, x, highest);
    for (int64_t i = 0; i < some; i++)
        bound[i] *= optics_bound(by, radius[i], across[i], lowest[i], highest[i]);
}

/* No |f| of the exact disc is larger in a band. */
static inline double exact_bound(const struct bounding *by, double radius, double angle)
{
    const double *steps = by->steps;
    double low = by->lowest * radius;
    double high = by->highest * radius;
    double bound = 0.0;
    if (!(radius < 1e6 && angle < 2.0)) /* no numbers */
        return 0.0;
    if (low < steps[4]) {
        double until = high < steps[4] ? high : steps[4];
        int64_t first = (int64_t)((sqrt(low + steps[1]) - sqrt(steps[1])) / steps[0]);
        int64_t last = (int64_t)((sqrt(until + steps[1]) - sqrt(steps[1])) / steps[0]);
        int64_t column = (int64_t)((sqrt(angle + steps[3]) - sqrt(steps[3])) / steps[2]);
        int64_t run = 0; /* two runs of as many cells, a power of two, cover all */
        while ((int64_t)2 << run <= last - first + 1)
            run++;
        const float *most = by->maxima + run * by->rows * by->columns + (column + by->margin - 1) / 2;
        first += by->margin - 1;
        last += by->margin - ((int64_t)1 << run);
        bound = radius * larger(most[first * by->columns], most[last * by->columns]);
    }
    if (high > by->handover) {
        double sine, cosine, ends[2];
        turned_back(-angle / TURN, &cosine, &sine);
        double rim = 0.5 * TURN * low * sine;
        double x[2] = {2.0 * low * sine, 2.0 * high * sine};
        jincs(2, by->cells, by->hankel, x, ends);
        bound = larger(bound, optics_bound(by, radius, 2.0 * radius * sine, ends[0], ends[1])
                                  + 0.5 * radius * (rim > 1.0 ? 1.0 / sqrt(rim) : 1.0));
    }
    return bound;
}

/* No |f| of the paper's disc is larger in a band; turns: 0.3999 k^-0.9065 at its ends. */
static inline double paper_bound(const struct bounding *by, const double *turns, double radius, double angle)
{
    double low = by->lowest * radius;
    double high = by->highest * radius;
    double turn = exponential(-0.9065 * logarithm(radius > 1e-30 ? radius : 1e-30));
    double last = 2.0 * (turn * turns[0] + 0.9979) * angle / TURN; /* half turns; the fit's angle falls with k */
    double first = 2.0 * (turn * turns[1] + 0.9979) * angle / TURN;
    double whole = (last + ROUNDER) - ROUNDER;
    whole -= whole > last ? 1.0 : 0.0;
    double sine, cosine, other;
    turned_back(0.5 * first, &cosine, &sine);
    turned_back(0.5 * last, &other, &sine);
    double wave = larger(fabs(cosine), fabs(other));
    wave = whole >= first ? 1.0 : wave; /* a crest is between */
    double peak = larger((0.5003 * high * high + 0.6867) / by->highest, (0.5003 * low * low + 0.6867) / by->lowest);
    return radius == 0.0 ? 0.0 : peak * wave;
}

void open_leaves(int64_t blocks, const int64_t *first, const int64_t *last, const double *transform,
                 const double *scale, const int64_t *instance, const double *centre,
                 const double *normal, const double *radius, const int64_t *leaf, int64_t ends, const double *place,
                 const double *frame, const double *steepness, const double *told, int64_t model, int64_t peaks,
                 const double *lobes, int64_t cells, const double *hankel, int64_t margin, int64_t rows,
                 int64_t columns, const float *maxima, int64_t room, int64_t *kept, int64_t *tally, double *moved,
                 int64_t *number, double *turned, double *size, double *nearness, int64_t *owner, double *away,
                 double *offset, double *bound)
{
    double nearest = told[0], farthest = told[1], shortest = told[2], longest = told[3], loss = told[4];
    double far = told[5], aside = told[6], closest = told[7];
    struct bounding by = {told[8],  told[9],   peaks,  lobes, lobes + peaks, cells,  hankel,
                          told[10], told + 11, margin, rows,  columns,       maxima};
    int beamed = 1;
    for (int64_t e = 0; e < 2 * ends; e++)
        beamed = beamed && steepness[e] == steepness[e];
    double turns[2] = {0.3999 * pow(by.lowest, -0.9065), 0.3999 * pow(by.highest, -0.9065)};
    for (int64_t b = 0; b < blocks; b++)
        for (int64_t begin = first[b]; begin < last[b]; begin += BLOCK) {
            const double *t = transform + 12 * b;
            int64_t some = last[b] - begin < BLOCK ? last[b] - begin : BLOCK;
            double shrunk = scale[b] > 0.0 ? 1.0 / scale[b] : 1.0;
            double x[BLOCK], y[BLOCK], z[BLOCK], u[BLOCK], v[BLOCK], w[BLOCK], a[BLOCK];
            double distance[BLOCK], sine[BLOCK], angle[BLOCK], strength[BLOCK], held[BLOCK];
            double leg[BLOCK], left[BLOCK], up[BLOCK], sent[BLOCK], gain[BLOCK];
            double most[BLOCK] = {0.0}, least[BLOCK], longer[BLOCK] = {0.0};
            for (int64_t i = 0; i < some; i++) {
                const double *c = centre + 3 * (begin + i);
                const double *n = normal + 3 * (begin + i);
                x[i] = t[0] * c[0] + t[1] * c[1] + t[2] * c[2] + t[3];
                y[i] = t[4] * c[0] + t[5] * c[1] + t[6] * c[2] + t[7];
                z[i] = t[8] * c[0] + t[9] * c[1] + t[10] * c[2] + t[11];
                u[i] = (t[0] * n[0] + t[1] * n[1] + t[2] * n[2]) * shrunk;
                v[i] = (t[4] * n[0] + t[5] * n[1] + t[6] * n[2]) * shrunk;
                w[i] = (t[8] * n[0] + t[9] * n[1] + t[10] * n[2]) * shrunk;
                a[i] = scale[b] * radius[begin + i];
            }
            for (int64_t e = 0; e < ends; e++) {
                trace(some, x, y, z, place + 3 * e, frame + 9 * e, leg, left, up);
                double across = steepness[2 * e];
                double along = steepness[2 * e + 1];
                for (int64_t i = 0; i < some; i++) { /* where the first of these may go; the others move up below */
                    int64_t row = (kept[0] + i) * ends + e;
                    away[row] = leg[i];
                    offset[2 * row] = left[i];
                    offset[2 * row + 1] = up[i];
                    gain[i] = across * left[i] * left[i] + along * up[i] * up[i];
                }
                if (e == 0) {
                    memcpy(sent, gain, sizeof sent);
                    memcpy(distance, leg, sizeof distance);
                    continue;
                }
                for (int64_t i = 0; i < some; i++) {
                    double length = distance[i] + leg[i];
                    double exponent = sent[i] + gain[i] - loss * length;
                    gain[i] = exponential(exponent > -700.0 ? exponent : -700.0) / (distance[i] * leg[i]);
                    gain[i] = exponent > -700.0 ? gain[i] : 0.0;
                    most[i] = larger(gain[i], most[i]);
                    least[i] = e == 1 ? leg[i] : smaller(leg[i], least[i]);
                    longer[i] = larger(length, longer[i]);
                }
            }
            for (int64_t i = 0; i < some; i++) {
                double p = x[i] - place[0];
                double q = y[i] - place[1];
                double r = z[i] - place[2];
                double f = q * w[i] - r * v[i];
                double g = r * u[i] - p * w[i];
                double h = p * v[i] - q * u[i];
                sine[i] = sqrt(f * f + g * g + h * h);
                angle[i] = angle_of(sine[i], fabs(p * u[i] + q * v[i] + r * w[i]));
                double late = by.highest * a[i] * a[i] / (2.0 * larger(distance[i], 1e-9));
                late = late * late - 1.0 / (4.0 * far * far);
                held[i] = model == PAPER ? 1.0 / sqrt(1.0 + (late > 0.0 ? late : 0.0)) : 1.0;
            }
            if (model == PAPER)
                for (int64_t i = 0; i < some; i++)
                    strength[i] = paper_bound(&by, turns, a[i], angle[i]);
            else if (model == PISTON)
                piston_bounds(&by, some, a, angle, strength);
            else
                for (int64_t i = 0; i < some; i++)
                    strength[i] = exact_bound(&by, a[i], angle[i]);
            int64_t here = kept[0];
            for (int64_t i = 0; i < some; i++) {
                double sum = x[i] + y[i] + z[i] + u[i] + v[i] + w[i] + a[i] + distance[i];
                int finite = sum - sum == 0.0;
                int near = distance[i] < nearest;
                int beyond = distance[i] > farthest;
                int face = model != PAPER && !near && !beyond
                           && distance[i] < far * by.highest * a[i] * a[i]
                           && (sine[i] < aside * a[i] || distance[i] < closest * a[i]);
                int64_t to = room - 1 - kept[1];
                kept[1] += face;
                if (!face) {
                    int outside = !finite || near || beyond || least[i] < shortest;
                    tally[BROKEN] += !finite;
                    tally[NEAR] += finite && near;
                    tally[FAR] += finite && beyond;
                    tally[LATE] += !outside && longer[i] > longest;
                    bound[here] = strength[i] * held[i] * (beamed ? most[i] : 1.0);
                    if (outside || longer[i] > longest || !(bound[here] > 0.0))
                        continue;
                    to = here++;
                    for (int64_t e = 0; e < ends; e++) {
                        int64_t from = (kept[0] + i) * ends + e;
                        away[to * ends + e] = away[from];
                        offset[2 * (to * ends + e)] = offset[2 * from];
                        offset[2 * (to * ends + e) + 1] = offset[2 * from + 1];
                    }
                }
                double middle[3] = {x[i], y[i], z[i]};
                double upright[3] = {u[i], v[i], w[i]};
                memcpy(moved + 3 * to, middle, sizeof middle);
                memcpy(turned + 3 * to, upright, sizeof upright);
                number[to] = leaf[begin + i];
                size[to] = a[i];
                nearness[to] = held[i];
                owner[to] = instance[b];
            }
            kept[0] = here;
        }
}
