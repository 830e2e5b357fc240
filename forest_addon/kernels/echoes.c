/* Echoes of a LiDAR: the rays of its beams, and what comes back on them made into echoes, pulse by pulse.
 *
 * The same sums as sensing/lidar/footprint.py, waveform.py and surveys/digitised.py, which say why.
 */
#include "kernels.h"

#include <math.h>
#include <stdlib.h>

#define APART 8.0         /* standard deviations beyond which contacts are treated alone */
#define STEP 0.25         /* of the smallest width of a group, of the search for crests */
#define FINE 1e-13        /* of the bracket and of the place: a step of Newton's method that is rounding */
#define TRIES 60          /* steps of it */
#define SHORT 0.4         /* pulse lengths: what is shorter is one echo at its mean anyway */
#define ALIKE 0.95        /* cosine between the normals of neighbours on one surface */
#define BESIDE 0.1        /* pulse lengths, and BESIDE_SHARE of the way, that a surface may be off a plane */
#define BESIDE_SHARE 0.2
#define SPREAD 4.0        /* a patch of n contacts is blurred by SPREAD / sqrt(n), at most MOST */
#define MOST 0.9
#define MANY 100          /* contacts of a patch, beyond which that does not do */

void spread_rays(int64_t beams, const double *start, const double *axis, const double *exit_x,
                 const double *exit_y, const double *turn_x, const double *turn_y, int64_t subrays,
                 const double *place, double *origin, double *direction)
{
    for (int64_t first = 0; first < 3 * beams; first += 3) {
        for (int64_t ray = 0; ray < subrays; ray++) {
            double x = place[2 * ray];
            double y = place[2 * ray + 1];
            double way[3];
            for (int64_t k = 0; k < 3; k++) {
                *origin++ = exit_x[first + k] * x + exit_y[first + k] * y + start[first + k];
                way[k] = turn_x[first + k] * x + turn_y[first + k] * y + axis[first + k];
            }
            double length = sqrt(way[0] * way[0] + way[1] * way[1] + way[2] * way[2]);
            for (int k = 0; k < 3; k++) {
                *direction++ = way[k] / length;
            }
        }
    }
}

void light_back(int64_t count, const int64_t *ray, int64_t subrays, const double *share,
                const double *reflectance, const double *light, const double *distance,
                const double *normal, const double *direction, double extinction, double nearest,
                double *energy)
{
    int64_t base = 0; /* first ray of the pulse */
    for (int64_t i = 0; i < count; i++) {
        if (ray[i] < base || ray[i] >= base + subrays) {
            base = ray[i] / subrays * subrays;
        }
        double back = reflectance[i] * light[i] * share[ray[i] - base];
        back = back * fabs(dot(normal + 3 * i, direction + 3 * i)) / (distance[i] * distance[i]);
        if (extinction != 0) {
            back *= exp(-2 * extinction * distance[i]);
        }
        energy[i] = back > 0 && distance[i] >= nearest ? back : 0;
    }
}

/* Contacts of beams: rows of the arrays of blur_patches. */
struct contacts {
    const double *origin, *direction, *normal, *distance;
};

/* 1/range at which the ray of contact j meets the plane of contact i. */
static double plane(const struct contacts *c, int64_t i, int64_t j)
{
    const double *normal = c->normal + 3 * i;
    const double *from_i = c->origin + 3 * i;
    const double *from_j = c->origin + 3 * j;
    const double *way_i = c->direction + 3 * i;
    double foot[3];
    for (int k = 0; k < 3; k++) {
        foot[k] = from_i[k] - from_j[k] + c->distance[i] * way_i[k];
    }
    return dot(normal, c->direction + 3 * j) / dot(normal, foot);
}

/* Returns whether contacts i and j lie on one smooth surface. */
static int linked(const struct contacts *c, int64_t i, int64_t j, double sigma)
{
    if (!(fabs(dot(c->normal + 3 * i, c->normal + 3 * j)) > ALIKE)) {
        return 0;
    }
    double near = 1 / c->distance[i];
    double far = 1 / c->distance[j];
    double change = far - near;
    double expected = (plane(c, i, j) - near + far - plane(c, j, i)) / 2;
    double off = fabs(change - expected);
    return off <= BESIDE_SHARE * fabs(change) + BESIDE * sigma * near * far;
}

