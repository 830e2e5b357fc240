/* Rays at a scene: into its box, through Embree, and in float64 at what each met.
 *
 * A hit is a function of its ray and its time alone. Embree's coherent packets of eight are twice as fast, but
 * - they round the planes of the pyramid about them past each other at boxes of instances that have no thickness:
 *   embree.py makes all of them thicker than that rounding;
 * - of triangles at one distance, at an edge or edge-on they may name another one than a ray alone does. Such a ray goes
 *   again, alone; a filter sees them, for which Embree searches a band behind what was met.
 * Within about 1 µm of an outline a ray may still meet a triangle alone, and not in a packet (docs/limits.md).
 */
#include <math.h>
#include <string.h>

#include "kernels.h"

#define NONE 0xFFFFFFFFu
#define FAR 3e38      /* the longest way that float32 holds */
#define TINY 1e-30    /* stands for a direction's zero, so that there is no 0/0 */
#define SHORT 1e-200  /* squared lengths that can be taken as they are */
#define LONG 1e200
#define MARGIN 1e-3   /* metres before the limit where a search begins */
#define STEP 1e-6     /* metres: the first step behind what does not count; each is twice the one before */
#define LANES 8       /* of a packet */
#define FIELDS 21     /* of four bytes in a ray_hit, without room; */
#define MET 17        /* from this on they say what was met */
#define FEW 3         /* rays, fewer of which are no faster together */
#define NARROW 1e-5   /* between the ways of a packet, along an axis, so that rounding does not close the pyramid */
#define WIDEST 0.1    /* the same */
#define CLOSE 1.0     /* metres between their origins */
#define SLANT 1e-3f   /* of each way along each axis, to one side: in a plane of two axes packets lose hits */
#define FILTERED (1 << 1)  /* RTCRayQueryFlags: the filter is asked, */
#define COHERENT (1 << 16) /* and one pyramid about all rays of a packet is searched */
#define BAND 8.0f     /* slacks behind a hit, within which another one makes it doubtful */
#define FLAT 1e-6     /* square of a cosine: nearer to its plane a ray's hit is doubtful */
#define EDGE 1e-3     /* of a triangle's height, within which of an edge a hit is doubtful */

struct ray_hit { /* RTCRayHit of embree4/rtcore_ray.h, which begins at multiples of 16 bytes */
    float origin[3], near, way[3], time, far;
    uint32_t mask, id, flags;
    float normal[3], u, v;
    uint32_t triangle, geometry, instance, of_array;
    uint32_t room[3];
};

struct context { /* RTCRayQueryContext, and what we keep of a packet */
    uint32_t instance, of_array;
    float band, best[LANES];
    int doubtful[LANES];
};

struct candidates { /* RTCFilterFunctionNArguments: some of the lanes of a packet, each at a triangle */
    int *valid;
    void *user;
    struct context *context;
    float *ray, *hit;
    unsigned int count;
};

struct arguments { /* RTCIntersectArguments */
    int flags, features;
    struct context *context;
    void (*filter)(const struct candidates *);
    void *intersect;
};

struct ray { /* on its way */
    const double *origin;
    double way[3];
    double near, far;
    int64_t left_instance, left_triangle;
    int64_t instance, triangle;
    double knot;
    const double *place; /* of what it met, kept here where that goes */
    double there[12];
};

/* Unit vector along a direction; 0 where that is zero or not finite. */
static int normalise(const double *direction, double *way)
{
    double square, length;
    memcpy(way, direction, 3 * sizeof *way);
    square = dot(way, way);
    if (!(square > SHORT && square < LONG)) {
        length = larger(larger(fabs(way[0]), fabs(way[1])), fabs(way[2]));
        for (int k = 0; k < 3; k++)
            way[k] /= length;
        square = dot(way, way);
    }
    length = sqrt(square);
    for (int k = 0; k < 3; k++)
        way[k] /= length;
    return fabs(way[0] + way[1] + way[2]) < 2.0;
}

/* Metres along a ray to the plane of a triangle, kept within those of its corners; and its unit normal. */
static double meet(const struct cast_scene *scene, const struct ray *ray, double *normal)
{
    const double *place = ray->place;
    const int32_t *row = scene->triangle[ray->instance] + 3 * ray->triangle;
    const void *vertices = scene->vertex[ray->instance];
    int single = scene->single[ray->instance];
    double corner[3][3], u[3], v[3], foot[3], n[3];
    double at, second, third, distance, length;
    for (int k = 0; k < 3; k++) {
        int64_t vertex = 3 * (int64_t)row[k];
        double own[3];
        for (int a = 0; a < 3; a++)
            own[a] = single ? ((const float *)vertices)[vertex + a] : ((const double *)vertices)[vertex + a];
        for (int a = 0; a < 3; a++)
            corner[k][a] = dot(place + 4 * a, own);
    }
    for (int a = 0; a < 3; a++) {
        u[a] = corner[1][a] - corner[0][a];
        v[a] = corner[2][a] - corner[0][a];
        foot[a] = place[4 * a + 3] - ray->origin[a] + corner[0][a];
    }
    n[0] = u[1] * v[2] - u[2] * v[1];
    n[1] = u[2] * v[0] - u[0] * v[2];
    n[2] = u[0] * v[1] - u[1] * v[0];
    at = dot(foot, ray->way);
    second = dot(u, ray->way);
    third = dot(v, ray->way);
    distance = dot(foot, n) / dot(ray->way, n);
    distance = larger(distance, at + smaller(smaller(second, third), 0.0));
    distance = smaller(distance, at + larger(larger(second, third), 0.0));
    length = sqrt(dot(n, n));
    for (int a = 0; a < 3; a++)
        normal[a] = n[a] / length;
    return distance;
}

