/* Rays at a scene: into its box, eight at a time through Embree, and in float64 at what each met.
 *
 * Embree's coherent packets compute the same for a ray whether its neighbours go with it or not; only the
 * order in which it visits triangles differs. So that a hit is a function of its ray alone, a filter chooses
 * among triangles at one float32 distance by their numbers, and lets Embree go on a little behind the nearest.
 * Layouts are those of embree4/rtcore_ray.h and rtcore_common.h.
 */
#include <math.h>
#include <string.h>

#include "kernels.h"

enum { LANES = 8 };

/* Rows of RTCRayHit8: origin 0-2, direction 4-6, normal 12-14, u 15, v 16, and these. */
enum {
    TNEAR = 3,
    DIRECTION = 4,
    TIME = 7,
    TFAR = 8,
    MASK = 9,
    ID = 10,
    FLAGS = 11,
    GEOMETRY = 18,
    ROWS = 21
};
/* Rows of RTCHitN that the filter reads. */
enum { HIT_TRIANGLE = 5, HIT_INSTANCE = 7 };

#define NONE 0xFFFFFFFFu
#define COHERENT (1 << 16) /* RTCRayQueryFlags */
#define ASK_FILTER (1 << 1)
#define FAR 3e38         /* the longest way that float32 holds */
#define TINY 1e-30       /* stands for a direction's zero, so that there is no 0/0 */
#define SHORT 1e-200     /* squared lengths that can be taken as they are */
#define LONG 1e200
#define MARGIN 1e-3      /* metres before the limit where a search begins */
#define BEHIND 5e-7f     /* share of a distance that Embree goes on: four steps of a float32 */
#define TURN 0.25f       /* by how much directions differ at most of rays that go together, */
#define ASIDE 2.0f       /* and the places where they enter the scene, metres: wider ones are faster alone */

struct filter_call { /* RTCFilterFunctionNArguments */
    int *valid;
    void *user;
    void *context;
    float *ray;
    const uint32_t *hit;
    unsigned int count;
};

struct intersect_arguments { /* RTCIntersectArguments */
    int flags;
    unsigned int features;
    void *context;
    void (*filter)(const struct filter_call *call);
    void *intersect;
    float width;
};

struct lane { /* a ray on its way */
    int64_t number;
    const double *origin;
    double way[3];
    double near, far;
    int64_t left_instance, left_triangle;
    float exactly; /* up to this distance it is asked in float64 whether a hit counts */
    float depth;
    int64_t instance, triangle;
};

struct packet {
    uint32_t context[2]; /* RTCRayQueryContext: comes first, as it is what Embree is told */
    const struct cast_scene *scene;
    struct intersect_arguments arguments;
    int filled;
    float *rays; /* (ROWS, LANES), aligned */
    int *valid;  /* (LANES), aligned */
    struct lane lane[LANES];
    float room[(ROWS + 1) * LANES + 16];
};

static double dot(const double *a, const double *b)
{
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
}

static void set_row(float *rays, int row, int lane, uint32_t value)
{
    memcpy(rays + row * LANES + lane, &value, sizeof value);
}

