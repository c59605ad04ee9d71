/* Builds the tree of sim/rays/tree.py, equal to the last bit. That file is the specification and explains the method.
 * It is included after rays.h, and does not use the Python API.
 */

#define PAD 1e-6
#define MARGIN 3e-6 /* 45 roundings of a float: the operations of find_candidates have less */
#define BEYOND 1e30
#define SMALLEST 1e-300
enum { BINS = 16, MAX_DEPTH = 10 };

/* A triangle, with the box around it. */
typedef struct {
    float low[3], high[3];
    long number;
} Item;

typedef struct {
    float low[3], high[3];
} Bounds;

typedef struct {
    const double (*mesh)[3][3];
    Node *nodes;
    Group *groups;
    double pad;
    long root, group; /* the next of each */
} Grower;

static const Bounds EMPTY = {{INFINITY, INFINITY, INFINITY}, {-INFINITY, -INFINITY, -INFINITY}};

static void enclose(Bounds *bounds, const float *low, const float *high)
{
    for (int axis = 0; axis < 3; axis++) {
        bounds->low[axis] = low[axis] < bounds->low[axis] ? low[axis] : bounds->low[axis];
        bounds->high[axis] = high[axis] > bounds->high[axis] ? high[axis] : bounds->high[axis];
    }
}

static Bounds enclose_all(const Item *items, long count)
{
    Bounds bounds = EMPTY;
    for (long i = 0; i < count; i++)
        enclose(&bounds, items[i].low, items[i].high);
    return bounds;
}

static double area(const Bounds *bounds)
{
    double sides[3];
    for (int axis = 0; axis < 3; axis++)
        sides[axis] = (double)bounds->high[axis] - (double)bounds->low[axis];
    return sides[0] * sides[1] + sides[1] * sides[2] + sides[2] * sides[0];
}

static double centre(const Item *item, int axis)
{
    return (double)item->low[axis] + (double)item->high[axis];
}

static int is_before(const Item *one, const Item *other, int axis)
{
    double key = centre(one, axis), other_key = centre(other, axis);
    return key < other_key || (key == other_key && one->number < other->number);
}

/* Exchanges items so that the `wanted` first are those that a sorted list begins with. */
static void select_first(Item *items, long count, long wanted, int axis)
{
    long low = 0, high = count - 1;
    uint32_t chance = 1; /* a fixed place would be the worst in meshes of several sorted rows */
    while (low < high) {
        chance = chance * 1664525u + 1013904223u;
        const Item pivot = items[low + (long)((uint64_t)(high - low) * chance >> 32)];
        long i = low, j = high;
        while (i <= j) {
            while (is_before(items + i, &pivot, axis))
                i++;
            while (is_before(&pivot, items + j, axis))
                j--;
            if (i <= j) {
                Item item = items[i];
                items[i++] = items[j], items[j--] = item;
            }
        }
        if (wanted <= j)
            high = j;
        else if (wanted >= i)
            low = i;
        else
            return;
    }
}

static long groups_of(long count)
{
    return (count + WIDTH - 1) / WIDTH;
}

/* The axis and the number of items before the best boundary of bins. */
static long find_split(const Item *items, long count, const double *low, const double *size, int *best_axis)
{
    Bounds bins[3][BINS], right[BINS];
    long counts[3][BINS] = {{0}}, best = 0;
    double least = INFINITY, scale[3];
    for (int axis = 0; axis < 3; axis++) {
        scale[axis] = BINS / max_of(size[axis], SMALLEST);
        for (int bin = 0; bin < BINS; bin++)
            bins[axis][bin] = EMPTY;
    }
    for (long i = 0; i < count; i++) {
        for (int axis = 0; axis < 3; axis++) {
            long bin = (long)min_of((centre(items + i, axis) - low[axis]) * scale[axis], BINS - 1);
            enclose(&bins[axis][bin], items[i].low, items[i].high), counts[axis][bin]++;
        }
    }
    for (int axis = 0; axis < 3; axis++) {
        right[BINS - 1] = bins[axis][BINS - 1];
        for (int bin = BINS - 1; bin > 0; bin--) {
            right[bin - 1] = right[bin];
            enclose(&right[bin - 1], bins[axis][bin - 1].low, bins[axis][bin - 1].high);
        }
        Bounds left = EMPTY;
        long before = 0;
        for (int bin = 0; bin < BINS - 1; bin++) {
            enclose(&left, bins[axis][bin].low, bins[axis][bin].high);
            before += counts[axis][bin];
            if (before == 0 || before == count)
                continue;
            double cost = area(&left) * (double)groups_of(before) + area(&right[bin + 1]) * (double)groups_of(count - before);
            if (cost < least)
                least = cost, best = before, *best_axis = axis;
        }
    }
    return best;
}

