/* The light of a camera's pixels once more: sim/sensors/imaging/scenery.py and sim/environment/optics.py in one pass.
 *
 * Those files are the specification and say how it works. Sums are in 32-bit floats as there, but exp comes out of
 * tables, so that colours are the same to a part in a thousand. Shows sim.native._picture.shade to Python.
 */

#include "numbers.h"

#include <math.h>

#include "buffer.h"

enum { NOTHING = -1, SEABED = 0 };
enum { DISTANCES, NORMALS, OBJECTS, TOWARD, COLOURS, GRAIN, FADES, DEPTHS, TEXTURE, OUT, VIEWS };
enum { SIDE = 512, LEVELS = 6, SIZES = 24, STEPS = 1024, CHANNELS = 3 };

/* As the first argument of `shade` has them, in this order. */
typedef struct {
    double origin[3], rotation[9], pixel, surface, lamps, light[3], veil[3], per_metre, node[2], deviation[2], rock[3];
    double rows, columns, north_min, east_min, scale, height, texture_node, finest, wave[2], ripple, ripple_length;
} Settings;

enum { SETTINGS = sizeof(Settings) / sizeof(double) };

/* Of footprints (m) up to `most`: where the level of their tiles begins, how many nodes a side it has, how many a m, and
 * what is left of the ripples as the mean over such a size. */
typedef struct {
    size_t first;
    long side;
    float most, scale, ripple;
} Size;

typedef struct {
    const Settings *set;
    const void *views[VIEWS];
    int wide_distances, wide_normals; /* doubles instead of floats */
    size_t depths, texture;           /* floats of them; 0: none */
    Size sizes[SIZES];
} Scene;

typedef struct {
    float point[3], normal[3], distance, facing, footprint;
    long object;
} Pixel;

static float at_most(float a, float b) { return a < b ? a : b; }
static float at_least(float a, float b) { return a > b ? a : b; }

static long whole(float x)
{
    long cut = (long)x;
    return x < (float)cut ? cut - 1 : cut;
}

/* Grain between the nodes of its tile, which has its first row and column once more at the end. */
static float between(const float *tile, float u, float v)
{
    long row = whole(u), column = whole(v);
    float a = u - (float)row, b = v - (float)column;
    const float *corner = tile + (row & (SIDE - 1)) * (SIDE + 1) + (column & (SIDE - 1));
    float one = corner[0] + (corner[1] - corner[0]) * b;
    float other = corner[SIDE + 1] + (corner[SIDE + 2] - corner[SIDE + 1]) * b;
    return one + (other - one) * a;
}

static float grain(const Scene *scene, const Pixel *pixel)
{
    const float *n = pixel->normal, *p = pixel->point;
    float x = n[0] < 0.0f ? -n[0] : n[0], y = n[1] < 0.0f ? -n[1] : n[1], z = n[2] < 0.0f ? -n[2] : n[2];
    int level = z >= 0.5f;
    float u = !level && x > y ? p[1] : p[0], v = level ? p[1] : p[2], tone = 1.0f;
    for (int i = 0; i < 2; i++) {
        float per_metre = 1.0f / (float)scene->set->node[i], blur = pixel->footprint * 0.125f * per_metre;
        float left = blur > 1.0f ? (float)scene->set->deviation[i] / blur : (float)scene->set->deviation[i];
        tone += left * between(scene->views[GRAIN], u * per_metre, v * per_metre);
    }
    return at_least(tone, 0.1f);
}

static long clipped(long index, long count) { return index < 0 ? 0 : index >= count ? count - 1 : index; }

static float bend(const Scene *scene, const Pixel *pixel)
{
    const Settings *s = scene->set;
    const float *depths = scene->views[DEPTHS];
    long rows = (long)s->rows, columns = (long)s->columns;
    long row = clipped((long)((pixel->point[0] - s->north_min) * s->scale + 0.5), rows);
    long column = clipped((long)((pixel->point[1] - s->east_min) * s->scale + 0.5), columns);
    const float *here = depths + row * columns;
    float around = 0.25f * (depths[clipped(row - 1, rows) * columns + column] + depths[clipped(row + 1, rows) * columns + column]
                            + here[clipped(column - 1, columns)] + here[clipped(column + 1, columns)]);
    float height = (around - here[column]) * (float)s->scale;
    if (height != height)
        return 1.0f;
    return at_most(at_least(1.0f + 3.0f * height, 0.7f), 1.3f);
}

