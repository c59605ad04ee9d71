/* The rays of sim/rays/single.py in C, equal to the last bit: same operations, same order, same names.
 *
 * That file is the specification and explains the method. This file does not use the Python API.
 */

#include "rays_seabed.h"

enum { NOTHING = -1, SEABED = 0 };
enum { SPHERE, CYLINDER, BOX, HALF_SPACE, MESH };
enum { MAX_WAITING = 128 };
#define FLAT 1e-30 /* greatest part of a direction that counts as parallel */

/* Into each version of such a function what it calls is to be inlined. */
#define INLINED static inline __attribute__((always_inline))

/* A function of this kind is also compiled for processors with wide registers. Its results are equal to the last bit. */
#if defined(__x86_64__) && defined(__GLIBC__) && defined(__GNUC__) && !defined(__clang__)
#define FOR_EACH_PROCESSOR __attribute__((target_clones("avx2", "default")))
#else
#define FOR_EACH_PROCESSOR
#endif

/* Rows of sim/rays/solids.py, nodes and groups of sim/rays/tree.py: all are doubles. */
typedef struct {
    double kind, reach, position[3], rotation[9], sizes[6], root;
} Solid;

enum { WIDTH = 4 };

/* Four doubles, and the result of comparing them: all bits of a number are set where it is true. */
typedef double Four __attribute__((vector_size(8 * WIDTH), aligned(8), may_alias));
typedef long long Mask __attribute__((vector_size(8 * WIDTH), aligned(8), may_alias));

typedef float FourFloats __attribute__((vector_size(4 * WIDTH), aligned(4), may_alias));

typedef struct {
    FourFloats low[3], high[3];
    float child[WIDTH];
} Node;

/* Triangles: a corner, and the edges from there. */
typedef struct {
    Four corner[3], one[3], other[3];
} Group;

typedef struct {
    Ground ground;
    const Solid *solids;
    long count;
    const Node *nodes;
    const Group *groups;
} Geometry;

/* The solids that rays from one origin can reach. */
typedef struct {
    long *numbers, count;
} Near;

typedef struct {
    double distance;
    long object, detail;
} Hit;

static void rotate_to_world(const double *r, const double *v, double *out)
{
    out[0] = r[0] * v[0] + r[1] * v[1] + r[2] * v[2];
    out[1] = r[3] * v[0] + r[4] * v[1] + r[5] * v[2];
    out[2] = r[6] * v[0] + r[7] * v[1] + r[8] * v[2];
}

static void rotate_to_solid(const double *r, const double *v, double *out)
{
    out[0] = r[0] * v[0] + r[3] * v[1] + r[6] * v[2];
    out[1] = r[1] * v[0] + r[4] * v[1] + r[7] * v[2];
    out[2] = r[2] * v[0] + r[5] * v[1] + r[8] * v[2];
}

/* --- solids */

static int is_beyond(const Solid *solid, const double *origin, double reach)
{
    double size = solid->reach, x = solid->position[0] - origin[0], y = solid->position[1] - origin[1];
    return x * x + y * y > (size + reach) * (size + reach);
}

/* Returns 1 if the ray misses a solid that is within reach. */
static int misses(const Solid *solid, const double *origin, const double *direction)
{
    double size = solid->reach, x = solid->position[0] - origin[0], y = solid->position[1] - origin[1];
    double dx = direction[0], dy = direction[1], across = dx * y - dy * x;
    return across * across > size * size * (dx * dx + dy * dy);
}

static double intersect_half_space(const double *sizes, const double *origin, const double *direction, double reach)
{
    double height = sizes[0] * origin[0] + sizes[1] * origin[1] + sizes[2] * origin[2] - sizes[3];
    if (height <= 0.0)
        return 0.0;
    double rate = sizes[0] * direction[0] + sizes[1] * direction[1] + sizes[2] * direction[2];
    double distance = rate < 0.0 ? -height / rate : INFINITY;
    return distance <= reach ? distance : INFINITY;
}

