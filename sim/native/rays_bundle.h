/* Trace bundles: rays of one origin with similar directions, such as those of neighbouring pixels. Objects that none of
 * them can hit are excluded once for the whole bundle.
 *
 * Each ray still has the hit of `trace`, to the last bit. This file does not use the Python API.
 */

#include <stdlib.h>

#include "rays.h"

enum { MAX_STRIDES = 24, MAX_CELLS = 96, FEW_CELLS = 3, SOME_CELLS = 12 };
#define GEOMETRY "sim.native.Geometry" /* name of the capsule that carries a Geometry */
#define MAX_SLOPES 0.1
#define CLEARANCE 1e-6 /* m of distance from an object that is excluded, so that rounding cannot matter */

/* The directions of `count` rays, with their componentwise bounds `low` and `high`. */
typedef struct {
    double along[BUNDLE][3], low[3], high[3];
    int count;
} Bundle;

static void bound(Bundle *bundle)
{
    for (int axis = 0; axis < 3; axis++) {
        double low = INFINITY, high = -INFINITY;
        for (int i = 0; i < bundle->count; i++) {
            low = min_of(low, bundle->along[i][axis]);
            high = max_of(high, bundle->along[i][axis]);
        }
        bundle->low[axis] = low, bundle->high[axis] = high;
    }
}

/* --- solids */

/* Allocates the lists of solids near an origin and near a bundle; returns 0 without memory. */
static int allocate_near_solids(const Geometry *geometry, Near *near)
{
    near->count = 0;
    near->numbers = malloc((size_t)(2 * geometry->count + 1) * sizeof *near->numbers);
    return near->numbers != NULL;
}

/* Returns 1 if a half space is out of reach of all rays of a bundle; `plane` is its normal and offset. */
static int is_far(const double *plane, const double *origin, const Bundle *bundle, double reach)
{
    double height = -plane[3], rate = 0.0;
    for (int axis = 0; axis < 3; axis++) {
        height += plane[axis] * origin[axis];
        rate += min_of(plane[axis] * bundle->low[axis], plane[axis] * bundle->high[axis]);
    }
    return height > CLEARANCE && height + rate * reach > CLEARANCE;
}

/* Returns the solids without those that `misses` would exclude for each of the rays. */
static Near exclude_solids(const Geometry *geometry, const Near *near, const double *origin, const Bundle *bundle, double reach)
{
    double middle[2], widest[2], largest[2];
    for (int axis = 0; axis < 2; axis++) {
        middle[axis] = 0.5 * (bundle->low[axis] + bundle->high[axis]);
        widest[axis] = 0.5 * (bundle->high[axis] - bundle->low[axis]);
        largest[axis] = max_of(fabs(bundle->low[axis]), fabs(bundle->high[axis]));
    }
    double spread = widest[0] + widest[1], longest = largest[0] + largest[1];
    Near closer = {near->numbers + geometry->count, 0};
    for (long k = 0; k < near->count; k++) {
        const Solid *solid = geometry->solids + near->numbers[k];
        double x = solid->position[0] - origin[0], y = solid->position[1] - origin[1];
        double across = fabs(middle[0] * y - middle[1] * x) - spread * (fabs(x) + fabs(y));
        int beyond = solid->kind == HALF_SPACE ? is_far(solid->sizes, origin, bundle, reach)
                                               : across > solid->reach * longest + CLEARANCE;
        if (!beyond)
            closer.numbers[closer.count++] = near->numbers[k];
    }
    return closer;
}

/* --- the seabed */

/* The least depth of the cells between `from` and `to` (in cells); -INFINITY for too many cells, and beyond the grid. */
static double min_depth_between(const Ground *ground, const double *from, const double *to)
{
    const double edge[2] = {(double)(ground->rows - 1), (double)(ground->columns - 1)};
    for (int axis = 0; axis < 2; axis++)
        if (!(from[axis] > CLEARANCE && to[axis] < edge[axis] - CLEARANCE && to[axis] - from[axis] < MAX_CELLS))
            return -INFINITY;
    long top = (long)(from[0] - CLEARANCE), left = (long)(from[1] - CLEARANCE);
    long bottom = (long)(to[0] + CLEARANCE), right = (long)(to[1] + CLEARANCE);
    long size = bottom - top > right - left ? bottom - top : right - left;
    double least = INFINITY;
    if (size < FEW_CELLS) {
        for (long row = top; row <= bottom + 1; row++)
            for (long column = left; column <= right + 1; column++) {
                float depth = ground->depths[row * ground->columns + column];
                if (!(depth >= least))
                    least = isnan(depth) ? -INFINITY : depth;
            }
        return least;
    }
    int level = size < SOME_CELLS, shift = SHIFT[level];
    for (long row = top >> shift; row <= bottom >> shift; row++)
        for (long column = left >> shift; column <= right >> shift; column++)
            least = min_of(least, min_depth_in_block(ground, level, row, column));
    return least;
}

/* A distance (m) before which no ray of a bundle meets the seabed, found in steps over boxes that contain all rays. It
 * is not worthwhile for rays of different slopes. */
static double clear_distance(const Ground *ground, const double *origin, const Bundle *bundle, double reach)
{
    if (ground->rows == 0 || bundle->high[2] - bundle->low[2] > MAX_SLOPES)
        return 0.0;
    double at[2] = {(origin[0] - ground->north_min) * ground->scale, (origin[1] - ground->east_min) * ground->scale};
    double fastest = 1e-3 + ground->scale * max_of(max_of(fabs(bundle->low[0]), fabs(bundle->high[0])),
                                                    max_of(fabs(bundle->low[1]), fabs(bundle->high[1])));
    double near = 0.0, down = bundle->high[2], stride = min_of(reach, 0.5 * MAX_CELLS / fastest);
    for (int i = 0; i < MAX_STRIDES && near < reach && stride * fastest > 0.25; i++) {
        double far = min_of(near + stride, reach), from[2], to[2];
        for (int axis = 0; axis < 2; axis++) {
            double low = bundle->low[axis] * ground->scale, high = bundle->high[axis] * ground->scale;
            from[axis] = at[axis] + min_of(low * near, low * far);
            to[axis] = at[axis] + max_of(high * near, high * far);
        }
        double room = min_depth_between(ground, from, to) - CLEARANCE - origin[2];
        double clear = down > 0.0 ? min_of(room / down, far) : down * near < room ? far : near;
        stride = clear >= far ? 2.0 * stride : clear > near + 0.5 * stride ? stride : 0.25 * stride;
        near = max_of(near, clear);
    }
    return near;
}

static void trace_bundle(const Geometry *geometry, const Near *near, const double *origin, Bundle *bundle, double reach,
                         Hit *hits)
{
    double start = 0.0;
    Near closer = *near;
    if (bundle->count >= FEW_RAYS) {
        bound(bundle);
        start = clear_distance(&geometry->ground, origin, bundle, reach);
        closer = exclude_solids(geometry, near, origin, bundle, reach);
    }
    trace(geometry, &closer, origin, (const double (*)[3])bundle->along, bundle->count, reach, start, hits);
}
