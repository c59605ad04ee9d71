/* The Python module sim.native._picture: shading.h and exposure.h for Python. */

#include "numbers.h"

#include "buffer.h"
#include "exposure.h"
#include "rays_bundle.h"
#include "shading.h"

enum { MAX_VIEWS = 10 };

/* Gets `count` buffers, the last `written` of them writable; returns 0 with an exception set on failure. */
static int get_views(PyObject *const *objects, Py_buffer *views, int count, int written)
{
    for (int i = 0; i < count; i++)
        if (PyObject_GetBuffer(objects[i], &views[i], i >= count - written ? PyBUF_WRITABLE : PyBUF_SIMPLE) != 0)
            return 0;
    return 1;
}

/* Releases the buffers; returns None, or NULL if an exception is set. */
static PyObject *release(Py_buffer *views, int ok)
{
    for (int i = 0; i < MAX_VIEWS; i++)
        PyBuffer_Release(&views[i]); /* does nothing for a buffer that was never acquired */
    if (!ok)
        return NULL;
    Py_RETURN_NONE;
}

/* --- light */

enum { COLOURS, GRAIN, DECAYS, DEPTHS, TEXTURE, DIRECTIONS, RADIANCE, RANGES, HIT_OBJECTS, PICTURE_VIEWS };

static int set_appearance(Appearance *appearance, Settings *settings, PyObject *numbers, const Py_buffer *views)
{
    double all[SETTINGS];
    if (!read_numbers(numbers, all, SETTINGS))
        return 0;
    memcpy(settings, all, sizeof *settings);
    Py_ssize_t tiles = 0, depths = views[DEPTHS].len, texture = views[TEXTURE].len;
    for (int level = 0; level < TILE_LEVELS; level++)
        tiles += (Py_ssize_t)(TILE_SIDE >> level) * (TILE_SIDE >> level);
    if (views[DECAYS].len != 4 * DECAYS_PER_STEP * (DECAY_STEPS + 1) || views[GRAIN].len != 4 * (TILE_SIDE + 1) * (TILE_SIDE + 1)
        || (texture != 0 && texture != 12 * tiles) || (depths != 0 && (double)depths != 4.0 * settings->rows * settings->columns)) {
        PyErr_SetString(PyExc_ValueError, "a buffer of the surfaces' appearance has a wrong size");
        return 0;
    }
    appearance->settings = settings, appearance->colours = views[COLOURS].buf, appearance->grain = views[GRAIN].buf;
    appearance->decays = views[DECAYS].buf, appearance->depths = depths ? views[DEPTHS].buf : NULL;
    appearance->texture = texture ? views[TEXTURE].buf : NULL, appearance->texture_size = (size_t)texture / 4;
    set_numbers(appearance);
    return 1;
}

static int raise_size_error(Py_ssize_t n)
{
    PyErr_Format(PyExc_ValueError, "a buffer has not the size of %zd pixels, or an object no colour", n);
    return 0;
}

/* Computes the pixels of traced rays. Each loop is short, so that the processor works on several rays at once. */
static void compute_pixels(const Geometry *geometry, const double *origin, const Bundle *bundle, const Hit *hits, Pixel *pixels)
{
    double points[BUNDLE][3], normals[BUNDLE][3];
    for (int i = 0; i < bundle->count; i++) {
        for (int axis = 0; axis < 3; axis++)
            points[i][axis] = origin[axis] + hits[i].distance * bundle->along[i][axis];
        if (hits[i].object != NOTHING)
            normal(geometry, &hits[i], bundle->along[i], points[i], normals[i]);
        else
            set(normals[i], 0.0, 0.0, 0.0);
    }
    for (int i = 0; i < bundle->count; i++) {
        Pixel *pixel = &pixels[i];
        pixel->distance = (float)hits[i].distance, pixel->object = owner(geometry, hits[i].object), pixel->facing = 0.0f;
        for (int axis = 0; axis < 3; axis++) {
            pixel->point[axis] = (float)points[i][axis], pixel->normal[axis] = (float)normals[i][axis];
            pixel->facing -= pixel->normal[axis] * (float)bundle->along[i][axis];
        }
    }
}

/* Traces rays in bundles and shades each bundle while its hits are still in the cache. */
static void render_all(const Appearance *appearance, const Geometry *geometry, Near *near, const Py_buffer *views, Py_ssize_t n)
{
    const Settings *s = appearance->settings;
    const double *directions = views[DIRECTIONS].buf;
    double *ranges = views[RANGES].buf;
    int32_t *hit_objects = views[HIT_OBJECTS].buf;
    float *out = views[RADIANCE].buf;
    Bundle bundle;
    Hit hits[BUNDLE];
    Pixel pixels[BUNDLE];
    for (Py_ssize_t first = 0; first < n; first += BUNDLE) {
        bundle.count = n - first < BUNDLE ? (int)(n - first) : BUNDLE;
        for (int i = 0; i < bundle.count; i++)
            rotate_to_world(s->rotation, directions + 3 * (first + i), bundle.along[i]);
        trace_bundle(geometry, near, s->origin, &bundle, s->reach, hits);
        compute_pixels(geometry, s->origin, &bundle, hits, pixels);
        for (int i = 0; i < bundle.count; i++) {
            shade_pixel(appearance, &pixels[i], out + 3 * (first + i));
            ranges[first + i] = hits[i].distance, hit_objects[first + i] = (int32_t)pixels[i].object;
        }
    }
}

