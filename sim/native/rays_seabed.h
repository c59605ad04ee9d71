/* The rays of sim/rays/seabed.py in C, equal to the last bit: same operations, same order, same names.
 *
 * That file is the specification and explains the method. For speed, cells are grouped in blocks and these in larger
 * blocks, each with its least depth: a ray that stays above a block passes it in one step. This file does not use the
 * Python API.
 */

#include <math.h>
#include <stddef.h>

#include "check_doubles.h"

#define TINY 1e-12
#define ON_SURFACE 1e-6

enum { SURFACE, STEP_NORTH, STEP_EAST };
enum { ABOVE = -1, BELOW = -2 };
enum { LEVELS = 2 };
static const int SHIFT[LEVELS] = {4, 2};  /* a block of a level has 2^SHIFT cells along each side */

/* sim/environment/terrain.py: depths of rows x columns nodes; 0 rows without a terrain. `least` has one number for each
 * block of each size, 0 until it is first needed: so memory pages are used only where rays have been. */
typedef struct {
    const float *depths;
    long rows, columns, block_columns[LEVELS];
    double north_min, east_min, scale, outside;
    float *least[LEVELS];
} Ground;

static double min_of(double a, double b)
{
    return b < a ? b : a;
}

static double max_of(double a, double b)
{
    return b > a ? b : a;
}

static long clamp(long value, long low, long high)
{
    return value < low ? low : value > high ? high : value;
}

/* `inverse` is 1 / rate. */
static void slab(double at, double rate, double inverse, double low, double high, double *near, double *far)
{
    if (fabs(rate) <= TINY) {
        if (!(low <= at && at <= high))
            *near = INFINITY, *far = -INFINITY;
        return;
    }
    double one = (low - at) * inverse, other = (high - at) * inverse;
    *near = max_of(*near, one > other ? other : one);
    *far = min_of(*far, one > other ? one : other);
}

/* --- the seabed */

static double intersect_flat(double z, double dz, double depth, double near, double far)
{
    if (z + dz * near >= depth)
        return near;
    double distance = dz > 0.0 ? (depth - z) / dz : INFINITY;
    return distance <= far ? distance : INFINITY;
}

/* A ray in cells: its origin and direction, and for x and y: 1 / rate, the step from cell to cell, and the edge of a
 * cell (0 or 1) at which it leaves the cell. */
typedef struct {
    double at[3], rate[3], inverse[2];
    long step[2], edge[2];
} Ray;

/* The distance at which the ray leaves, along one axis, the `size` cells that begin at `cell`. */
static double crossing(const Ray *ray, int axis, long cell, long size)
{
    if (fabs(ray->rate[axis]) <= TINY)
        return INFINITY;
    return ((double)(cell + (ray->edge[axis] ? size : 0)) - ray->at[axis]) * ray->inverse[axis];
}