/* Divides more than WIDTH items; returns the number in the first part. */
static long divide(Item *items, long count, int depth)
{
    double low[3], size[3];
    int axis = 0;
    for (int other = 0; other < 3; other++) {
        double high = -INFINITY;
        low[other] = INFINITY;
        for (long i = 0; i < count; i++)
            low[other] = min_of(low[other], centre(items + i, other)), high = max_of(high, centre(items + i, other));
        size[other] = high - low[other];
        axis = size[other] > size[axis] ? other : axis;
    }
    long groups = groups_of(count), first = groups - groups / 2;
    if (depth < MAX_DEPTH && size[axis] > 0.0)
        first = (find_split(items, count, low, size, &axis) + WIDTH / 2) / WIDTH;
    first = WIDTH * clamp(first, 1, groups - 1);
    select_first(items, count, first, axis);
    return first;
}

static double length(const double *v)
{
    return sqrt(v[0] * v[0] + v[1] * v[1] + v[2] * v[2]);
}

static void write_group(Grower *grower, Item *items, long count)
{
    Group *group = grower->groups + grower->group++;
    Triangle *triangle = group->triangles;
    double longest = 0.0, farthest = 0.0;
    for (int lane = 0; lane < count; lane++, triangle++) {
        for (long i = lane + 1; i < count; i++)
            if (items[i].number < items[lane].number) {
                Item item = items[i];
                items[i] = items[lane], items[lane] = item;
            }
        const double (*corner)[3] = grower->mesh[items[lane].number];
        for (int axis = 0; axis < 3; axis++) {
            triangle->corner[axis] = corner[0][axis];
            triangle->one[axis] = corner[1][axis] - corner[0][axis];
            triangle->other[axis] = corner[2][axis] - corner[0][axis];
            group->corner[axis][lane] = (float)triangle->corner[axis];
            group->one[axis][lane] = (float)triangle->one[axis], group->other[axis][lane] = (float)triangle->other[axis];
        }
        farthest = max_of(farthest, length(triangle->corner));
        longest = max_of(longest, max_of(length(triangle->one), length(triangle->other)));
    }
    group->margin = (float)(longest * MARGIN), group->extent = (float)(longest + farthest);
}

static void grow_node(Grower *grower, Item *items, long count, int depth)
{
    Node *node = grower->nodes + grower->root++;
    long starts[WIDTH + 1] = {0, count};
    Bounds bounds[WIDTH] = {enclose_all(items, count)};
    int parts = 1;
    while (parts < WIDTH) {
        int largest = -1;
        for (int part = 0; part < parts; part++)
            if (starts[part + 1] - starts[part] > WIDTH && (largest < 0 || area(bounds + part) > area(bounds + largest)))
                largest = part;
        if (largest < 0)
            break;
        long start = starts[largest], end = starts[largest + 1];
        for (int part = parts++; part > largest; part--)
            starts[part + 1] = starts[part], bounds[part] = bounds[part - 1];
        starts[largest + 1] = start + divide(items + start, end - start, depth);
        bounds[largest] = enclose_all(items + start, starts[largest + 1] - start);
        bounds[largest + 1] = enclose_all(items + starts[largest + 1], end - starts[largest + 1]);
    }
    for (int lane = 0; lane < WIDTH; lane++) {
        long size = lane < parts ? starts[lane + 1] - starts[lane] : 0;
        for (int axis = 0; axis < 3; axis++) {
            node->sides[axis][lane] = (float)(size ? (double)bounds[lane].low[axis] - grower->pad : BEYOND);
            node->sides[3 + axis][lane] = (float)(size ? (double)bounds[lane].high[axis] + grower->pad : BEYOND);
        }
        if (size > WIDTH) {
            node->child[lane] = (float)grower->root;
            grow_node(grower, items + starts[lane], size, depth + 1);
        } else if (size > 0) {
            node->child[lane] = (float)(-1 - grower->group);
            write_group(grower, items + starts[lane], size);
        }
    }
}

/* Writes the tree of `count` triangles; `items` is memory for as many. */
static void grow_tree(Grower *grower, Item *items, long count)
{
    for (long i = 0; i < count; i++) {
        Bounds bounds = EMPTY;
        for (int corner = 0; corner < 3; corner++) {
            const double *at = grower->mesh[i][corner];
            const float place[3] = {(float)at[0], (float)at[1], (float)at[2]};
            enclose(&bounds, place, place);
        }
        for (int axis = 0; axis < 3; axis++) {
            items[i].low[axis] = bounds.low[axis], items[i].high[axis] = bounds.high[axis];
            grower->pad = max_of(grower->pad, PAD * max_of(fabs((double)bounds.low[axis]), fabs((double)bounds.high[axis])));
        }
        items[i].number = i;
    }
    grow_node(grower, items, count, 0);
}