/* The root of a patch in a forest of parents, by place; shortens the way to it. */
static int64_t root(int64_t *parent, int64_t at)
{
    while (parent[at] != at) {
        parent[at] = parent[parent[at]];
        at = parent[at];
    }
    return at;
}

/* Moves and blurs the contacts of one pulse; seat (subrays,) is the row of the contact of each, -1 of none. */
static void patches(const struct contacts *c, int64_t subrays, const int64_t *seat, const double *energy,
                    double sigma, int64_t *parent, double *sum, double *moved, double *blur)
{
    for (int64_t s = 0; s < subrays; s++) {
        parent[s] = s;
    }
    int64_t after = 2;
    for (int64_t step = 1; step < subrays;) {
        for (int64_t s = 0; s + step < subrays; s++) {
            int64_t i = seat[s];
            int64_t j = seat[s + step];
            if (i >= 0 && j >= 0 && linked(c, i, j, sigma)) {
                parent[root(parent, s)] = root(parent, s + step);
            }
        }
        int64_t next = step + after;
        step = after;
        after = next;
    }
    for (int64_t s = 0; s < 6 * subrays; s++) {
        sum[s] = 0;
    }
    for (int64_t s = 0; s < subrays; s++) {
        if (seat[s] < 0) {
            continue;
        }
        int64_t patch = root(parent, s);
        double *of = sum + 6 * patch; /* contacts, energy, mean, variance, lowest, highest */
        if (of[0] == 0) {
            parent[subrays + patch] = seat[s]; /* from whose range the others are measured */
        }
        double away = c->distance[seat[s]] - c->distance[parent[subrays + patch]];
        of[0] += 1;
        of[1] += energy[seat[s]];
        of[2] += energy[seat[s]] * away;
        of[4] = smaller(of[4], away);
        of[5] = larger(of[5], away);
    }
    for (int64_t s = 0; s < subrays; s++) {
        if (seat[s] >= 0) {
            int64_t patch = root(parent, s);
            double *of = sum + 6 * patch;
            double away = c->distance[seat[s]] - c->distance[parent[subrays + patch]] - of[2] / of[1];
            of[3] += energy[seat[s]] * away * away;
        }
    }
    for (int64_t s = 0; s < subrays; s++) {
        if (seat[s] < 0) {
            continue;
        }
        int64_t patch = root(parent, s);
        const double *of = sum + 6 * patch;
        if (of[0] < 2) {
            continue;
        }
        double mean = of[2] / of[1] + c->distance[parent[subrays + patch]];
        double variance = of[3] / of[1];
        double square = (of[5] - of[4]) * (of[5] - of[4]);
        double share = smaller(SPREAD / sqrt(of[0]), MOST);
        if (of[0] > MANY && square > 0) {
            share = square / (square + 4 * variance);
        }
        moved[seat[s]] = mean + sqrt(1 - share) * (c->distance[seat[s]] - mean);
        blur[seat[s]] = sqrt(share * variance);
    }
}

void blur_patches(int64_t count, const int64_t *order, const int64_t *ray, int64_t subrays,
                  const int8_t *surface, const double *distance, const double *energy,
                  const double *origin, const double *direction, const double *normal, double sigma,
                  int64_t *seats, double *room, double *moved, double *blur)
{
    struct contacts all = {origin, direction, normal, distance};
    int64_t stop;
    for (int64_t first = 0; first < count; first = stop) {
        int64_t base = ray[order[first]] / subrays * subrays; /* first ray of this pulse */
        double near = INFINITY;
        double far = -INFINITY;
        int8_t most = -1;
        for (stop = first; stop < count && ray[order[stop]] < base + subrays; stop++) {
            int64_t row = order[stop];
            moved[row] = distance[row];
            blur[row] = 0;
            if (surface[row] >= 0 && energy[row] > 0) {
                near = smaller(near, distance[row]);
                far = larger(far, distance[row]);
                most = surface[row] > most ? surface[row] : most;
            }
        }
        if (!(far - near > SHORT * sigma)) {
            continue;
        }
        for (int8_t number = 0; number <= most; number++) {
            int64_t seated = 0;
            for (int64_t s = 0; s < subrays; s++) {
                seats[s] = -1;
            }
            for (int64_t at = first; at < stop; at++) {
                int64_t row = order[at];
                int64_t *seat = seats + (ray[row] - base);
                if (*seat < 0 && surface[row] == number && energy[row] > 0) {
                    *seat = row;
                    seated++;
                }
            }
            if (seated > 1) {
                patches(&all, subrays, seats, energy, sigma, seats + subrays, room, moved, blur);
            }
        }
    }
}