/* Tiles of slopes to the north, to the east and of brightness follow each other, of each all its levels. */
static float textured(const Scene *scene, const Pixel *pixel)
{
    const Settings *s = scene->set;
    const Size *size = scene->sizes;
    while (pixel->footprint >= size->most && size < scene->sizes + SIZES - 1)
        size++;
    size_t all = scene->texture / 3;
    const float *tiles = (const float *)scene->views[TEXTURE] + size->first;
    long side = size->side, row = whole(pixel->point[0] * size->scale), column = whole(pixel->point[1] * size->scale);
    size_t node = (size_t)((row & (side - 1)) * side + (column & (side - 1)));
    size_t patch = (size_t)(((row >> 1) & (side - 1)) * side + ((column >> 1) & (side - 1)));
    float north = (float)s->height * tiles[node], east = (float)s->height * tiles[all + node];
    if (size->ripple != 0.0f) {
        float rise = size->ripple * cosf((float)s->wave[0] * pixel->point[0] + (float)s->wave[1] * pixel->point[1]);
        north += (float)s->wave[0] * rise, east += (float)s->wave[1] * rise;
    }
    float root = sqrtf(1.0f + north * north + east * east);
    float lean = at_most(at_least(0.5f * (north + east), -0.5f), 0.5f);
    return tiles[2 * all + patch] * (0.8f / root + 0.2f + lean);
}

/* exp(-coefficient distance) out of its table. */
static float faded(const Scene *scene, int table, float distance)
{
    const float *row = (const float *)scene->views[FADES] + table * (STEPS + 1);
    float place = at_most(distance * (float)scene->set->per_metre, (float)STEPS - 1e-3f);
    int first = (int)place;
    return row[first] + (row[first + 1] - row[first]) * (place - (float)first);
}

static void read_pixel(const Scene *scene, Py_ssize_t i, Pixel *pixel)
{
    const Settings *s = scene->set;
    const float *toward = (const float *)scene->views[TOWARD] + 3 * i;
    double along[3], distance = scene->wide_distances ? ((const double *)scene->views[DISTANCES])[i]
                                                      : (double)((const float *)scene->views[DISTANCES])[i];
    pixel->object = ((const int32_t *)scene->views[OBJECTS])[i];
    pixel->distance = (float)distance;
    pixel->footprint = (float)distance * (float)s->pixel;
    pixel->facing = 0.0f;
    for (int axis = 0; axis < 3; axis++) {
        const double *row = s->rotation + 3 * axis;
        along[axis] = row[0] * toward[0] + row[1] * toward[1] + row[2] * toward[2];
        pixel->point[axis] = (float)(s->origin[axis] + distance * along[axis]);
        pixel->normal[axis] = scene->wide_normals ? (float)((const double *)scene->views[NORMALS])[3 * i + axis]
                                                  : ((const float *)scene->views[NORMALS])[3 * i + axis];
        pixel->facing -= pixel->normal[axis] * (float)along[axis];
    }
}

