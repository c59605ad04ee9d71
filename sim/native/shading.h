/* The light of a camera's pixels: sim/sensors/imaging/scenery.py and sim/environment/optics.py in C, in one pass.
 *
 * Those files are the specification and explain the method. Sums are in 32-bit floats as there, but exp is taken from
 * tables, so that colours agree to a part in a thousand. This file does not use the Python API.
 */

#include <math.h>
#include <stddef.h>
#include <stdint.h>

/* Nodes along a side of a tile and levels of the texture, sizes of footprints, steps of the table of exp. */
enum { TILE_SIDE = 512, TILE_LEVELS = 6, FOOTPRINTS = 24, DECAY_STEPS = 1024, CHANNELS = 3, DECAYS_PER_STEP = 2 * CHANNELS };

/* The settings of `shade` and `picture`, in this order. */
typedef struct {
    double origin[3], rotation[9], reach, pixel, surface, lamps, light[3], veil[3], per_metre, node[2], deviation[2], rock[3];
    double rows, columns, north_min, east_min, scale, height, texture_node, finest, wave[2], ripple, ripple_length;
} Settings;

enum { SETTINGS = sizeof(Settings) / sizeof(double) };

/* For footprints (m) up to `max_footprint`: the offset of the level of their tiles, its nodes a side and nodes a metre, and the
 * share of the ripples that remains as the mean over such a size. */
typedef struct {
    size_t first;
    long side;
    float max_footprint, scale, ripple;
} Footprint;

/* The appearance of surfaces. `nodes` is the number of grain nodes a metre; depths and texture are NULL if absent. */
typedef struct {
    const Settings *settings;
    const float *colours, *grain, *decays, *depths, *texture;
    size_t texture_size;
    float pixel, lamps, light[CHANNELS], veil[CHANNELS], rock[CHANNELS], per_metre, nodes[2], deviation[2], height, wave[2];
    Footprint footprints[FOOTPRINTS];
} Appearance;

/* What the ray of a pixel hits, in the world's axes; `facing` is the cosine of the angle of incidence. */
typedef struct {
    float point[3], normal[3], distance, facing;
    long object;
} Pixel;

static float min_float(float a, float b) { return a < b ? a : b; }
static float max_float(float a, float b) { return a > b ? a : b; }
static long clamp_index(long index, long count) { return index < 0 ? 0 : index >= count ? count - 1 : index; }

static long floor_index(float x)
{
    long cut = (long)x;
    return cut - (x < (float)cut);
}

/* Interpolates the grain between nodes of its tile, which repeats its first row and column at the end. */
static float interpolate_grain(const float *tile, float u, float v)
{
    long row = floor_index(u), column = floor_index(v);
    float a = u - (float)row, b = v - (float)column;
    const float *corner = tile + (row & (TILE_SIDE - 1)) * (TILE_SIDE + 1) + (column & (TILE_SIDE - 1));
    float one = corner[0] + (corner[1] - corner[0]) * b;
    float other = corner[TILE_SIDE + 1] + (corner[TILE_SIDE + 2] - corner[TILE_SIDE + 1]) * b;
    return one + (other - one) * a;
}

/* The brightness that the grain gives a surface: two scales of noise, less the finer a pixel's footprint is. */
static float grain_tone(const Appearance *appearance, const Pixel *pixel, float footprint)
{
    const float *p = pixel->point;
    float x = fabsf(pixel->normal[0]), y = fabsf(pixel->normal[1]), z = fabsf(pixel->normal[2]);
    int level = z >= 0.5f;
    float u = !level && x > y ? p[1] : p[0], v = level ? p[1] : p[2], tone = 1.0f;
    for (int i = 0; i < 2; i++) {
        float blur = footprint * 0.125f * appearance->nodes[i];
        float left = blur > 1.0f ? appearance->deviation[i] / blur : appearance->deviation[i];
        tone += left * interpolate_grain(appearance->grain, u * appearance->nodes[i], v * appearance->nodes[i]);
    }
    return max_float(tone, 0.1f);
}

/* The brightness by the curvature of the seabed: hollows are darker. */
static float curvature_tone(const Appearance *appearance, const Pixel *pixel)
{
    const Settings *s = appearance->settings;
    long rows = (long)s->rows, columns = (long)s->columns;
    long row = clamp_index((long)((pixel->point[0] - s->north_min) * s->scale + 0.5), rows);
    long column = clamp_index((long)((pixel->point[1] - s->east_min) * s->scale + 0.5), columns);
    const float *here = appearance->depths + row * columns;
    const float *above = here - (row > 0 ? columns : 0), *below = here + (row < rows - 1 ? columns : 0);
    float around = 0.25f * (above[column] + below[column] + here[clamp_index(column - 1, columns)] + here[clamp_index(column + 1, columns)]);
    float height = (around - here[column]) * (float)s->scale;
    if (height != height)
        return 1.0f;
    return min_float(max_float(1.0f + 3.0f * height, 0.7f), 1.3f);
}

