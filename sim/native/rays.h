/* The rays of sim/rays/single.py in C, equal to the last bit: same operations, same order, same names.
 *
 * That file is the specification and explains the method. This file does not use the Python API.
 */

#include "rays_seabed.h"

#include "rays_mesh.h"

enum { NOTHING = -1, SEABED = 0 };
enum { SPHERE, CYLINDER, BOX, HALF_SPACE, MESH };

/* A row of sim/rays/solids.py: all are doubles. */
typedef struct {
    double kind, reach, position[3], rotation[9], sizes[6], root;
} Solid;

typedef struct {
    Ground ground;
    const Solid *solids;
    long count;
    Trees trees;
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

static double intersect_solid(const Solid *solid, const double *origin, const double *direction, double reach)
{
    int kind = (int)solid->kind;
    const double *sizes = solid->sizes;
    if (kind == HALF_SPACE)
        return intersect_half_space(sizes, origin, direction, reach);
    double away[3], at[3], along[3], near = 0.0, far = reach;
    for (int axis = 0; axis < 3; axis++)
        away[axis] = origin[axis] - solid->position[axis];
    rotate_to_solid(solid->rotation, away, at);
    rotate_to_solid(solid->rotation, direction, along);
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

/* Replaces the hits of rays from one point by nearer ones on a mesh. */
static void trace_mesh(const Geometry *geometry, long number, const double *origin, const double (*along)[3], int count,
                       double reach, Hit *hits)
{
    const Solid *solid = geometry->solids + number;
    double away[3], at[3];
    MeshRay rays[BUNDLE];
    int places[BUNDLE], found = 0;
    for (int axis = 0; axis < 3; axis++)
        away[axis] = origin[axis] - solid->position[axis];
    rotate_to_solid(solid->rotation, away, at);
    for (int i = 0; i < count; i++) {
        if (misses(solid, origin, along[i]))
            continue;
        rotate_to_solid(solid->rotation, along[i], rays[found].along);
        rays[found].reach = min_of(reach, hits[i].distance), places[found++] = i;
    }
    intersect_mesh(&geometry->trees, (long)solid->root, solid->sizes, at, rays, found);
    for (int i = 0; i < found; i++)
        if (rays[i].distance < hits[places[i]].distance)
            hits[places[i]] = (Hit){rays[i].distance, number + 1, rays[i].triangle};
}

/* The first hits of up to BUNDLE rays from one point that are known to meet no seabed before `start` m. */
static void trace(const Geometry *geometry, const Near *near, const double *origin, const double (*along)[3], int count,
                  double reach, double start, Hit *hits)
{
    for (int i = 0; i < count; i++) {
        hits[i] = (Hit){INFINITY, NOTHING, 0};
        hits[i].distance = intersect_seabed(&geometry->ground, origin, along[i], reach, start, &hits[i].detail);
        if (hits[i].distance < INFINITY)
            hits[i].object = SEABED;
    }
    for (long k = 0; k < near->count; k++) {
        const long number = near->numbers[k];
        const Solid *solid = geometry->solids + number;
        if (solid->kind == MESH)
            trace_mesh(geometry, number, origin, along, count, reach, hits);
        for (int i = 0; i < count && solid->kind != MESH; i++) {
            if (misses(solid, origin, along[i]))
                continue;
            double distance = intersect_solid(solid, origin, along[i], min_of(reach, hits[i].distance));
            if (distance < hits[i].distance)
                hits[i] = (Hit){distance, number + 1, 0};
        }
    }
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

static void triangle_normal(const Triangle *triangle, const double *along, double *out)
{
    const double *e = triangle->one, *f = triangle->other;
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
        triangle_normal(geometry->trees.groups[hit->detail / WIDTH].triangles + hit->detail % WIDTH, at, own);
    else
        solid_normal(solid, at, own);
    rotate_to_world(solid->rotation, own, out);
}
