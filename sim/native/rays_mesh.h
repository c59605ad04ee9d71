/* Rays on the triangles of sim/rays/tree.py: _intersect_mesh of sim/rays/single.py, equal to the last bit.
 *
 * Boxes and triangles are first compared in floats, with margins so that no hit is lost, and what remains in doubles.
 * This file is included after rays_seabed.h, and does not use the Python API.
 */

#include <stdint.h>

enum { MAX_WAITING = 256 };
#define FLAT 1e-30 /* greatest part of a direction that counts as parallel */
#define ROUNDING 3e-7 /* more than the roundings of floats add up to */

/* Into each version of such a function what it calls is to be inlined. */
#define INLINED static inline __attribute__((always_inline))

/* A function of this kind is also compiled for processors with wide registers. Its results are equal to the last bit. */
#if defined(__x86_64__) && defined(__GLIBC__) && defined(__GNUC__) && !defined(__clang__)
#define FOR_EACH_PROCESSOR __attribute__((target_clones("avx2", "default")))
#else
#define FOR_EACH_PROCESSOR
#endif

enum { WIDTH = 8 };

/* Eight floats, and the result of comparing them: all bits of a number are set where it is true. */
typedef float Floats __attribute__((vector_size(4 * WIDTH), aligned(4), may_alias));
typedef int32_t Mask __attribute__((vector_size(4 * WIDTH), aligned(4), may_alias));

typedef struct {
    Floats sides[6]; /* the least x, y, z of each child, then the greatest */
    float child[WIDTH];
} Node;

/* A triangle: a corner, and the edges from there. */
typedef struct {
    double corner[3], one[3], other[3];
} Triangle;

/* Eight triangles, and the same rounded to floats. Where a ray starts `away` m from the origin, the rounding of what
 * find_candidates compares is less than margin * (away + extent). */
typedef struct {
    Triangle triangles[WIDTH];
    Floats corner[3], one[3], other[3];
    float margin, extent;
} Group;

/* The trees of several meshes. */
typedef struct {
    const Node *nodes;
    const Group *groups;
} Trees;

/* The distance to a triangle, INFINITY if the ray misses it. */
static double intersect_triangle(const Triangle *triangle, const double *at, const double *d)
{
    const double *e = triangle->one, *f = triangle->other;
    double px = d[1] * f[2] - d[2] * f[1], py = d[2] * f[0] - d[0] * f[2], pz = d[0] * f[1] - d[1] * f[0];
    double inverse = 1.0 / (e[0] * px + e[1] * py + e[2] * pz); /* not finite for a determinant of 0: then `u` is not */
    double tx = at[0] - triangle->corner[0], ty = at[1] - triangle->corner[1], tz = at[2] - triangle->corner[2];
    double u = (tx * px + ty * py + tz * pz) * inverse;
    double qx = ty * e[2] - tz * e[1], qy = tz * e[0] - tx * e[2], qz = tx * e[1] - ty * e[0];
    double v = (d[0] * qx + d[1] * qy + d[2] * qz) * inverse;
    double distance = (f[0] * qx + f[1] * qy + f[2] * qz) * inverse;
    return u >= 0.0 && u <= 1.0 && v >= 0.0 && u + v <= 1.0 && distance >= 0.0 ? distance : INFINITY;
}

/* Returns 1 if the ray passes between the twines of a net, which run along the sides at the triangle's first corner. */
static int passes_net(const Triangle *triangle, const double *net, const double *at, const double *along, double distance)
{
    double away[3];
    for (int axis = 0; axis < 3; axis++)
        away[axis] = at[axis] + distance * along[axis] - triangle->corner[axis];
    for (int side = 0; side < 2; side++) {
        const double *e = side ? triangle->other : triangle->one;
        double x = e[0], y = e[1], z = e[2], length = sqrt(x * x + y * y + z * z);
        double twines = (away[0] * x + away[1] * y + away[2] * z) / length / net[0];
        if (fabs(twines - floor(twines) - 0.5) >= 0.5 - 0.5 * net[1] / net[0])
            return 0;
    }
    return 1;
}

