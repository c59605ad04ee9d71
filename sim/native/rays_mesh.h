/* Rays on the triangles of sim/rays/tree.py: _intersect_mesh of sim/rays/single.py, equal to the last bit.
 *
 * Boxes and triangles are first compared in floats, with margins so that no hit is lost, and what remains in doubles. The
 * rays of a bundle begin with the subtrees that some of them can meet, and take their steps in turn: the memory that one
 * needs comes while the others go on.
 * This file is included after rays_seabed.h, and does not use the Python API.
 */

#include <stdint.h>

enum { MAX_WAITING = 256, BUNDLE = 32, FEW_RAYS = 8 };
#define FLAT 1e-30 /* greatest part of a direction that counts as parallel */
#define ROUNDING 5e-7 /* more than the roundings of floats add up to */

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
    Floats corner[3], one[3], other[3];
    float margin, extent;
    Triangle triangles[WIDTH];
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

/* A ray in a mesh's axes, and its hit. */
typedef struct {
    double along[3], reach, distance;
    long triangle;
} MeshRay;

/* Where rays begin. */
typedef struct {
    const Trees *trees;
    const double *at, *net;
    float point[3], margin[3], away;
} Source;

typedef struct {
    float near;
    int32_t child;
    const float *box; /* the first of its sides */
} Waiting;

/* A ray, or several, on the way through a tree, in floats. It enters each box a little earlier, and leaves it a little
 * later, than rounding could make it. */
typedef struct {
    float from[6], inverse[6]; /* for the sides where it enters (3), then for those where it leaves */
    int side[6];               /* numbers of those sides */
    float along[3], far;
    MeshRay *ray;
    long count;
    Waiting waiting[MAX_WAITING];
} Search;

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
INLINED unsigned find_candidates(const Group *group, const Source *source, const float *d)
{
    const Floats *e = group->one, *f = group->other;
    const float *at = source->point, margin = group->margin * (source->away + group->extent);
    Floats px = d[1] * f[2] - d[2] * f[1], py = d[2] * f[0] - d[0] * f[2], pz = d[0] * f[1] - d[1] * f[0];
    Floats determinant = e[0] * px + e[1] * py + e[2] * pz;
    Floats tx = at[0] - group->corner[0], ty = at[1] - group->corner[1], tz = at[2] - group->corner[2];
    Floats qx = ty * e[2] - tz * e[1], qy = tz * e[0] - tx * e[2], qz = tx * e[1] - ty * e[0];
    const Mask sign = (Mask)determinant & INT32_MIN;
    Floats u = (Floats)((Mask)(tx * px + ty * py + tz * pz) ^ sign);
    Floats v = (Floats)((Mask)(d[0] * qx + d[1] * qy + d[2] * qz) ^ sign);
    Floats rest = (Floats)((Mask)determinant ^ sign) - u - v;
    return lanes_of((u >= -margin) & (v >= -margin) & (rest >= -3.0f * margin));
}

/* Returns 1 if `distance` along a ray is in a box. Rounding can move the hit of a triangle that is seen from its edge
 * out of it. */
static int is_in_box(const float *box, const double *at, const double *along, double distance)
{
    for (int axis = 0; axis < 3; axis++) {
        const double inverse = fabs(along[axis]) > FLAT ? 1.0 / along[axis] : 1.0 / FLAT;
        double one = ((double)box[WIDTH * axis] - at[axis]) * inverse;
        double other = ((double)box[WIDTH * (3 + axis)] - at[axis]) * inverse;
        if (distance < min_of(one, other) || distance > max_of(one, other))
            return 0;
    }
    return 1;
}

/* Adds the children of a node that the ray meets to those that wait; the nearest is the last. */
INLINED void add_children(const Trees *trees, const Node *node, Search *search)
{
    float near[WIDTH], end[WIDTH];
    for (int i = 0; i < WIDTH; i++) { /* with no other functions, so that the compiler makes vectors of it */
        near[i] = 0.0f, end[i] = search->far;
        for (int axis = 0; axis < 3; axis++) {
            const float *enter = (const float *)(node->sides + search->side[axis]);
            const float *leave = (const float *)(node->sides + search->side[3 + axis]);
            const float first = (enter[i] - search->from[axis]) * search->inverse[axis];
            const float last = (leave[i] - search->from[3 + axis]) * search->inverse[3 + axis];
            near[i] = first > near[i] ? first : near[i], end[i] = last < end[i] ? last : end[i];
        }
    }
    Waiting *waiting = search->waiting + search->count;
    long count = 0;
    for (unsigned met = lanes_of(*(const Floats *)near <= *(const Floats *)end); met; met &= met - 1) {
        const unsigned i = (unsigned)__builtin_ctz(met);
        long place = count++;
        for (; place > 0 && waiting[place - 1].near < near[i]; place--)
            waiting[place] = waiting[place - 1];
        const int32_t child = (int32_t)node->child[i];
        waiting[place] = (Waiting){near[i], child, (const float *)node + i};
        for (int line = 0; line < 4 && child > 0; line++)
            __builtin_prefetch((const char *)(trees->nodes + child) + 64 * line);
    }
    search->count += count;
}

/* Prefetches what the ray meets next, which then is the first beyond those that wait; returns 0 if there is nothing. */
INLINED int find_next(const Trees *trees, Search *search)
{
    while (search->count > 0) {
        const Waiting *next = search->waiting + --search->count;
        if (next->near > search->far)
            continue;
        if (next->child < 0) {
            const char *memory = (const char *)(trees->groups - 1 - next->child);
#pragma GCC unroll 16
            for (size_t place = 0; place < sizeof(Group); place += 64)
                __builtin_prefetch(memory + place);
        }
        return 1;
    }
    return 0;
}