/* Contacts of a pulse, sorted by range: places, energies, widths, and the terms of the waveform. */
struct pulse {
    int64_t count;
    const int64_t *row, *subray;
    double *at, *energy, *width, *narrow, *height, *behind;
};

/* What is found: rows of the arrays of find_echoes. */
struct echoes {
    int64_t count;
    int64_t *pulse, *contact;
    double *distance, *energy, *width;
};

/* Slope of the waveform of contacts [first, stop) at x over the sum of their weights, metres; its derivative. */
static double slope_at(const struct pulse *p, int64_t first, int64_t stop, double x, double *bend)
{
    double nearest = INFINITY; /* keeps the largest exponential at 1 */
    for (int64_t i = first; i < stop; i++) {
        double away = p->at[i] - x;
        nearest = smaller(nearest, 0.5 * away * away * p->narrow[i]);
    }
    double total = 0;
    double mean = 0;
    double drift = 0;
    double square = 0;
    for (int64_t i = first; i < stop; i++) {
        double away = p->at[i] - x;
        double weight = p->height[i] * exp(nearest - 0.5 * away * away * p->narrow[i]);
        total += weight;
        weight *= away;
        mean += weight;
        weight *= p->narrow[i];
        drift += weight;
        square += weight * away;
    }
    if (!(total > 0)) {
        total = 1;
    }
    mean /= total;
    *bend = square / total - 1 - mean * (drift / total);
    return mean;
}

/* Crest within a bracket of the waveform of contacts [first, stop): Newton, held by bisection. */
static double crest_of(const struct pulse *p, int64_t first, int64_t stop, double low, double high)
{
    double x = (low + high) / 2;
    double fine = FINE * (high - low);
    for (int tries = 0; tries < TRIES && high > low; tries++) {
        double bend;
        double slope = slope_at(p, first, stop, x, &bend);
        if (slope > 0) {
            low = x;
        } else {
            high = x;
        }
        double after = x - slope / bend;
        if (!(after >= low && after <= high && bend < 0)) {
            after = (low + high) / 2;
        }
        double step = fabs(after - x);
        double size = fabs(x);
        x = after;
        if (!(step > fine + FINE * size)) {
            break;
        }
    }
    return x;
}

/* Adds the echo of contacts [first, stop) at a distance; NaN stands for the mean of their light. */
static void add_echo(const struct pulse *p, int64_t first, int64_t stop, double sigma, double distance,
                     struct echoes *found)
{
    double total = 0;
    double strongest = 0;
    double mean = 0;
    double spread = 0;
    int64_t chosen = -1;
    for (int64_t i = first; i < stop; i++) {
        total += p->energy[i];
        strongest = larger(strongest, p->energy[i]);
    }
    for (int64_t i = first; i < stop; i++) {
        mean += p->energy[i] / total * (p->at[i] - p->at[first]);
        if (p->energy[i] >= 0.5 * strongest && (chosen < 0 || p->subray[i] < p->subray[chosen])) {
            chosen = i;
        }
    }
    for (int64_t i = first; i < stop; i++) {
        double away = p->at[i] - p->at[first] - mean;
        double own = p->width[i] * p->width[i] - sigma * sigma;
        spread += p->energy[i] / total * (away * away + own);
    }
    int64_t n = found->count++;
    found->distance[n] = isnan(distance) ? p->at[first] + mean : distance;
    found->energy[n] = total;
    found->width[n] = stop - first == 1 ? p->width[first] : sqrt(sigma * sigma + spread);
    found->contact[n] = p->row[chosen];
}