static double intersect_cell(const Ground *ground, const Ray *ray, long row, long column, double near, double end)
{
    const float *first = ground->depths + row * ground->columns + column, *second = first + ground->columns;
    double a = first[0], b = first[1], c = second[0], d = second[1];
    double dx = ray->rate[0], dy = ray->rate[1], dz = ray->rate[2];
    double z = ray->at[2] + dz * near, lowest = max_of(z, ray->at[2] + dz * end);
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
static double min_depth_in_block(const Ground *ground, int level, long block_row, long block_column)
{
    float *known = ground->least[level] + block_row * ground->block_columns[level] + block_column;
    if (*known != 0.0f)
        return *known;
    float least = INFINITY;
    long size = 1L << SHIFT[level], top = block_row * size, left = block_column * size;
    for (long row = top; row <= top + size && row < ground->rows; row++)
        for (long column = left; column <= left + size && column < ground->columns; column++) {
            float depth = ground->depths[row * ground->columns + column];
            if (!(depth >= least))
                least = isnan(depth) ? -INFINITY : depth;
        }
    return *known = least;
}

/* Follows the ray from `*near` in the cell `at` until it leaves the cells of rows `cells[0]` to `cells[1]` and columns
 * `cells[2]` to `cells[3]`, or until `far`. Returns 1 if it hits the seabed, then at `*near`. */
static int walk_cells(const Ground *ground, const Ray *ray, const long *cells, const long *at, double *near, double far,
                      long *side)
{
    long top = cells[0], last_row = cells[1], left = cells[2], last_column = cells[3], row = at[0], column = at[1];
    double next_x = crossing(ray, 0, row, 1), next_y = crossing(ray, 1, column, 1);
    for (;;) {
        double end = min_of(min_of(next_x, next_y), far);
        double distance = intersect_cell(ground, ray, row, column, *near, end);
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

/* Finds the cell, among `cells`, in which the ray is at the distance `near`. */
static void find_cell(const Ray *ray, const long *cells, double near, long *cell)
{
    cell[0] = clamp((long)(ray->at[0] + ray->rate[0] * near), cells[0], cells[1]);
    cell[1] = clamp((long)(ray->at[1] + ray->rate[1] * near), cells[2], cells[3]);
}

static void find_block(const Ground *ground, int level, long block_row, long block_column, long *cells)
{
    long size = 1L << SHIFT[level], top = block_row * size, left = block_column * size;
    cells[0] = top, cells[1] = clamp(top + size - 1, 0, ground->rows - 2);
    cells[2] = left, cells[3] = clamp(left + size - 1, 0, ground->columns - 2);
}

/* The same for the blocks of a level, and the blocks and cells in them. */
static int walk(const Ground *ground, const Ray *ray, int level, const long *cells, double *near, double far, long *side)
{
    int shift = SHIFT[level];
    long size = 1L << shift, first_row = cells[0] >> shift, last_row = cells[1] >> shift;
    long first_column = cells[2] >> shift, last_column = cells[3] >> shift;
    long cell[2], within[4];
    find_cell(ray, cells, *near, cell);
    long row = cell[0] >> shift, column = cell[1] >> shift;
    while (row >= first_row && row <= last_row && column >= first_column && column <= last_column) {
        double next_x = crossing(ray, 0, row << shift, size), next_y = crossing(ray, 1, column << shift, size);
        double end = min_of(min_of(next_x, next_y), far);
        double lowest = max_of(ray->at[2] + ray->rate[2] * *near, ray->at[2] + ray->rate[2] * end);
        if (!(lowest < min_depth_in_block(ground, level, row, column))) {
            find_block(ground, level, row, column, within);
            find_cell(ray, within, *near, cell);
            if (level + 1 < LEVELS ? walk(ground, ray, level + 1, within, near, end, side)
                                   : walk_cells(ground, ray, within, cell, near, end, side))
                return 1;
        }
        if (end >= far)
            break;
        if (next_x <= next_y)
            row += ray->step[0], *side = STEP_NORTH;
        else
            column += ray->step[1], *side = STEP_EAST;
        *near = end;
    }
    return 0;
}

/* Starts at the edge of the cell in which the ray is at `start` m, as a ray that comes from farther away does, and
 * continues in the block of that cell. */
static int walk_from(const Ground *ground, const Ray *ray, double start, double *near, double far, long *side)
{
    const long all[4] = {0, ground->rows - 2, 0, ground->columns - 2};
    if (start > 0.0 && start >= far)
        return 0;
    if (start > *near) {
        long cell[2], within[4];
        find_cell(ray, all, start, cell);
        for (int axis = 0; axis < 2; axis++) {
            double into = fabs(ray->rate[axis]) > TINY ? ((double)(cell[axis] + !ray->edge[axis]) - ray->at[axis]) * ray->inverse[axis]
                                                       : -INFINITY;
            if (into >= *near && into > 0.0)
                *near = into, *side = axis == 0 ? STEP_NORTH : STEP_EAST;
        }
        find_block(ground, LEVELS - 1, cell[0] >> SHIFT[LEVELS - 1], cell[1] >> SHIFT[LEVELS - 1], within);
        if (walk_cells(ground, ray, within, cell, near, far, side))
            return 1;
        if (*near >= far)
            return 0;
    }
    return walk(ground, ray, 0, all, near, far, side);
}

/* The distance at which a ray meets the seabed, known to be at least `start` m; `start` is within the grid unless 0. */
static double intersect_seabed(const Ground *ground, const double *origin, const double *direction, double reach, double start,
                          long *side)
{
    double z = origin[2], dz = direction[2], depth = ground->outside;
    *side = SURFACE;
    if (start > 0.0 && start >= reach)
        return INFINITY;
    if (ground->rows == 0)
        return intersect_flat(z, dz, depth, 0.0, reach);
    Ray ray = {.at = {(origin[0] - ground->north_min) * ground->scale, (origin[1] - ground->east_min) * ground->scale, z},
               .rate = {direction[0] * ground->scale, direction[1] * ground->scale, dz}};
    for (int axis = 0; axis < 2; axis++) {
        ray.inverse[axis] = 1.0 / ray.rate[axis];
        ray.step[axis] = ray.rate[axis] > 0.0 ? 1 : -1;
        ray.edge[axis] = ray.rate[axis] > 0.0;
    }
    double near = 0.0, far = reach;
    slab(ray.at[0], ray.rate[0], ray.inverse[0], 0.0, (double)ground->rows - 1.0, &near, &far);
    double into_row = near, out_of_row = far;
    slab(ray.at[1], ray.rate[1], ray.inverse[1], 0.0, (double)ground->columns - 1.0, &near, &far);
    if (near > far)
        return intersect_flat(z, dz, depth, 0.0, reach);
    if (near > 0.0) {
        double distance = intersect_flat(z, dz, depth, 0.0, near);
        if (distance < near)
            return distance;
    }
    *side = near > into_row ? STEP_EAST : near > 0.0 ? STEP_NORTH : SURFACE;
    if (walk_from(ground, &ray, start, &near, far, side))
        return near;
    *side = SURFACE;
    if (far >= reach)
        return INFINITY;
    double distance = intersect_flat(z, dz, depth, far, reach);
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
    long row = clamp((long)x, 0, ground->rows - 2), column = clamp((long)y, 0, ground->columns - 2);
    const float *first = ground->depths + row * ground->columns + column, *second = first + ground->columns;
    double a = first[0], b = first[1], c = second[0], d = second[1];
    double u = x - (double)row, v = y - (double)column, twist = a - b - c + d;
    double north = ((c - a) + twist * v) * ground->scale, east = ((b - a) + twist * u) * ground->scale;
    if (isnan(north + east))
        return;
    double scale = 1.0 / sqrt(north * north + east * east + 1.0);
    set(out, north * scale, east * scale, -scale);
}