/* A ray in floats. It enters each box a little earlier, and leaves it a little later, than rounding could make it. */
typedef struct {
    float from[6], inverse[6]; /* for the sides where it enters (3), then for those where it leaves */
    size_t side[6];            /* places of those sides in a node, in bytes */
    float at[3], along[3], away;
} Beam;

typedef struct {
    float near;
    uint32_t place; /* WIDTH times the node, and the lane */
    long child;
} Waiting;

INLINED Beam make_beam(const double *at, const double *along, const double *inverse)
{
    Beam beam;
    beam.away = 0.0f;
    for (size_t axis = 0; axis < 3; axis++) {
        const double margin = ROUNDING * fabs(at[axis]), later = inverse[axis] < 0.0 ? -margin : margin;
        const size_t turned = inverse[axis] < 0.0 ? 3 : 0;
        beam.side[axis] = (axis + turned) * sizeof(Floats), beam.side[3 + axis] = (3 + axis - turned) * sizeof(Floats);
        beam.from[axis] = (float)(at[axis] + later), beam.from[3 + axis] = (float)(at[axis] - later);
        beam.inverse[axis] = (float)(inverse[axis] * (1.0 - ROUNDING));
        beam.inverse[3 + axis] = (float)(inverse[axis] * (1.0 + ROUNDING));
        beam.at[axis] = (float)at[axis], beam.along[axis] = (float)along[axis];
        beam.away += fabsf(beam.at[axis]);
    }
    return beam;
}

#pragma GCC diagnostic ignored "-Wpsabi" /* the functions that take vectors are all inlined */
/* One bit for each lane. */
INLINED unsigned lanes_of(Mask mask)
{
#ifdef __SSE__
    typedef float Half __attribute__((vector_size(16), aligned(4), may_alias));
    const Half low = *(const Half *)&mask, high = *((const Half *)&mask + 1);
    return (unsigned)(__builtin_ia32_movmskps(low) | __builtin_ia32_movmskps(high) << 4);
#else
    typedef uint64_t Pairs __attribute__((vector_size(4 * WIDTH)));
    const Mask lane = {1, 2, 4, 8, 16, 32, 64, 128};
    const Pairs pairs = (Pairs)(mask & lane);
    const uint64_t all = pairs[0] | pairs[1] | pairs[2] | pairs[3];
    return (unsigned)(all | all >> 32);
#endif
}

/* The lanes of the triangles that the ray may hit: those that it surely misses are excluded. */
INLINED unsigned find_candidates(const Group *group, const Beam *beam)
{
    const Floats *e = group->one, *f = group->other;
    const float *d = beam->along, margin = group->margin * (beam->away + group->extent);
    Floats px = d[1] * f[2] - d[2] * f[1], py = d[2] * f[0] - d[0] * f[2], pz = d[0] * f[1] - d[1] * f[0];
    Floats determinant = e[0] * px + e[1] * py + e[2] * pz;
    Floats tx = beam->at[0] - group->corner[0], ty = beam->at[1] - group->corner[1], tz = beam->at[2] - group->corner[2];
    Floats qx = ty * e[2] - tz * e[1], qy = tz * e[0] - tx * e[2], qz = tx * e[1] - ty * e[0];
    const Mask sign = (Mask)determinant & INT32_MIN;
    Floats u = (Floats)((Mask)(tx * px + ty * py + tz * pz) ^ sign);
    Floats v = (Floats)((Mask)(d[0] * qx + d[1] * qy + d[2] * qz) ^ sign);
    Floats rest = (Floats)((Mask)determinant ^ sign) - u - v;
    return lanes_of((u >= -margin) & (v >= -margin) & (rest >= -3.0f * margin));
}

/* Returns 1 if `distance` along a ray is in the box of a child. Rounding can move the hit of a triangle that is seen
 * from its edge out of it. */