static int check_rays(const Geometry *geometry, const Near *near, const Py_buffer *views, Py_ssize_t n)
{
    int ok = views[DIRECTIONS].len == 24 * n && views[RADIANCE].len == 12 * n && views[RANGES].len == 8 * n;
    for (long i = 0; ok && i < near->count; i++)
        ok = owner(geometry, near->numbers[i] + 1) < views[COLOURS].len / 12;
    return ok || raise_size_error(n);
}

static PyObject *picture(PyObject *self, PyObject *const *arguments, Py_ssize_t count)
{
    Py_buffer views[MAX_VIEWS] = {{0}};
    Settings settings;
    Appearance appearance;
    Near near = {NULL, 0};
    (void)self;
    if (count != 2 + PICTURE_VIEWS)
        return PyErr_Format(PyExc_TypeError, "picture() takes %d arguments", 2 + PICTURE_VIEWS);
    const Geometry *geometry = PyCapsule_GetPointer(arguments[0], GEOMETRY);
    int ok = geometry != NULL && get_views(arguments + 2, views, PICTURE_VIEWS, 3)
             && set_appearance(&appearance, &settings, arguments[1], views);
    Py_ssize_t n = views[HIT_OBJECTS].len / 4;
    if (ok && !allocate_near_solids(geometry, &near))
        ok = 0, PyErr_NoMemory();
    if (ok)
        find_near_solids(geometry, settings.origin, settings.reach, &near);
    if (ok && (ok = check_rays(geometry, &near, views, n))) {
        Py_BEGIN_ALLOW_THREADS
        render_all(&appearance, geometry, &near, views, n);
        Py_END_ALLOW_THREADS
    }
    free(near.numbers);
    return release(views, ok);
}

/* --- what a sensor records */

enum { LIGHT, FALLOFF, AXIAL, DISTANCE, NOISE, GREY, PIXELS, DEPTH, DEVELOP_VIEWS };

static PyObject *develop(PyObject *self, PyObject *arguments)
{
    PyObject *objects[DEVELOP_VIEWS];
    Py_buffer views[MAX_VIEWS] = {{0}};
    unsigned long long key;
    Exposure e = {0};
    (void)self;
    if (!PyArg_ParseTuple(arguments, "K(fffff)OOOOOOOO", &key, &e.gain, &e.full_well, &e.dark, &e.depth_noise, &e.reach,
                          &objects[0], &objects[1], &objects[2], &objects[3], &objects[4], &objects[5], &objects[6], &objects[7]))
        return NULL;
    int ok = get_views(objects, views, DEVELOP_VIEWS, 2);
    Py_ssize_t n = views[FALLOFF].len / 4;
    if (ok && (views[LIGHT].len != 12 * n || views[AXIAL].len != 4 * n || views[DISTANCE].len != 8 * n || views[PIXELS].len != 3 * n
               || views[DEPTH].len != 4 * n || views[NOISE].len != 4 * QUANTILES || views[GREY].len != GREYS))
        ok = raise_size_error(n);
    if (ok) {
        e.key = key, e.radiance = views[LIGHT].buf, e.falloff = views[FALLOFF].buf, e.axial = views[AXIAL].buf;
        e.ranges = views[DISTANCE].buf, e.quantiles = views[NOISE].buf, e.grey = views[GREY].buf;
        e.pixels = views[PIXELS].buf, e.depths = views[DEPTH].buf;
        Py_BEGIN_ALLOW_THREADS
        develop_all(&e, (size_t)n);
        Py_END_ALLOW_THREADS
    }
    return release(views, ok);
}

static PyMethodDef functions[] = {
    {"develop", develop, METH_VARARGS,
     "develop(key, (gain, full_well, dark, depth_noise, reach), light, falloff, axial, ranges, quantiles, grey, pixels, depths)"},
    {"picture", (PyCFunction)(void (*)(void))picture, METH_FASTCALL,
     "picture(geometry, settings, colours, grain, decays, depths, texture, directions, radiance, ranges, objects)"},
    {NULL, NULL, 0, NULL},
};

static PyModuleDef_Slot slots[] = {{0, NULL}};

static PyModuleDef module = {
    PyModuleDef_HEAD_INIT, "sim.native._picture", "A camera's light in C. " SOURCE_BYTES, 0, functions, slots,
    NULL, NULL, NULL,
};

PyMODINIT_FUNC PyInit__picture(void)
{
    return PyModuleDef_Init(&module);
}