/* _round: a sphere (3 axes), or an endless cylinder (2). */
static void intersect_round(const double *at, const double *along, double radius, int axes, double *near, double *far)
{
    double a = along[0] * along[0] + along[1] * along[1], b = at[0] * along[0] + at[1] * along[1];
    double c = at[0] * at[0] + at[1] * at[1] - radius * radius;
    if (axes == 3)
        a = a + along[2] * along[2], b = b + at[2] * along[2], c = c + at[2] * at[2];
    double root = b * b - a * c;
    if (a <= TINY ? c > 0.0 : root < 0.0) {
        *near = INFINITY, *far = -INFINITY;
    } else if (a > TINY) {
        double half = sqrt(root);
        *near = max_of(*near, (-b - half) / a);
        *far = min_of(*far, (-b + half) / a);
    }
}

#pragma GCC diagnostic ignored "-Wpsabi" /* the functions that return a Four are all inlined */
INLINED Four choose(Mask mask, Four one, Four other)
{
    return (Four)(((Mask)one & mask) | ((Mask)other & ~mask));
}

/* The distances of four triangles, INFINITY for those that the ray misses. */
INLINED Four intersect_group(const Group *group, const double *at, const double *along)
{
    const Four *e = group->one, *f = group->other, none = {INFINITY, INFINITY, INFINITY, INFINITY};
    const double *d = along;
    Four px = d[1] * f[2] - d[2] * f[1], py = d[2] * f[0] - d[0] * f[2], pz = d[0] * f[1] - d[1] * f[0];
    Four inverse = 1.0 / (e[0] * px + e[1] * py + e[2] * pz); /* not finite for a determinant of 0: then `u` is not */
    Four tx = at[0] - group->corner[0], ty = at[1] - group->corner[1], tz = at[2] - group->corner[2];
    Four u = (tx * px + ty * py + tz * pz) * inverse;
    Four qx = ty * e[2] - tz * e[1], qy = tz * e[0] - tx * e[2], qz = tx * e[1] - ty * e[0];
    Four v = (d[0] * qx + d[1] * qy + d[2] * qz) * inverse;
    Four distance = (f[0] * qx + f[1] * qy + f[2] * qz) * inverse;
    return choose((u >= 0.0) & (u <= 1.0) & (v >= 0.0) & (u + v <= 1.0) & (distance >= 0.0), distance, none);
}

/* Returns 1 if the ray passes between the twines of a net, which run along the sides at the triangle's first corner. */
static int passes_net(const Group *group, int lane, const double *net, const double *at, const double *along, double distance)
{
    double away[3];
    for (int axis = 0; axis < 3; axis++)
        away[axis] = at[axis] + distance * along[axis] - group->corner[axis][lane];
    for (int side = 0; side < 2; side++) {
        const Four *e = side ? group->other : group->one;
        double x = e[0][lane], y = e[1][lane], z = e[2][lane], length = sqrt(x * x + y * y + z * z);
        double twines = (away[0] * x + away[1] * y + away[2] * z) / length / net[0];
        if (fabs(twines - floor(twines) - 0.5) >= 0.5 - 0.5 * net[1] / net[0])
            return 0;
    }
    return 1;
}

typedef struct {
    double near;
    long child;
} Waiting;