/* Writes which instance was met, and where that is at the ray's time. */
static void find(const struct cast_scene *scene, struct ray *ray, const struct ray_hit *sent)
{
    int64_t step = (int64_t)larger(0.0, smaller(ray->knot, (double)(scene->steps - 2)));
    ray->triangle = sent->triangle;
    ray->instance = scene->steps ? scene->piece[sent->of_array] : sent->instance;
    ray->place = scene->steps ? ray->there : scene->transform + 12 * ray->instance;
    for (int k = 0; k < 12 && scene->steps; k++) {
        const double *from = scene->transform + 12 * (step * scene->pieces + sent->of_array) + k;
        ray->there[k] = *from + (ray->knot - (double)step) * (from[12 * scene->pieces] - *from);
    }
}

/* Readies a ray to be sent into the scene from a distance on; 0 where it passes by all. */
static int aim(const struct cast_scene *scene, const struct ray *ray, double begin, struct ray_hit *sent)
{
    double end = ray->far;
    int inside = 1; /* the box, which then does not limit where it begins */
    for (int a = 0; a < 3; a++)
        inside &= scene->low[a] <= ray->origin[a] && ray->origin[a] <= scene->high[a];
    for (int a = 0; a < 3 && !inside; a++) {
        double slope = 1.0 / (fabs(ray->way[a]) < TINY ? TINY : ray->way[a]);
        double one = (scene->low[a] - ray->origin[a]) * slope;
        double other = (scene->high[a] - ray->origin[a]) * slope;
        begin = larger(begin, smaller(one, other));
        end = smaller(end, larger(one, other));
    }
    if (!(begin <= end))
        return 0;
    for (int a = 0; a < 3; a++) {
        sent->origin[a] = (float)(begin * ray->way[a] + ray->origin[a] - scene->centre[a]);
        sent->way[a] = (float)ray->way[a];
    }
    sent->near = 0.0f;
    sent->time = scene->steps ? (float)(ray->knot / (double)(scene->steps - 1)) : 0.0f;
    sent->far = (float)smaller((ray->far - begin) * (1.0 + 1e-6) + scene->slack, FAR);
    sent->mask = sent->geometry = sent->instance = NONE;
    return 1;
}

/* Keeps the first triangle of each lane, and lets Embree search a band behind it for one as near. */
static void keep(const struct candidates *met)
{
    struct context *context = met->context;
    unsigned int count = met->count;
    for (unsigned int i = 0; i < count; i++) {
        const float *way = met->ray + 4 * count + i, *hit = met->hit + i;
        float *far = met->ray + 8 * count + i;
        double along = 0.0, n = 0.0, w = 0.0, u = hit[3 * count], v = hit[4 * count];
        uint32_t lane;
        if (!met->valid[i])
            continue;
        memcpy(&lane, met->ray + 10 * count + i, sizeof lane);
        for (unsigned int a = 0; a < 3 * count; a += count) {
            along += (double)way[a] * hit[a];
            n += (double)hit[a] * hit[a];
            w += (double)way[a] * way[a];
        }
        if (*far < context->best[lane]) {
            context->doubtful[lane] = context->best[lane] <= *far + context->band ||
                                      !(smaller(smaller(u, v), 1.0 - u - v) > EDGE) || !(along * along > FLAT * n * w);
            context->best[lane] = *far;
            *far += context->band;
        } else {
            context->doubtful[lane] = 1;
            met->valid[i] = 0;
        }
    }
}

/* Sends up to eight rays that are ready: those that begin near the first as a packet, which is coherent where three go
 * side by side, and then of these alone; one by one the others and the doubtful. */