/* The tiles of slopes to the north, to the east and of brightness follow each other, each with all its levels. */
static float texture_tone(const Appearance *appearance, const Pixel *pixel, float footprint)
{
    const Footprint *level = appearance->footprints;
    while (footprint >= level->max_footprint && level < appearance->footprints + FOOTPRINTS - 1)
        level++;
    size_t all = appearance->texture_size / 3;
    const float *tiles = appearance->texture + level->first;
    long side = level->side, row = floor_index(pixel->point[0] * level->scale), column = floor_index(pixel->point[1] * level->scale);
    size_t node = (size_t)((row & (side - 1)) * side + (column & (side - 1)));
    size_t patch = (size_t)(((row >> 1) & (side - 1)) * side + ((column >> 1) & (side - 1)));
    float north = appearance->height * tiles[node], east = appearance->height * tiles[all + node];
    if (level->ripple != 0.0f) {
        float rise = level->ripple * cosf(appearance->wave[0] * pixel->point[0] + appearance->wave[1] * pixel->point[1]);
        north += appearance->wave[0] * rise, east += appearance->wave[1] * rise;
    }
    float root = sqrtf(1.0f + north * north + east * east);
    float lean = min_float(max_float(0.5f * (north + east), -0.5f), 0.5f);
    return tiles[2 * all + patch] * (0.8f / root + 0.2f + lean);
}

/* Reads exp(-coefficient distance) from the table: for three attenuations, then for three backscatter coefficients. */
static void read_decays(const Appearance *appearance, float distance, float *decays, int count)
{
    float position = min_float(distance * appearance->per_metre, (float)DECAY_STEPS - 1e-3f);
    int first = (int)position;
    const float *row = appearance->decays + first * DECAYS_PER_STEP, *next = row + DECAYS_PER_STEP;
    position -= (float)first;
    for (int i = 0; i < count; i++)
        decays[i] = row[i] + (next[i] - row[i]) * position;
}

/* The radiance of a pixel at the lens; the veil of the water if the ray hits nothing. */
static void shade_pixel(const Appearance *appearance, const Pixel *pixel, float *out)
{
    if (pixel->object < 0) {
        for (int c = 0; c < CHANNELS; c++)
            out[c] = appearance->veil[c];
        return;
    }
    int surface = pixel->object == (long)appearance->settings->surface;
    float footprint = pixel->distance * appearance->pixel, tone = surface ? 1.0f : grain_tone(appearance, pixel, footprint), rock = 0.0f;
    if (pixel->object == 0) {
        if (appearance->depths)
            tone *= curvature_tone(appearance, pixel);
        if (appearance->texture)
            tone *= texture_tone(appearance, pixel, footprint);
        rock = min_float(max_float((0.93f + pixel->normal[2]) / 0.12f, 0.0f), 1.0f);
    }
    float day = tone * (0.6f - 0.4f * pixel->normal[2]);
    if (surface) /* Snell's window, as sim/sensors/imaging/scenery.py has it */
        day = min_float(max_float((pixel->facing - 0.62f) / 0.08f, 0.0f), 1.0f);
    float near = max_float(pixel->distance, 0.05f), lit = 0.0f, decays[DECAYS_PER_STEP], lamplight[CHANNELS];
    read_decays(appearance, pixel->distance, decays, DECAYS_PER_STEP);
    if (!surface && appearance->lamps > 0.0f && pixel->facing > 0.0f) {
        lit = tone * appearance->lamps * pixel->facing / (near * near);
        read_decays(appearance, near, lamplight, CHANNELS);
    }
    const float *colour = appearance->colours + 3 * pixel->object;
    for (int c = 0; c < CHANNELS; c++) {
        float sent = day * appearance->light[c];
        if (lit > 0.0f)
            sent += lit * lamplight[c];
        sent *= colour[c] + rock * appearance->rock[c];
        if (surface)
            sent += (1.0f - day) * appearance->veil[c];
        out[c] = sent * decays[c] + appearance->veil[c] * (1.0f - decays[CHANNELS + c]);
    }
}

/* Sizes double from the finest on; levels change where the logarithm of their ratio rounds up. */
static void set_footprints(Appearance *appearance)
{
    const Settings *s = appearance->settings;
    size_t first = 0;
    int level = 0;
    for (int i = 0; i < FOOTPRINTS; i++) {
        double size = s->finest * (double)(1L << i), turn = 3.141592653589793 * size / s->ripple_length;
        for (; level < TILE_LEVELS - 1 && size / s->texture_node >= 1.4142135623730951 * (double)(1 << level); level++)
            first += (size_t)(TILE_SIDE >> level) * (size_t)(TILE_SIDE >> level);
        double left = s->ripple != 0.0 && size < s->ripple_length ? s->ripple * sin(turn) / turn : 0.0;
        float scale = (float)(1.0 / (s->texture_node * (double)(1 << level)));
        appearance->footprints[i] = (Footprint){first, TILE_SIDE >> level, (float)(size * 1.4142135623730951), scale, (float)left};
    }
}

static void set_numbers(Appearance *appearance)
{
    const Settings *s = appearance->settings;
    for (int c = 0; c < CHANNELS; c++)
        appearance->light[c] = (float)s->light[c], appearance->veil[c] = (float)s->veil[c], appearance->rock[c] = (float)s->rock[c];
    for (int i = 0; i < 2; i++) {
        appearance->nodes[i] = 1.0f / (float)s->node[i], appearance->deviation[i] = (float)s->deviation[i];
        appearance->wave[i] = (float)s->wave[i];
    }
    appearance->pixel = (float)s->pixel, appearance->lamps = (float)s->lamps, appearance->per_metre = (float)s->per_metre;
    appearance->height = (float)s->height;
    set_footprints(appearance);
}