/* Adds the children of a node that the ray meets within `far` m to those that wait; the nearest is the last. */
INLINED long add_children(const Geometry *geometry, const Node *node, const double *at, const double *inverse, double far, Waiting *waiting)
{
    Four near = {0.0, 0.0, 0.0, 0.0}, end = near + far;
    for (int axis = 0; axis < 3; axis++) {
        const FourFloats *first_side = inverse[axis] < 0.0 ? node->high : node->low;
        const FourFloats *last_side = inverse[axis] < 0.0 ? node->low : node->high;
        Four first = (__builtin_convertvector(first_side[axis], Four) - at[axis]) * inverse[axis];
        Four last = (__builtin_convertvector(last_side[axis], Four) - at[axis]) * inverse[axis];
        near = choose(first > near, first, near), end = choose(last < end, last, end);
    }
    Mask is_met = near <= end;
    long count = 0;
    for (int i = 0; i < WIDTH; i++)
        if (is_met[i]) {
            long place = count++;
            for (; place > 0 && waiting[place - 1].near < near[i]; place--)
                waiting[place] = waiting[place - 1];
            const long child = (long)node->child[i];
            waiting[place] = (Waiting){near[i], child};
            const char *memory = child < 0 ? (const char *)(geometry->groups - 1 - child) : (const char *)(geometry->nodes + child);
            for (size_t place_in = 0; place_in < (child < 0 ? sizeof(Group) : sizeof(Node)); place_in += 64)
                __builtin_prefetch(memory + place_in); /* most of the time goes by waiting for memory */
        }
    return count;
}

FOR_EACH_PROCESSOR static double intersect_mesh(const Geometry *geometry, const Solid *solid, const double *at,
                                                const double *along, double reach, long *triangle_number)
{
    const double *net = solid->sizes;
    double best = INFINITY, inverse[3];
    for (int axis = 0; axis < 3; axis++)
        inverse[axis] = fabs(along[axis]) > FLAT ? 1.0 / along[axis] : 1.0 / FLAT;
    Waiting waiting[MAX_WAITING];
    long count = 0;
    waiting[count++] = (Waiting){0.0, (long)solid->root};
    while (count > 0) {
        const Waiting next = waiting[--count];
        if (next.near > min_of(reach, best))
            continue;
        if (next.child >= 0) {
            if (count <= MAX_WAITING - WIDTH)
                count += add_children(geometry, geometry->nodes + next.child, at, inverse, min_of(reach, best), waiting + count);
            continue;
        }
        const Group *group = geometry->groups + (-1 - next.child);
        Four distances = intersect_group(group, at, along);
        for (int i = 0; i < WIDTH; i++) {
            long number = WIDTH * (-1 - next.child) + i;
            if (distances[i] <= min_of(reach, best) && (distances[i] < best || number < *triangle_number)
                && !(net[0] > 0.0 && passes_net(group, i, net, at, along, distances[i])))
                best = distances[i], *triangle_number = number;
        }
    }
    return best;
}

static double intersect_solid(const Geometry *geometry, const Solid *solid, const double *origin, const double *direction,
                         double reach, long *detail)
{
    int kind = (int)solid->kind;
    const double *sizes = solid->sizes;
    *detail = 0;
    if (kind == HALF_SPACE)
        return intersect_half_space(sizes, origin, direction, reach);
    double away[3], at[3], along[3], near = 0.0, far = reach;
    for (int axis = 0; axis < 3; axis++)
        away[axis] = origin[axis] - solid->position[axis];
    rotate_to_solid(solid->rotation, away, at);
    rotate_to_solid(solid->rotation, direction, along);
    if (kind == MESH)
        return intersect_mesh(geometry, solid, at, along, reach, detail);
    if (kind == SPHERE) {
        intersect_round(at, along, sizes[0], 3, &near, &far);
    } else if (kind == CYLINDER) {
        intersect_round(at, along, sizes[0], 2, &near, &far);
        slab(at[2], along[2], 1.0 / along[2], sizes[1], sizes[2], &near, &far);
    } else {
        for (int axis = 0; axis < 3; axis++)
            slab(at[axis], along[axis], 1.0 / along[axis], sizes[2 * axis], sizes[2 * axis + 1], &near, &far);
    }
    return near <= far ? near : INFINITY;
}

/* Selects the solids within reach: in a world with many objects most are out of reach of all rays of a sensor. */
static void find_near_solids(const Geometry *geometry, const double *origin, double reach, Near *near)
{
    near->count = 0;
    for (long i = 0; i < geometry->count; i++)
        if (!is_beyond(geometry->solids + i, origin, reach))
            near->numbers[near->count++] = i;
}

