/* The rays of sim/rays/seabed.py once more, to the last bit: same operations, same order, same names.
 *
 * That file is the specification and says how it works; here is only what makes it fast. One thing is added: the
 * cells are grouped in blocks, each with the least of its depths, and a ray that stays above a block passes it in one
 * stride. Nothing of Python is in this file.
 */

#include <math.h>
#include <stddef.h>

#include "floating.h"

#define TINY 1e-12
#define ON_SURFACE 1e-6

enum { SURFACE, STEP_NORTH, STEP_EAST };
enum { ABOVE = -1, BELOW = -2 };
enum { BLOCK = 16 };  /* cells along each side of a block */

/* sim/environment/terrain.py: depths of rows x columns nodes; no rows where there is none. `least` has a number a block, NAN
 * until somebody asks. */
typedef struct {
    const float *depths;
    long rows, columns, block_columns;
    double north_min, east_min, scale, outside;
    float *least;
} Ground;

static double least_of(double a, double b)
{
    return b < a ? b : a;
}

static double most_of(double a, double b)
{
    return b > a ? b : a;
}

static long limited(long value, long low, long high)
{
    return value < low ? low : value > high ? high : value;
}

static void slab(double at, double rate, double low, double high, double *near, double *far)
{
    if (fabs(rate) <= TINY) {
        if (!(low <= at && at <= high))
            *near = INFINITY, *far = -INFINITY;
        return;
    }
    double slow = 1.0 / rate, one = (low - at) * slow, other = (high - at) * slow;
    *near = most_of(*near, one > other ? other : one);
    *far = least_of(*far, one > other ? one : other);
}

/* --- the seabed */

static double meet_flat(double z, double dz, double depth, double near, double far)
{
    if (z + dz * near >= depth)
        return near;
    double distance = dz > 0.0 ? (depth - z) / dz : INFINITY;
    return distance <= far ? distance : INFINITY;
}

/* A ray in cells: where it begins, how it goes, and for x and y 1 / rate, the way from cell to cell and the edge of a
 * cell that it comes to (0 or 1). */
typedef struct {
    double at[3], rate[3], slow[2];
    long step[2], edge[2];
} Ray;

/* Where along one axis the ray leaves the `size` cells that begin at `cell`. */
static double crossing(const Ray *ray, int axis, long cell, long size)
{
    if (fabs(ray->rate[axis]) <= TINY)
        return INFINITY;
    return ((double)(cell + (ray->edge[axis] ? size : 0)) - ray->at[axis]) * ray->slow[axis];
}

static double meet_cell(const Ground *ground, const Ray *ray, long row, long column, double near, double end)
{
    const float *first = ground->depths + row * ground->columns + column, *second = first + ground->columns;
    double a = first[0], b = first[1], c = second[0], d = second[1];
    double dx = ray->rate[0], dy = ray->rate[1], dz = ray->rate[2];
    double z = ray->at[2] + dz * near, lowest = most_of(z, ray->at[2] + dz * end);
    if (lowest < a && lowest < b && lowest < c && lowest < d)
        return ABOVE;
    double u = ray->at[0] + dx * near - (double)row, v = ray->at[1] + dy * near - (double)column;
    double north = c - a, east = b - a, twist = a - b - c + d;
    double p = z - (a + north * u + east * v + twist * u * v);
    if (!(p < 0.0))
        return p <= ON_SURFACE ? 0.0 : BELOW;
    double q = dz - (north * dx + east * dy + twist * (u * dy + v * dx));
    double r = -twist * dx * dy;
    double root = q * q - 4.0 * r * p;
    if (root < 0.0)
        return ABOVE;
    double below = q + sqrt(root);
    if (!(below > 0.0))
        return ABOVE;
    double distance = -2.0 * p / below;
    return distance <= end - near ? distance : ABOVE;
}

/* The least depth in a block, -INFINITY where a node has no data. */
static double least_in_block(const Ground *ground, long block_row, long block_column)
{
    float *known = ground->least + block_row * ground->block_columns + block_column;
    if (!isnan(*known))
        return *known;
    float least = INFINITY;
    long top = block_row * BLOCK, left = block_column * BLOCK;
    for (long row = top; row <= top + BLOCK && row < ground->rows; row++)
        for (long column = left; column <= left + BLOCK && column < ground->columns; column++) {
            float depth = ground->depths[row * ground->columns + column];
            if (!(depth >= least))
                least = isnan(depth) ? -INFINITY : depth;
        }
    return *known = least;
}

