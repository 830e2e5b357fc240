/* Rays at a scene: into its box, one by one through Embree, and in float64 at what each met.
 *
 * A hit is a function of its ray and its time alone. Embree's packets are not: beside other rays a ray that meets an edge
 * finds another face, and its coherent packets lose hits on flat boxes close before them.
 */
#include <math.h>
#include <string.h>

#include "kernels.h"

#define NONE 0xFFFFFFFFu
#define FAR 3e38     /* the longest way that float32 holds */
#define TINY 1e-30   /* stands for a direction's zero, so that there is no 0/0 */
#define SHORT 1e-200 /* squared lengths that can be taken as they are */
#define LONG 1e200
#define MARGIN 1e-3  /* metres before the limit where a search begins */
#define STEP 1e-6    /* metres: the first step behind what does not count; each is twice the one before */

struct ray_hit { /* RTCRayHit of embree4/rtcore_ray.h, which begins at multiples of 16 bytes */
    float origin[3], near, way[3], time, far;
    uint32_t mask, id, flags;
    float normal[3], u, v;
    uint32_t triangle, geometry, instance, of_array;
    uint32_t room[3];
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
    const double *from, *to;
    int64_t step;
    ray->triangle = sent->triangle;
    if (scene->steps == 0) {
        ray->instance = sent->instance;
        ray->place = scene->transform + 12 * ray->instance;
        return;
    }
    ray->instance = scene->piece[sent->of_array];
    step = (int64_t)larger(0.0, smaller(ray->knot, (double)(scene->steps - 2)));
    from = scene->transform + 12 * (step * scene->pieces + sent->of_array);
    to = from + 12 * scene->pieces;
    for (int k = 0; k < 12; k++)
        ray->there[k] = from[k] + (ray->knot - (double)step) * (to[k] - from[k]);
    ray->place = ray->there;
}

/* Sends a ray into the scene from a distance on; 0 where it meets nothing. */
static int trace(const struct cast_scene *scene, struct ray *ray, double begin, struct ray_hit *sent)
{
    double end = ray->far, reach;
    for (int a = 0; a < 3; a++) {
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
    reach = (ray->far - begin) * (1.0 + 1e-6) + scene->slack;
    sent->near = 0.0f;
    sent->time = scene->steps ? (float)(ray->knot / (double)(scene->steps - 1)) : 0.0f;
    sent->far = (float)smaller(reach, FAR);
    sent->mask = sent->geometry = sent->instance = NONE;
    scene->intersect(scene->tree, sent, NULL);
    if (sent->geometry == NONE)
        return 0;
    find(scene, ray, sent);
    return 1;
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
    char room[sizeof(struct ray_hit) + 16];
    struct ray_hit *sent = (struct ray_hit *)(room + (16 - (uintptr_t)room % 16) % 16);
    memset(sent, 0, sizeof *sent);
    for (int64_t i = 0; i < count; i++) {
        struct ray ray;
        double start, step = STEP, met = INFINITY, own[3];
        int found;
        ray.origin = origin + 3 * i;
        ray.near = near[i];
        ray.far = far[i];
        ray.knot = knot[i];
        ray.left_instance = left_instance[i];
        ray.left_triangle = left_triangle[i];
        start = ray.left_instance < 0 ? ray.near - MARGIN : ray.near;
        found = ray.near <= ray.far && isfinite(ray.origin[0] + ray.origin[1] + ray.origin[2]) &&
                normalise(direction + 3 * i, ray.way);
        while (found && (found = trace(scene, &ray, start, sent)) != 0) {
            met = meet(scene, &ray, own);
            if (counts(&ray, met))
                break;
            start = larger(met, start) + step;
            step *= 2.0;
        }
        found = found && met <= ray.far;
        distance[i] = found ? met : INFINITY;
        instance[i] = found ? ray.instance : -1;
        triangle[i] = found ? ray.triangle : -1;
        for (int a = 0; a < 3; a++)
            normal[3 * i + a] = found ? own[a] : NAN;
    }
}

void send_rays(intersect1 intersect, void *tree, int64_t count, float *rays, int64_t size)
{
    for (int64_t i = 0; i < count; i++)
        intersect(tree, rays + size * i, NULL);
}