static void shade_pixel(const Scene *scene, Py_ssize_t i)
{
    const Settings *s = scene->set;
    float *out = (float *)scene->views[OUT] + 3 * i;
    Pixel pixel;
    read_pixel(scene, i, &pixel);
    if (pixel.object == NOTHING) {
        for (int c = 0; c < CHANNELS; c++)
            out[c] = (float)s->veil[c];
        return;
    }
    int surface = pixel.object == (long)s->surface;
    float tone = surface ? 1.0f : grain(scene, &pixel), rock = 0.0f;
    if (pixel.object == SEABED) {
        if (scene->depths)
            tone *= bend(scene, &pixel);
        if (scene->texture)
            tone *= textured(scene, &pixel);
        rock = at_most(at_least((0.93f + pixel.normal[2]) / 0.12f, 0.0f), 1.0f);
    }
    float day = surface ? tone : tone * (0.6f - 0.4f * pixel.normal[2]);
    float near = at_least(pixel.distance, 0.05f);
    float lit = surface ? 0.0f : tone * (float)s->lamps * at_least(pixel.facing, 0.0f) / (near * near);
    const float *colour = (const float *)scene->views[COLOURS] + 3 * pixel.object;
    for (int c = 0; c < CHANNELS; c++) {
        float sent = day * (float)s->light[c];
        if (lit > 0.0f)
            sent += lit * faded(scene, c, near);
        sent *= colour[c] + rock * (float)s->rock[c];
        float veil = (float)s->veil[c] * (1.0f - faded(scene, CHANNELS + c, pixel.distance));
        out[c] = sent * faded(scene, c, pixel.distance) + veil;
    }
}

/* Sizes double from the finest on; levels change where the logarithm of their ratio rounds up. */
static void set_sizes(Scene *scene)
{
    const Settings *s = scene->set;
    size_t first = 0;
    int level = 0;
    for (int i = 0; i < SIZES; i++) {
        double size = s->finest * (double)(1L << i), turn = 3.141592653589793 * size / s->ripple_length;
        for (; level < LEVELS - 1 && size / s->texture_node >= 1.4142135623730951 * (double)(1 << level); level++)
            first += (size_t)(SIDE >> level) * (size_t)(SIDE >> level);
        double left = s->ripple != 0.0 && size < s->ripple_length ? s->ripple * sin(turn) / turn : 0.0;
        float scale = (float)(1.0 / (s->texture_node * (double)(1 << level)));
        scene->sizes[i] = (Size){first, SIDE >> level, (float)(size * 1.4142135623730951), scale, (float)left};
    }
}

/* Checks the sizes of all views against the number of pixels; 0 with an exception set if one is wrong. */
static int fill(Scene *scene, const Py_buffer *views, Py_ssize_t *count)
{
    const Settings *s = scene->set;
    Py_ssize_t n = *count = views[OBJECTS].len / 4, tiles = 0;
    for (int level = 0; level < LEVELS; level++)
        tiles += (Py_ssize_t)(SIDE >> level) * (SIDE >> level);
    for (int i = 0; i < VIEWS; i++)
        scene->views[i] = views[i].buf;
    set_sizes(scene);
    scene->wide_distances = views[DISTANCES].len == 8 * n, scene->wide_normals = views[NORMALS].len == 24 * n;
    scene->depths = (size_t)views[DEPTHS].len / 4, scene->texture = (size_t)views[TEXTURE].len / 4;
    int right = (scene->wide_distances || views[DISTANCES].len == 4 * n) && (scene->wide_normals || views[NORMALS].len == 12 * n)
                && views[TOWARD].len == 12 * n && views[OUT].len == 12 * n && views[FADES].len == 4 * 2 * CHANNELS * (STEPS + 1)
                && views[GRAIN].len == 4 * (SIDE + 1) * (SIDE + 1)
                && (scene->texture == 0 || views[TEXTURE].len == 12 * tiles)
                && (scene->depths == 0 || (double)scene->depths == s->rows * s->columns);
    const int32_t *objects = views[OBJECTS].buf;
    for (Py_ssize_t i = 0; right && i < n; i++)
        right = objects[i] >= NOTHING && objects[i] < views[COLOURS].len / 12;
    if (!right)
        PyErr_Format(PyExc_ValueError, "shade: a buffer has not the size of %zd pixels, or an object no colour", n);
    return right;
}