static void send(const struct cast_scene *scene, struct ray_hit *sent, const int *ready)
{
    enum { ALONE, NEAR, BESIDE } kind[LANES], sort;
    char room[4 * LANES * (FIELDS + 1) + 32];
    float *packet = (float *)(room + (32 - (uintptr_t)room % 32) % 32);
    int *valid = (int *)(packet + LANES * FIELDS);
    struct context context = {NONE, NONE, BAND * (float)scene->slack, {0.0f}, {0}};
    struct arguments arguments = {FILTERED, -1, &context, keep, NULL};
    double widest = 0.0;
    int first = 0, many[BESIDE + 1] = {0};
    while (first < LANES - 1 && !ready[first])
        first++;
    for (int k = 0; k < LANES; k++) {
        double angle = 0.0, step = 0.0;
        int slants = 1;
        for (int a = 0; a < 3; a++) {
            float one = sent[first].way[a], other = sent[k].way[a];
            angle = larger(angle, fabsf(other - one));
            step = larger(step, fabsf(sent[k].origin[a] - sent[first].origin[a]));
            slants = slants && other * (one < 0.0f ? -1.0f : 1.0f) > SLANT;
        }
        kind[k] = !(ready[k] && step < CLOSE) ? ALONE : slants && angle < WIDEST ? BESIDE : NEAR;
        many[kind[k]]++;
        widest = kind[k] == BESIDE ? larger(widest, angle) : widest;
        context.best[k] = INFINITY;
        sent[k].id = (uint32_t)k;
    }
    sort = many[BESIDE] >= FEW && widest > NARROW ? BESIDE : many[NEAR] + many[BESIDE] >= FEW ? NEAR : ALONE;
    if (scene->intersect8 == NULL || scene->steps)
        sort = ALONE;
    if (sort == BESIDE)
        arguments.flags |= COHERENT;
    for (int k = 0; k < LANES && sort; k++) {
        valid[k] = -(kind[k] >= sort);
        for (int n = 0; n < FIELDS; n++)
            memcpy(packet + LANES * n + k, (float *)&sent[k] + n, sizeof *packet);
    }
    if (sort)
        scene->intersect8(valid, scene->tree, packet, &arguments);
    for (int k = 0; k < LANES; k++)
        if (sort && valid[k] && !context.doubtful[k])
            for (int n = MET; n < FIELDS; n++)
                memcpy((float *)&sent[k] + n, packet + LANES * n + k, sizeof *packet);
        else if (ready[k])
            scene->intersect(scene->tree, sent + k, NULL);
}

static int counts(const struct ray *ray, double distance)
{
    if (ray->left_instance < 0)
        return distance >= ray->near;
    return distance > ray->near && !(ray->instance == ray->left_instance && ray->triangle == ray->left_triangle);
}

void cast_rays(const struct cast_scene *scene, int64_t count, const double *origin,
               const double *direction, const double *near, const double *far, const double *knot,
               const int64_t *left_instance, const int64_t *left_triangle, double *distance,
               int64_t *instance, int64_t *triangle, double *normal)
{
    char room[sizeof(struct ray_hit) * LANES + 16];
    struct ray_hit *sent = (struct ray_hit *)(room + (16 - (uintptr_t)room % 16) % 16);
    memset(sent, 0, sizeof *sent * LANES);
    for (int64_t from = 0; from < count; from += LANES) {
        struct ray rays[LANES];
        int ready[LANES];
        for (int k = 0; k < LANES; k++) {
            struct ray *ray = rays + k;
            int64_t i = from + k;
            ready[k] = i < count;
            if (!ready[k])
                continue;
            ray->origin = origin + 3 * i;
            ray->near = near[i];
            ray->far = far[i];
            ray->knot = knot[i];
            ray->left_instance = left_instance[i];
            ray->left_triangle = left_triangle[i];
            ready[k] = ray->near <= ray->far && isfinite(ray->origin[0] + ray->origin[1] + ray->origin[2]) &&
                       normalise(direction + 3 * i, ray->way) &&
                       aim(scene, ray, ray->left_instance < 0 ? ray->near - MARGIN : ray->near, sent + k);
        }
        send(scene, sent, ready);
        for (int64_t i = from; i < count && i < from + LANES; i++) {
            struct ray *ray = rays + (i - from);
            struct ray_hit *hit = sent + (i - from);
            double start = ray->left_instance < 0 ? ray->near - MARGIN : ray->near;
            double step = STEP, met = INFINITY, own[3];
            int found = ready[i - from];
            while (found && (found = hit->geometry != NONE) != 0) {
                find(scene, ray, hit);
                met = meet(scene, ray, own);
                if (counts(ray, met))
                    break;
                start = larger(met, start) + step;
                step *= 2.0;
                found = aim(scene, ray, start, hit);
                if (found)
                    scene->intersect(scene->tree, hit, NULL);
            }
            found = found && met <= ray->far;
            distance[i] = found ? met : INFINITY;
            instance[i] = found ? ray->instance : -1;
            triangle[i] = found ? ray->triangle : -1;
            for (int a = 0; a < 3; a++)
                normal[3 * i + a] = found ? own[a] : NAN;
        }
    }
}

void send_rays(intersect1 intersect, void *tree, int64_t count, float *rays, int64_t size)
{
    for (int64_t i = 0; i < count; i++)
        intersect(tree, rays + size * i, NULL);
}