/* Adds the echoes of a group of contacts: one for each crest of their waveform at which a contact lies. */
static void add_group(const struct pulse *p, int64_t first, int64_t stop, double sigma, struct echoes *found)
{
    double start = p->at[first];
    double end = p->at[stop - 1];
    double least = p->width[first];
    for (int64_t i = first; i < stop; i++) {
        least = smaller(least, p->width[i]);
    }
    if (!(end - start > 2 * least)) {
        add_echo(p, first, stop, sigma, crest_of(p, first, stop, start, end), found);
        return;
    }
    int64_t nodes = (int64_t)ceil((end - start) / (STEP * least)) + 1;
    double step = (end - start) / (double)(nodes - 1);
    double low = start;
    double high = end;
    double bend;
    int64_t begin = first; /* of the contacts of this crest */
    int64_t next = first;  /* the first contact beyond the nodes that were passed */
    int rises = 1;         /* outside all contacts the way to them is up */
    for (int64_t node = 0; node < nodes - 1; node++) {
        double x = start + (double)node * step;
        double beyond = start + (double)(node + 1) * step;
        int goes_on = node + 1 < nodes - 1 && slope_at(p, first, stop, beyond, &bend) > 0;
        if (rises && !goes_on) {
            low = x;
            high = beyond;
        }
        int64_t cut = -1; /* of a valley in this step: the first contact behind it, where the way up leads on */
        for (; next < stop; next++) {
            int64_t cell = (int64_t)((p->at[next] - start) / step);
            if (cell > node && node < nodes - 2) {
                break;
            }
            if (!rises && goes_on && cut < 0 && slope_at(p, first, stop, p->at[next], &bend) > 0) {
                cut = next;
            }
        }
        if (!rises && goes_on) {
            cut = cut < 0 ? next : cut;
            if (cut > begin) { /* between two valleys there may be no contact */
                add_echo(p, begin, cut, sigma, crest_of(p, first, stop, low, high), found);
            }
            begin = cut;
        }
        rises = goes_on;
    }
    if (stop > begin) {
        add_echo(p, begin, stop, sigma, crest_of(p, first, stop, low, high), found);
    }
}

/* Adds the echoes of a pulse: contacts that are far from all before them begin a group. */
static void add_waveform(const struct pulse *p, double sigma, struct echoes *found)
{
    int64_t count = p->count;
    int wide = 0;
    for (int64_t i = 0; i < count; i++) {
        wide |= p->width[i] > sigma;
        p->narrow[i] = 1 / (p->width[i] * p->width[i]);
        p->height[i] = p->energy[i] / (p->width[i] * p->width[i] * p->width[i]);
    }
    double least = INFINITY; /* of what later contacts reach back to */
    for (int64_t i = count - 1; i >= 0; i--) {
        least = smaller(least, p->at[i] - APART * (p->width[i] - sigma / 2));
        p->behind[i] = least;
    }
    double before = -INFINITY;
    int64_t first = 0;
    for (int64_t i = 0; i < count; i++) {
        before = larger(before, p->at[i] + APART * (p->width[i] - sigma / 2));
        int last = i + 1 == count;
        if (last || (wide ? before < p->behind[i + 1] : p->at[i + 1] - p->at[i] > APART * sigma)) {
            add_group(p, first, i + 1, sigma, found);
            first = i + 1;
        }
    }
}

/* A receiver that samples (surveys/digitised.py): bins of a pulse's light, and its window, in bins. */
struct digitiser {
    int64_t bins, window;
    const double *shape;
    double bin; /* metres */
};

/* Returns whether a bin of a wave is larger than all others within the window, none of which is empty; what is
 * beyond an end of the pulse's light does not count. */
static int is_echo(const double *wave, int64_t length, int64_t bin, int64_t window, int opens, int ends)
{
    if (!(wave[bin] > 0)) {
        return 0;
    }
    for (int64_t away = 1; away < window; away++) {
        int64_t left = bin - away;
        int64_t right = bin + away;
        int before = left >= 0 && wave[left] > 0 && wave[left] < wave[bin];
        int after = right < length && wave[right] > 0 && wave[right] < wave[bin];
        if (!(before || (opens && left <= 0)) || !(after || (ends && right >= length))) {
            return 0;
        }
    }
    return 1;
}