/* The first hit of a ray that is known to meet no seabed before `start` m. */
static Hit trace(const Geometry *geometry, const Near *near, const double *origin, const double *direction, double reach,
                 double start)
{
    Hit best = {INFINITY, NOTHING, 0};
    best.distance = intersect_seabed(&geometry->ground, origin, direction, reach, start, &best.detail);
    if (best.distance < INFINITY)
        best.object = SEABED;
    for (long k = 0; k < near->count; k++) {
        long i = near->numbers[k];
        const Solid *solid = geometry->solids + i;
        if (misses(solid, origin, direction))
            continue;
        long detail;
        double distance = intersect_solid(geometry, solid, origin, direction, min_of(reach, best.distance), &detail);
        if (distance < best.distance)
            best = (Hit){distance, i + 1, detail};
    }
    return best;
}

/* The number of the object to which a solid belongs: its own number, unless it is a part of another object. */
static long owner(const Geometry *geometry, long object)
{
    const Solid *solid = geometry->solids + object - 1;
    return object > SEABED && solid->kind != MESH && solid->root != 0.0 ? (long)solid->root : object;
}

/* --- normals */

static void unit(double x, double y, double z, double *out)
{
    double length = sqrt(x * x + y * y + z * z);
    if (length > 0.0)
        set(out, x / length, y / length, z / length);
    else
        set(out, 0.0, 0.0, -1.0);
}

/* The outward normal at the nearest surface point of a solid without triangles, in the solid's axes. */
static void solid_normal(const Solid *solid, const double *at, double *out)
{
    const double *sizes = solid->sizes;
    if (solid->kind == SPHERE) {
        unit(at[0], at[1], at[2], out);
        return;
    }
    double least = INFINITY;
    if (solid->kind == BOX) {
        for (int face = 0; face < 6; face++) {
            double gap = fabs(at[face / 2] - sizes[face]);
            if (gap < least) {
                least = gap;
                set(out, 0.0, 0.0, 0.0);
                out[face / 2] = face % 2 ? 1.0 : -1.0;
            }
        }
        return;
    }
    least = fabs(sqrt(at[0] * at[0] + at[1] * at[1]) - sizes[0]);
    unit(at[0], at[1], 0.0, out);
    for (int end = 1; end < 3; end++) {
        double gap = fabs(at[2] - sizes[end]);
        if (gap < least)
            least = gap, set(out, 0.0, 0.0, end == 1 ? -1.0 : 1.0);
    }
}

static void triangle_normal(const Group *group, int lane, const double *along, double *out)
{
    double e[3], f[3];
    for (int axis = 0; axis < 3; axis++)
        e[axis] = group->one[axis][lane], f[axis] = group->other[axis][lane];
    unit(e[1] * f[2] - e[2] * f[1], e[2] * f[0] - e[0] * f[2], e[0] * f[1] - e[1] * f[0], out);
    if (out[0] * along[0] + out[1] * along[1] + out[2] * along[2] > 0.0)
        set(out, -out[0], -out[1], -out[2]);
}

static void normal(const Geometry *geometry, const Hit *hit, const double *direction, const double *point, double *out)
{
    if (hit->object == SEABED) {
        seabed_normal(&geometry->ground, hit->detail, direction, point, out);
        return;
    }
    const Solid *solid = geometry->solids + hit->object - 1;
    if (solid->kind == HALF_SPACE) {
        set(out, solid->sizes[0], solid->sizes[1], solid->sizes[2]);
        return;
    }
    double away[3], at[3], own[3];
    for (int axis = 0; axis < 3; axis++)
        away[axis] = point[axis] - solid->position[axis];
    rotate_to_solid(solid->rotation, solid->kind == MESH ? direction : away, at);
    if (solid->kind == MESH)
        triangle_normal(geometry->groups + hit->detail / WIDTH, (int)(hit->detail % WIDTH), at, own);
    else
        solid_normal(solid, at, own);
    rotate_to_world(solid->rotation, own, out);
}