static PyObject *shade(PyObject *self, PyObject *arguments)
{
    PyObject *numbers, *objects[VIEWS];
    Py_buffer views[VIEWS] = {{0}};
    double settings[SETTINGS];
    Settings set;
    (void)self;
    if (!PyArg_ParseTuple(arguments, "OOOOOOOOOOO", &numbers, &objects[0], &objects[1], &objects[2], &objects[3], &objects[4],
                          &objects[5], &objects[6], &objects[7], &objects[8], &objects[9])
        || !read_numbers(numbers, settings, SETTINGS))
        return NULL;
    memcpy(&set, settings, sizeof set);
    Scene scene = {.set = &set};
    Py_ssize_t count = 0;
    int ok = 1;
    for (int i = 0; ok && i < VIEWS; i++)
        ok = PyObject_GetBuffer(objects[i], &views[i], i == OUT ? PyBUF_WRITABLE : PyBUF_SIMPLE) == 0;
    if (ok && (ok = fill(&scene, views, &count)))
        for (Py_ssize_t i = 0; i < count; i++)
            shade_pixel(&scene, i);
    for (int i = 0; i < VIEWS; i++)
        PyBuffer_Release(&views[i]);
    if (!ok)
        return NULL;
    Py_RETURN_NONE;
}

/* --- what a sensor records */

enum { RADIANCE, FALLOFF, NOISE, GREY, PIXELS, PARTS };

/* Light of n pixels by a lens' falloff and a gain, with noise (three rows of n), as bytes out of a table. */
static void expose(const Py_buffer *views, Py_ssize_t n, float gain, float full_well, float dark, float steps)
{
    const float *radiance = views[RADIANCE].buf, *falloff = views[FALLOFF].buf, *noise = views[NOISE].buf;
    const unsigned char *grey = views[GREY].buf;
    unsigned char *pixels = views[PIXELS].buf;
    for (Py_ssize_t i = 0; i < n; i++)
        for (int c = 0; c < CHANNELS; c++) {
            float signal = radiance[3 * i + c] * falloff[i] * gain;
            signal += sqrtf(signal / full_well + dark) * noise[c * n + i];
            pixels[3 * i + c] = grey[(int)(at_most(at_least(signal, 0.0f), 1.0f) * steps)];
        }
}

static PyObject *develop(PyObject *self, PyObject *arguments)
{
    PyObject *objects[PARTS];
    Py_buffer views[PARTS] = {{0}};
    float gain, full_well, dark;
    (void)self;
    if (!PyArg_ParseTuple(arguments, "fffOOOOO", &gain, &full_well, &dark, &objects[0], &objects[1], &objects[2], &objects[3],
                          &objects[4]))
        return NULL;
    int ok = 1;
    for (int i = 0; ok && i < PARTS; i++)
        ok = PyObject_GetBuffer(objects[i], &views[i], i == PIXELS ? PyBUF_WRITABLE : PyBUF_SIMPLE) == 0;
    Py_ssize_t n = views[FALLOFF].len / 4;
    if (ok && (views[RADIANCE].len != 12 * n || views[NOISE].len != 12 * n || views[PIXELS].len != 3 * n || views[GREY].len < 2)) {
        PyErr_Format(PyExc_ValueError, "develop: a buffer has not the size of %zd pixels", n);
        ok = 0;
    }
    if (ok)
        expose(views, n, gain, full_well, dark, (float)(views[GREY].len - 1));
    for (int i = 0; i < PARTS; i++)
        PyBuffer_Release(&views[i]);
    if (!ok)
        return NULL;
    Py_RETURN_NONE;
}

static PyMethodDef functions[] = {
    {"develop", develop, METH_VARARGS, "develop(gain, full_well, dark, radiance, falloff, noise, grey, pixels)"},
    {"shade", shade, METH_VARARGS, "shade(settings, distances, normals, objects, toward, colours, grain, fades, depths, texture, out)"},
    {NULL, NULL, 0, NULL},
};

static PyModuleDef_Slot slots[] = {{0, NULL}};

static PyModuleDef module = {
    PyModuleDef_HEAD_INIT, "sim.native._picture", "A camera's light in C.", 0, functions, slots, NULL, NULL, NULL,
};

PyMODINIT_FUNC PyInit__picture(void)
{
    return PyModuleDef_Init(&module);
}