/* Tests the triangles of the group that the ray has met. */
INLINED void intersect_group(const Source *source, Search *search)
{
    const Waiting next = search->waiting[search->count];
    const Group *group = source->trees->groups - 1 - next.child;
    MeshRay *ray = search->ray;
    for (unsigned found = find_candidates(group, source, search->along); found; found &= found - 1) {
        const int lane = __builtin_ctz(found);
        const long number = WIDTH * (-1 - (long)next.child) + lane;
        const Triangle *triangle = group->triangles + lane;
        const double distance = intersect_triangle(triangle, source->at, ray->along);
        if (distance <= min_of(ray->reach, ray->distance) && (distance < ray->distance || number < ray->triangle)
            && is_in_box(next.box, source->at, ray->along, distance)
            && !(source->net[0] > 0.0 && passes_net(triangle, source->net, source->at, ray->along, distance)))
            ray->distance = distance, ray->triangle = number, search->far = (float)(distance * (1.0 + ROUNDING));
    }
}

/* Sets a ray out on its way. */
static void set_out(const Source *source, MeshRay *ray, Search *search)
{
    for (int axis = 0; axis < 3; axis++) {
        const float along = (float)ray->along[axis], inverse = 1.0f / (fabsf(along) > (float)FLAT ? along : (float)FLAT);
        const float later = copysignf(source->margin[axis], inverse);
        const int turned = inverse < 0.0f ? 3 : 0;
        search->along[axis] = along;
        search->side[axis] = axis + turned, search->side[3 + axis] = axis + 3 - turned;
        search->from[axis] = source->point[axis] + later, search->from[3 + axis] = source->point[axis] - later;
        search->inverse[axis] = inverse * (float)(1.0 - ROUNDING);
        search->inverse[3 + axis] = inverse * (float)(1.0 + ROUNDING);
    }
    search->far = (float)(ray->reach * (1.0 + ROUNDING)), search->ray = ray, search->count = 0;
    ray->distance = INFINITY;
}

/* Sets `all` out so that it is in each box from where the first of the rays enters it to where the last one leaves it;
 * returns 0 for rays that go both ways along several axes. */
static int set_all_out(const Source *source, const MeshRay *rays, int count, Search *all)
{
    MeshRay fast = rays[0], slow = rays[0];
    Search last;
    int mixed = 0;
    for (int axis = 0; axis < 3; axis++) {
        double low = INFINITY, high = -INFINITY;
        for (int i = 0; i < count; i++) {
            low = min_of(low, rays[i].along[axis]), high = max_of(high, rays[i].along[axis]);
            fast.reach = max_of(fast.reach, rays[i].reach);
        }
        fast.along[axis] = -low > high ? low : high, slow.along[axis] = -low > high ? high : low;
    }
    set_out(source, &fast, all), set_out(source, &slow, &last);
    for (int axis = 0; axis < 3; axis++) {
        all->inverse[3 + axis] = last.inverse[3 + axis];
        if (last.side[axis] != all->side[axis]) { /* they go both ways: the axis excludes nothing */
            all->inverse[3 + axis] = all->inverse[axis], all->from[axis] = copysignf(INFINITY, all->inverse[axis]);
            all->from[3 + axis] = -all->from[axis], mixed++;
        }
    }
    return mixed < 2;
}

/* Makes a node of the subtrees, WIDTH at most, that `all` meets. */
INLINED void find_subtrees(const Trees *trees, const Node *root, Search *all, Node *subtrees)
{
    add_children(trees, root, all);
    for (long place = all->count - 1; place >= 0;) { /* the nearest first */
        const long count = all->count, child = all->waiting[place].child;
        if (child > 0)
            add_children(trees, trees->nodes + child, all);
        if (child < 0 || all->count > WIDTH + 1)
            all->count = count, place--;
        else
            all->waiting[place] = all->waiting[--all->count], place -= place == all->count;
    }
    for (int row = 0; row < 7; row++)
        for (int lane = 0; lane < WIDTH; lane++)
            ((float *)subtrees)[WIDTH * row + lane] =
                lane < all->count ? all->waiting[lane].box[WIDTH * row] : row < 3 ? INFINITY : -INFINITY;
}

/* Finds the hits of up to BUNDLE rays from one point on the mesh whose tree begins at node `root`. */
FOR_EACH_PROCESSOR static void intersect_mesh(const Trees *trees, long root, const double *net, const double *at,
                                              MeshRay *rays, int count)
{
    Search searches[BUNDLE], all;
    Source source = {.trees = trees, .at = at, .net = net};
    Node subtrees;
    const Node *first = trees->nodes + root;
    int open[BUNDLE], active = 0;
    for (int axis = 0; axis < 3; axis++) {
        source.point[axis] = (float)at[axis], source.margin[axis] = (float)(ROUNDING * fabs(at[axis]));
        source.away += fabsf(source.point[axis]);
    }
    for (int i = 0; i < count; i++)
        set_out(&source, rays + i, searches + i);
    if (count >= FEW_RAYS && set_all_out(&source, rays, count, &all))
        find_subtrees(trees, first, &all, &subtrees), first = &subtrees;
    for (int i = 0; i < count; i++) {
        add_children(trees, first, searches + i);
        if (find_next(trees, searches + i))
            open[active++] = i;
    }
    for (int left = 0; active > 0; active = left, left = 0)
        for (int i = 0; i < active; i++) {
            Search *search = searches + open[i];
            const long child = search->waiting[search->count].child;
            if (child < 0)
                intersect_group(&source, search);
            else if (search->count <= MAX_WAITING - WIDTH)
                add_children(trees, trees->nodes + child, search);
            if (find_next(trees, search))
                open[left++] = open[i];
        }
}