/* From `*near` on to where the ray leaves the block, or to `far`; 1 if it has met something at `*near`. */
static int walk_block(const Ground *ground, const Ray *ray, long top, long left, double *near, double far, long *side)
{
    long last_row = limited(top + BLOCK - 1, 0, ground->rows - 2);
    long last_column = limited(left + BLOCK - 1, 0, ground->columns - 2);
    long row = limited((long)(ray->at[0] + ray->rate[0] * *near), top, last_row);
    long column = limited((long)(ray->at[1] + ray->rate[1] * *near), left, last_column);
    double next_x = crossing(ray, 0, row, 1), next_y = crossing(ray, 1, column, 1);
    for (;;) {
        double end = least_of(least_of(next_x, next_y), far);
        double distance = meet_cell(ground, ray, row, column, *near, end);
        if (distance >= 0.0) {
            *near = *near + distance, *side = SURFACE;
            return 1;
        }
        if (distance == BELOW)
            return 1;
        if (end >= far)
            return 0;
        if (next_x <= next_y) {
            row += ray->step[0], *side = STEP_NORTH;
            next_x = crossing(ray, 0, row, 1);
        } else {
            column += ray->step[1], *side = STEP_EAST;
            next_y = crossing(ray, 1, column, 1);
        }
        *near = end;
        if (row < top || row > last_row || column < left || column > last_column)
            return 0;
    }
}

static double walk(const Ground *ground, const Ray *ray, double near, double far, long *side)
{
    long last_row = (ground->rows - 2) / BLOCK, last_column = (ground->columns - 2) / BLOCK;
    long row = limited((long)(ray->at[0] + ray->rate[0] * near), 0, ground->rows - 2) / BLOCK;
    long column = limited((long)(ray->at[1] + ray->rate[1] * near), 0, ground->columns - 2) / BLOCK;
    while (row >= 0 && row <= last_row && column >= 0 && column <= last_column) {
        double next_x = crossing(ray, 0, row * BLOCK, BLOCK), next_y = crossing(ray, 1, column * BLOCK, BLOCK);
        double end = least_of(least_of(next_x, next_y), far);
        double lowest = most_of(ray->at[2] + ray->rate[2] * near, ray->at[2] + ray->rate[2] * end);
        if (!(lowest < least_in_block(ground, row, column)) && walk_block(ground, ray, row * BLOCK, column * BLOCK, &near, end, side))
            return near;
        if (end >= far)
            break;
        if (next_x <= next_y)
            row += ray->step[0], *side = STEP_NORTH;
        else
            column += ray->step[1], *side = STEP_EAST;
        near = end;
    }
    *side = SURFACE;
    return INFINITY;
}

static double meet_seabed(const Ground *ground, const double *origin, const double *direction, double reach, long *side)
{
    double z = origin[2], dz = direction[2], depth = ground->outside;
    *side = SURFACE;
    if (ground->rows == 0)
        return meet_flat(z, dz, depth, 0.0, reach);
    Ray ray = {.at = {(origin[0] - ground->north_min) * ground->scale, (origin[1] - ground->east_min) * ground->scale, z},
               .rate = {direction[0] * ground->scale, direction[1] * ground->scale, dz}};
    for (int axis = 0; axis < 2; axis++) {
        ray.slow[axis] = 1.0 / ray.rate[axis];
        ray.step[axis] = ray.rate[axis] > 0.0 ? 1 : -1;
        ray.edge[axis] = ray.rate[axis] > 0.0;
    }
    double near = 0.0, far = reach;
    slab(ray.at[0], ray.rate[0], 0.0, (double)ground->rows - 1.0, &near, &far);
    double into_row = near, out_of_row = far;
    slab(ray.at[1], ray.rate[1], 0.0, (double)ground->columns - 1.0, &near, &far);
    if (near > far)
        return meet_flat(z, dz, depth, 0.0, reach);
    if (near > 0.0) {
        double distance = meet_flat(z, dz, depth, 0.0, near);
        if (distance < near)
            return distance;
    }
    *side = near > into_row ? STEP_EAST : near > 0.0 ? STEP_NORTH : SURFACE;
    double distance = walk(ground, &ray, near, far, side);
    if (distance < INFINITY || far >= reach)
        return distance;
    distance = meet_flat(z, dz, depth, far, reach);
    int step = distance == far && z + dz * far > depth + ON_SURFACE;
    *side = step ? far < out_of_row ? STEP_EAST : STEP_NORTH : SURFACE;
    return distance;
}

static void set(double *out, double x, double y, double z)
{
    out[0] = x, out[1] = y, out[2] = z;
}

static void seabed_normal(const Ground *ground, long side, const double *direction, const double *point, double *out)
{
    set(out, 0.0, 0.0, -1.0);
    if (side != SURFACE) {
        int axis = side == STEP_EAST;
        out[2] = 0.0, out[axis] = direction[axis] > 0.0 ? -1.0 : 1.0;
        return;
    }
    double x = (point[0] - ground->north_min) * ground->scale, y = (point[1] - ground->east_min) * ground->scale;
    if (!(0.0 <= x && x <= (double)(ground->rows - 1) && 0.0 <= y && y <= (double)(ground->columns - 1)))
        return;
    long row = limited((long)x, 0, ground->rows - 2), column = limited((long)y, 0, ground->columns - 2);
    const float *first = ground->depths + row * ground->columns + column, *second = first + ground->columns;
    double a = first[0], b = first[1], c = second[0], d = second[1];
    double u = x - (double)row, v = y - (double)column, twist = a - b - c + d;
    double north = ((c - a) + twist * v) * ground->scale, east = ((b - a) + twist * u) * ground->scale;
    if (isnan(north + east))
        return;
    double scale = 1.0 / sqrt(north * north + east * east + 1.0);
    set(out, north * scale, east * scale, -scale);
}