static int is_in_box(const Node *node, unsigned lane, const double *at, const double *inverse, double distance)
{
    for (int axis = 0; axis < 3; axis++) {
        double one = ((double)node->sides[axis][lane] - at[axis]) * inverse[axis];
        double other = ((double)node->sides[3 + axis][lane] - at[axis]) * inverse[axis];
        if (distance < min_of(one, other) || distance > max_of(one, other))
            return 0;
    }
    return 1;
}

/* Adds the children of a node that the ray meets within `far` m to those that wait; the nearest is the last. */
INLINED long add_children(const Trees *trees, long number, const Beam *beam, float far, Waiting *waiting)
{
    const Node *node = trees->nodes + number;
    const float *sides[6], *from = beam->from, *inverse = beam->inverse;
    for (int i = 0; i < 6; i++)
        sides[i] = (const float *)((const char *)node + beam->side[i]);
    float near[WIDTH], end[WIDTH];
    for (int i = 0; i < WIDTH; i++) { /* with no other functions, so that the compiler makes vectors of it */
        near[i] = 0.0f, end[i] = far;
        for (int axis = 0; axis < 3; axis++) {
            const float first = (sides[axis][i] - from[axis]) * inverse[axis];
            const float last = (sides[3 + axis][i] - from[3 + axis]) * inverse[3 + axis];
            near[i] = first > near[i] ? first : near[i], end[i] = last < end[i] ? last : end[i];
        }
    }
    long count = 0;
    for (unsigned met = lanes_of(*(const Floats *)near <= *(const Floats *)end); met; met &= met - 1) {
        const unsigned i = (unsigned)__builtin_ctz(met);
        long place = count++;
        for (; place > 0 && waiting[place - 1].near < near[i]; place--)
            waiting[place] = waiting[place - 1];
        const long child = (long)node->child[i];
        waiting[place] = (Waiting){near[i], WIDTH * (uint32_t)number + i, child};
        const char *memory = child < 0 ? (const char *)(trees->groups - 1 - child) : (const char *)(trees->nodes + child);
        for (size_t place_in = 0; place_in < (child < 0 ? sizeof(Group) : sizeof(Node)); place_in += 64)
            __builtin_prefetch(memory + place_in); /* most of the time goes by waiting for memory */
    }
    return count;
}

/* The distance to the mesh whose tree begins at node `root`, and the number of the triangle. */
FOR_EACH_PROCESSOR static double intersect_mesh(const Trees *trees, long root, const double *net, const double *at,
                                                const double *along, double reach, long *triangle_number)
{
    double best = INFINITY, inverse[3];
    for (int axis = 0; axis < 3; axis++)
        inverse[axis] = fabs(along[axis]) > FLAT ? 1.0 / along[axis] : 1.0 / FLAT;
    const Beam beam = make_beam(at, along, inverse);
    float far = (float)(reach * (1.0 + ROUNDING));
    Waiting waiting[MAX_WAITING];
    long count = add_children(trees, root, &beam, far, waiting);
    while (count > 0) {
        const Waiting next = waiting[--count];
        if (next.near > far)
            continue;
        if (next.child >= 0) {
            if (count <= MAX_WAITING - WIDTH)
                count += add_children(trees, next.child, &beam, far, waiting + count);
            continue;
        }
        const Group *group = trees->groups - 1 - next.child;
        for (unsigned found = find_candidates(group, &beam); found; found &= found - 1) {
            const int lane = __builtin_ctz(found);
            const long number = WIDTH * (-1 - next.child) + lane;
            const Triangle *triangle = group->triangles + lane;
            const double distance = intersect_triangle(triangle, at, along);
            if (distance <= min_of(reach, best) && (distance < best || number < *triangle_number)
                && is_in_box(trees->nodes + next.place / WIDTH, next.place % WIDTH, at, inverse, distance)
                && !(net[0] > 0.0 && passes_net(triangle, net, at, along, distance)))
                best = distance, *triangle_number = number, far = (float)(best * (1.0 + ROUNDING));
        }
    }
    return best;
}