/* Unit vector along a direction; 0 where that is zero or not finite. */
static int normalise(const double *direction, double *way)
{
    double square, length;
    memcpy(way, direction, 3 * sizeof *way);
    square = dot(way, way);
    if (!(square > SHORT && square < LONG)) {
        length = fmax(fmax(fabs(way[0]), fabs(way[1])), fabs(way[2]));
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
static double meet(const struct cast_scene *scene, const struct lane *ray, double *normal)
{
    const double *place = scene->transform + 12 * ray->instance;
    const int32_t *row = scene->triangle + 3 * (scene->first[ray->instance] + ray->triangle);
    double corner[3][3], u[3], v[3], foot[3], n[3];
    double at, second, third, distance, length;
    for (int k = 0; k < 3; k++) {
        int64_t vertex = 3 * (int64_t)row[k];
        double own[3];
        for (int a = 0; a < 3; a++)
            own[a] = scene->single ? scene->single[vertex + a] : scene->exact[vertex + a];
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
    distance = fmax(distance, at + fmin(fmin(second, third), 0.0));
    distance = fmin(distance, at + fmax(fmax(second, third), 0.0));
    length = sqrt(dot(n, n));
    for (int a = 0; a < 3; a++)
        normal[a] = n[a] / length;
    return distance;
}


static int counts(const struct lane *ray, double distance)
{
    return ray->left_instance < 0 ? distance >= ray->near : distance > ray->near;
}

static int counts_exactly(const struct cast_scene *scene, const struct lane *ray, int64_t instance, int64_t triangle)
{
    struct lane other = *ray;
    double normal[3];
    if (instance == ray->left_instance && triangle == ray->left_triangle)
        return 0;
    other.instance = instance;
    other.triangle = triangle;
    return counts(ray, meet(scene, &other, normal));
}

/* Embree asks of each triangle that a ray meets whether it is the nearest so far. */
static void choose(const struct filter_call *call)
{
    struct packet *packet = call->context;
    unsigned int count = call->count;
    for (unsigned int i = 0; i < count; i++) {
        int64_t instance = call->hit[HIT_INSTANCE * count + i], triangle = call->hit[HIT_TRIANGLE * count + i];
        float depth = call->ray[TFAR * count + i];
        struct lane *ray;
        uint32_t number;
        if (!call->valid[i])
            continue;
        memcpy(&number, call->ray + ID * count + i, sizeof number);
        ray = packet->lane + number;
        if (depth > ray->depth || (depth == ray->depth && (instance > ray->instance || (instance == ray->instance && triangle >= ray->triangle))) ||
            (depth < ray->exactly && !counts_exactly(packet->scene, ray, instance, triangle))) {
            call->valid[i] = 0;
            continue;
        }
        ray->depth = depth;
        ray->instance = instance;
        ray->triangle = triangle;
        call->ray[TFAR * count + i] = depth * (1.0f + BEHIND) + (float)TINY;
    }
}

/* Sets a ray into its lane, from where it enters the scene's box; 0 where it never does. */
static int enter(struct packet *packet, int lane)
{
    const struct cast_scene *scene = packet->scene;
    struct lane *ray = packet->lane + lane;
    double begin = ray->near - MARGIN, end = ray->far, reach;
    float *rays = packet->rays;
    for (int a = 0; a < 3; a++) {
        double slope = 1.0 / (fabs(ray->way[a]) < TINY ? TINY : ray->way[a]);
        double one = (scene->low[a] - ray->origin[a]) * slope;
        double other = (scene->high[a] - ray->origin[a]) * slope;
        begin = fmax(begin, fmin(one, other));
        end = fmin(end, fmax(one, other));
    }
    if (!(begin <= end))
        return 0;
    for (int a = 0; a < 3; a++) {
        rays[a * LANES + lane] = (float)(begin * ray->way[a] + ray->origin[a] - scene->centre[a]);
        rays[(DIRECTION + a) * LANES + lane] = (float)ray->way[a];
    }
    reach = (ray->far - begin) * (1.0 + 1e-6) + scene->slack;
    rays[TNEAR * LANES + lane] = 0.0f;
    rays[TIME * LANES + lane] = 0.0f;
    rays[TFAR * LANES + lane] = (float)fmin(reach, FAR);
    set_row(rays, MASK, lane, NONE);
    set_row(rays, ID, lane, (uint32_t)lane);
    set_row(rays, FLAGS, lane, 0);
    for (int row = GEOMETRY; row < ROWS; row++)
        set_row(rays, row, lane, NONE);
    ray->exactly = ray->left_instance < 0 ? (float)(ray->near - begin + MARGIN + scene->slack) : INFINITY;
    ray->depth = INFINITY;
    ray->instance = -1;
    ray->triangle = -1;
    return 1;
}

static int side_by_side(const struct packet *packet)
{
    for (int row = 0; row < DIRECTION + 3; row++) {
        const float *lane = packet->rays + row * LANES;
        float least = lane[0], most = lane[0];
        for (int k = 1; k < packet->filled; k++) {
            least = lane[k] < least ? lane[k] : least;
            most = lane[k] > most ? lane[k] : most;
        }
        if (!(most - least <= (row < TNEAR ? ASIDE : TURN)))
            return 0;
    }
    return 1;
}

/* Sends some lanes into the scene together. */
static void trace(struct packet *packet, int first, int last)
{
    for (int k = 0; k < LANES; k++)
        packet->valid[k] = k >= first && k < last ? -1 : 0;
    packet->scene->intersect(packet->valid, packet->scene->tree, packet->rays, &packet->arguments);
}

static void finish(struct packet *packet, double *distance, int64_t *instance, int64_t *triangle, double *normal)
{
    if (side_by_side(packet))
        trace(packet, 0, packet->filled);
    else
        for (int k = 0; k < packet->filled; k++)
            trace(packet, k, k + 1);
    for (int k = 0; k < packet->filled; k++) {
        struct lane *ray = packet->lane + k;
        double own[3], met;
        if (ray->instance < 0)
            continue;
        met = meet(packet->scene, ray, own);
        if (!counts(ray, met)) { /* too near, farther behind than float32 should be wrong */
            enter(packet, k);
            ray->exactly = INFINITY;
            trace(packet, k, k + 1);
            if (ray->instance < 0)
                continue;
            met = meet(packet->scene, ray, own);
        }
        if (met > ray->far)
            continue;
        distance[ray->number] = met;
        instance[ray->number] = ray->instance;
        triangle[ray->number] = ray->triangle;
        memcpy(normal + 3 * ray->number, own, sizeof own);
    }
    packet->filled = 0;
}

void cast_rays(const struct cast_scene *scene, int64_t count, const double *origin, const double *direction,
               const double *near, const double *far, const int64_t *left_instance,
               const int64_t *left_triangle, double *distance, int64_t *instance, int64_t *triangle,
               double *normal)
{
    struct packet packet;
    size_t offset;
    memset(&packet, 0, sizeof packet);
    offset = (64 - (uintptr_t)packet.room % 64) % 64 / sizeof(float);
    packet.context[0] = packet.context[1] = NONE;
    packet.scene = scene;
    packet.rays = packet.room + offset;
    packet.valid = (int *)(packet.rays + ROWS * LANES);
    packet.arguments.flags = COHERENT | ASK_FILTER;
    packet.arguments.features = NONE;
    packet.arguments.context = &packet;
    packet.arguments.filter = choose;
    for (int64_t i = 0; i < count; i++) {
        struct lane *ray = packet.lane + packet.filled;
        const double *from = origin + 3 * i;
        distance[i] = INFINITY;
        instance[i] = triangle[i] = -1;
        normal[3 * i] = normal[3 * i + 1] = normal[3 * i + 2] = NAN;
        ray->number = i;
        ray->origin = from;
        ray->near = near[i];
        ray->far = far[i];
        ray->left_instance = left_instance[i];
        ray->left_triangle = left_triangle[i];
        if (!(near[i] <= far[i]) || !isfinite(from[0] + from[1] + from[2]) || !normalise(direction + 3 * i, ray->way))
            continue;
        if (enter(&packet, packet.filled) && ++packet.filled == LANES)
            finish(&packet, distance, instance, triangle, normal);
    }
    if (packet.filled)
        finish(&packet, distance, instance, triangle, normal);
}