/* Adds the echoes of a pulse as bins show them; place (count,) and peak are room for numbers of bins. */
static void add_digitised(const struct pulse *p, double sigma, const struct digitiser *d, double *wave,
                          int64_t *place, int64_t *peak, struct echoes *found)
{
    int64_t crest = 0;
    for (int64_t s = 1; s < d->bins; s++) {
        crest = d->shape[s] > d->shape[crest] ? s : crest;
    }
    int64_t peaks = 0;
    int64_t first = 0;
    for (int64_t i = 0; i < p->count; i++) {
        place[i] = (int64_t)((p->at[i] - p->at[0]) / d->bin + 1e-9);
    }
    for (int64_t i = 0; i < p->count; i++) {
        int last = i + 1 == p->count;
        if (!last && place[i + 1] - place[i] <= d->bins + d->window) {
            continue;
        }
        int64_t length = place[i] - place[first] + d->bins;
        for (int64_t bin = 0; bin < length; bin++) {
            wave[bin] = 0;
        }
        for (int64_t k = first; k <= i; k++) {
            for (int64_t s = 0; s < d->bins; s++) {
                wave[place[k] - place[first] + s] += p->energy[k] * d->shape[s];
            }
        }
        for (int64_t bin = 0; bin < length; bin++) {
            if (is_echo(wave, length, bin, d->window, first == 0, last)) {
                peak[peaks++] = place[first] + bin - crest;
            }
        }
        first = i + 1;
    }
    int64_t nearest = 0; /* a contact belongs to the nearest echo, the nearer to the scanner of two */
    first = 0;
    for (int64_t i = 0; i < p->count && peaks > 0; i++) {
        int64_t own = nearest;
        while (own + 1 < peaks && llabs(peak[own + 1] - place[i]) < llabs(peak[own] - place[i])) {
            own++;
        }
        if (own != nearest && i > first) {
            add_echo(p, first, i, sigma, NAN, found);
            first = i;
        }
        nearest = own;
    }
    if (peaks > 0) {
        add_echo(p, first, p->count, sigma, NAN, found);
    }
}

/* Sorts rows of one pulse by range, of those at the same range by row (Shell's sort). */
static void sort_rows(int64_t count, int64_t *row, const double *distance)
{
    static const int64_t gaps[] = {1750, 701, 301, 132, 57, 23, 10, 4, 1};
    for (int g = 0; g < 9; g++) {
        for (int64_t i = gaps[g]; i < count; i++) {
            int64_t moved = row[i];
            double at = distance[moved];
            int64_t j = i;
            for (; j >= gaps[g]; j -= gaps[g]) {
                int64_t other = row[j - gaps[g]];
                if (distance[other] < at || (distance[other] == at && other < moved)) {
                    break;
                }
                row[j] = other;
            }
            row[j] = moved;
        }
    }
}

int64_t find_echoes(int64_t count, const int64_t *order, const int64_t *ray, int64_t subrays,
                    const double *distance, const double *energy, const double *blur, double sigma,
                    int64_t bins, int64_t window, const double *shape, double bin, int64_t *rows,
                    double *room, int64_t *pulse, double *crest, double *total, double *width,
                    int64_t *contact)
{
    struct digitiser digitiser = {bins, window, shape, bin};
    struct echoes found = {0, pulse, contact, crest, total, width};
    int64_t *row = rows;
    int64_t *subray = rows + count;
    struct pulse p = {0, row, subray, room, room + count, room + 2 * count, room + 3 * count,
                      room + 4 * count, room + 5 * count};
    int64_t stop;
    for (int64_t first = 0; first < count; first = stop) {
        int64_t number = ray[order[first]] / subrays;
        int64_t base = number * subrays;
        p.count = 0;
        for (stop = first; stop < count && ray[order[stop]] < base + subrays; stop++) {
            if (energy[order[stop]] > 0) {
                row[p.count++] = order[stop];
            }
        }
        if (p.count == 0) {
            continue;
        }
        sort_rows(p.count, row, distance);
        for (int64_t i = 0; i < p.count; i++) {
            subray[i] = ray[row[i]] - base;
            p.at[i] = distance[row[i]];
            p.energy[i] = energy[row[i]];
            p.width[i] = blur[row[i]] > 0 ? hypot(sigma, blur[row[i]]) : sigma;
        }
        int64_t before = found.count;
        if (bins > 0) {
            add_digitised(&p, sigma, &digitiser, room + 6 * count, rows + 2 * count, rows + 3 * count, &found);
        } else {
            add_waveform(&p, sigma, &found);
        }
        for (int64_t n = before; n < found.count; n++) {
            pulse[n] = number;
        }
    }
    return found.count;
}
