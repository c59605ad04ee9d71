/* The Python module sim.native._rays: the type Caster, with rays.h. */

#include "numbers.h"

#include <stdlib.h>

#include "buffer.h"
#include "rays_bundle.h"
#include "rays_tree.h"

/* A caster reads memory of other objects. The buffer interface prevents their resizing as long as it holds them. */
enum { DEPTHS, SOLIDS, NODES, GROUPS, BUFFERS };

typedef struct {
    PyObject_HEAD
    Py_buffer buffers[BUFFERS];
    Geometry geometry;
} Caster;

/* Gets a buffer that must consist of whole records; returns 0 with an exception set if it does not. */
static int get_records(PyObject *object, Py_buffer *view, size_t record, const char *name)
{
    if (PyObject_GetBuffer(object, view, PyBUF_SIMPLE) != 0)
        return 0;
    if ((size_t)view->len % record == 0)
        return 1;
    PyErr_Format(PyExc_ValueError, "%s: %zd bytes are no records of %zu bytes", name, view->len, record);
    return 0;
}

/* Allocates one number for each block of cells of each size; 0 means that it is not known yet. */
static int allocate_blocks(Ground *ground)
{
    if (ground->rows == 0)
        return 1;
    for (int level = 0; level < LEVELS; level++) {
        long rows = ((ground->rows - 2) >> SHIFT[level]) + 1;
        ground->block_columns[level] = ((ground->columns - 2) >> SHIFT[level]) + 1;
        ground->least[level] = calloc((size_t)rows * (size_t)ground->block_columns[level], sizeof(float));
        if (ground->least[level] == NULL) {
            PyErr_NoMemory();
            return 0;
        }
    }
    return 1;
}

static int fill(Caster *caster, PyObject *const objects[BUFFERS])
{
    static const size_t records[BUFFERS] = {sizeof(float), sizeof(Solid), sizeof(Node), sizeof(Group)};
    static const char *const names[BUFFERS] = {"depths", "solids", "nodes", "triangles"};
    Geometry *geometry = &caster->geometry;
    Ground *ground = &geometry->ground;
    for (int i = 0; i < BUFFERS; i++)
        if (!get_records(objects[i], &caster->buffers[i], records[i], names[i]))
            return 0;
    int flat = ground->rows == 0 && ground->columns == 0;
    int beyond = ground->rows > INT32_MAX || ground->columns > INT32_MAX; /* the product of both would overflow */
    if (beyond || (!flat && (ground->rows < 2 || ground->columns < 2))
        || (long long)(caster->buffers[DEPTHS].len / (Py_ssize_t)sizeof(float)) != (long long)ground->rows * ground->columns) {
        PyErr_Format(PyExc_ValueError, "depths: %zd bytes are not %ld x %ld of 4", caster->buffers[DEPTHS].len, ground->rows,
                     ground->columns);
        return 0;
    }
    ground->depths = caster->buffers[DEPTHS].buf;
    geometry->solids = caster->buffers[SOLIDS].buf;
    geometry->count = (long)(caster->buffers[SOLIDS].len / (Py_ssize_t)sizeof(Solid));
    geometry->trees.nodes = caster->buffers[NODES].buf;
    geometry->trees.groups = caster->buffers[GROUPS].buf;
    return allocate_blocks(ground);
}

static PyObject *caster_new(PyTypeObject *type, PyObject *arguments, PyObject *keywords)
{
    PyObject *objects[BUFFERS];
    Ground ground = {0};
    (void)keywords;
    if (!PyArg_ParseTuple(arguments, "(lldddd)OOOO", &ground.rows, &ground.columns, &ground.north_min, &ground.east_min,
                          &ground.scale, &ground.outside, &objects[DEPTHS], &objects[SOLIDS], &objects[NODES],
                          &objects[GROUPS]))
        return NULL;
    PyObject *self = PyType_GenericAlloc(type, 0);
    if (self == NULL)
        return NULL;
    ((Caster *)self)->geometry.ground = ground;
    if (!fill((Caster *)self, objects))
        Py_CLEAR(self);
    return self;
}

static void caster_dealloc(PyObject *self)
{
    PyTypeObject *type = Py_TYPE(self);
    Caster *caster = (Caster *)self;
    for (int i = 0; i < BUFFERS; i++)
        PyBuffer_Release(&caster->buffers[i]); /* does nothing for a buffer that was never acquired */
    for (int level = 0; level < LEVELS; level++)
        free(caster->geometry.ground.least[level]);
    PyObject_Free(self);
    Py_DECREF(type);
}

/* The output arrays of a cast; those that are not requested are NULL. */
typedef struct {
    double *distances, *points, *normals;
    int32_t *objects;
} Results;

static void store_result(const Geometry *geometry, const double *origin, const double *along, const Hit *hit, Py_ssize_t ray,
                   const Results *to)
{
    to->distances[ray] = hit->distance;
    if (to->points == NULL)
        return;
    double *point = to->points + 3 * ray, *out = to->normals + 3 * ray;
    to->objects[ray] = (int32_t)owner(geometry, hit->object);
    set(point, NAN, NAN, NAN);
    set(out, NAN, NAN, NAN);
    if (hit->object == NOTHING)
        return;
    for (int axis = 0; axis < 3; axis++)
        point[axis] = origin[axis] + hit->distance * along[axis];
    normal(geometry, hit, along, point, out);
}

/* The input of a cast. */
typedef struct {
    double origin[3], rotation[9], reach;
    const double *directions;
    Py_ssize_t rays;
} Request;

static void cast_all(const Geometry *geometry, const Request *request, Near *near, const Results *to)
{
    find_near_solids(geometry, request->origin, request->reach, near);
    for (Py_ssize_t first = 0; first < request->rays; first += BUNDLE) {
        Py_ssize_t left = request->rays - first;
        Bundle bundle;
        bundle.count = left < BUNDLE ? (int)left : BUNDLE;
        Hit hits[BUNDLE];
        for (int i = 0; i < bundle.count; i++)
            rotate_to_world(request->rotation, request->directions + 3 * (first + i), bundle.along[i]);
        trace_bundle(geometry, near, request->origin, &bundle, request->reach, hits);
        for (int i = 0; i < bundle.count; i++)
            store_result(geometry, request->origin, bundle.along[i], &hits[i], first + i, to);
    }
}

enum { DIRECTIONS, DISTANCES, POINTS, NORMALS, OBJECTS, VIEWS };

/* Gets the buffers and casts; the caller releases the buffers. */
static int cast_views(const Geometry *geometry, PyObject *const *arguments, int count, Py_buffer *views)
{
    static const Py_ssize_t sizes[VIEWS] = {24, 8, 24, 24, 4}; /* bytes a ray */
    Request request = {.reach = PyFloat_AsDouble(arguments[3])};
    PyObject *const objects[VIEWS] = {arguments[2], arguments[4], count > 5 ? arguments[5] : NULL,
                                      count > 5 ? arguments[6] : NULL, count > 5 ? arguments[7] : NULL};
    if ((request.reach == -1.0 && PyErr_Occurred()) || !read_numbers(arguments[0], request.origin, 3)
        || !read_numbers(arguments[1], request.rotation, 9))
        return 0;
    for (int i = 0; i < VIEWS && objects[i] != NULL; i++) {
        if (PyObject_GetBuffer(objects[i], &views[i], i == DIRECTIONS ? PyBUF_SIMPLE : PyBUF_WRITABLE) != 0)
            return 0;
        if (views[i].len % sizes[i] != 0 || views[i].len / sizes[i] != views[DIRECTIONS].len / 24) {
            PyErr_Format(PyExc_ValueError, "buffer %d has %zd bytes, %zd a ray are needed", i, views[i].len, sizes[i]);
            return 0;
        }
    }
    Near near;
    if (!allocate_near_solids(geometry, &near)) {
        PyErr_NoMemory();
        return 0;
    }
    request.directions = views[DIRECTIONS].buf;
    request.rays = views[DIRECTIONS].len / 24;
    const Results to = {views[DISTANCES].buf, views[POINTS].buf, views[NORMALS].buf, views[OBJECTS].buf};
    cast_all(geometry, &request, &near, &to);
    free(near.numbers);
    return 1;
}

static PyObject *caster_cast(PyObject *self, PyObject *const *arguments, Py_ssize_t count)
{
    Py_buffer views[VIEWS] = {{0}};
    if (count != 5 && count != 8)
        return PyErr_Format(PyExc_TypeError, "cast() takes origin, rotation, directions, reach, distances, and all or none "
                                             "of points, normals, objects");
    int ok = cast_views(&((Caster *)self)->geometry, arguments, (int)count, views);
    for (int i = 0; i < VIEWS; i++)
        PyBuffer_Release(&views[i]);
    if (!ok)
        return NULL;
    Py_RETURN_NONE;
}

static void release_caster(PyObject *capsule)
{
    Py_XDECREF((PyObject *)PyCapsule_GetContext(capsule));
}

static PyObject *caster_geometry(PyObject *self, PyObject *nothing)
{
    (void)nothing;
    PyObject *capsule = PyCapsule_New(&((Caster *)self)->geometry, GEOMETRY, release_caster);
    if (capsule != NULL && PyCapsule_SetContext(capsule, self) == 0)
        Py_INCREF(self);
    return capsule;
}

static PyObject *grow(PyObject *module, PyObject *arguments)
{
    Py_buffer mesh = {0}, nodes = {0}, groups = {0};
    Grower grower = {0};
    PyObject *result = NULL;
    Item *items = NULL;
    (void)module;
    if (!PyArg_ParseTuple(arguments, "y*w*w*ll", &mesh, &nodes, &groups, &grower.root, &grower.group))
        return NULL;
    grower.mesh = mesh.buf, grower.nodes = nodes.buf, grower.groups = groups.buf;
    const Py_ssize_t count = mesh.len / 72, needed = groups_of((long)count);
    if (count < 1 || mesh.len % 72 != 0 || grower.root < 0 || grower.group < 0
        || nodes.len / (Py_ssize_t)sizeof(Node) - grower.root < needed
        || groups.len / (Py_ssize_t)sizeof(Group) - grower.group < needed)
        PyErr_SetString(PyExc_ValueError, "grow(): nine doubles a triangle, and room for a node and a group for eight");
    else if (!(items = malloc((size_t)count * sizeof *items)))
        PyErr_NoMemory();
    else {
        grow_tree(&grower, items, (long)count);
        result = PyLong_FromLong(grower.root);
    }
    free(items);
    PyBuffer_Release(&mesh), PyBuffer_Release(&nodes), PyBuffer_Release(&groups);
    return result;
}

static PyMethodDef module_methods[] = {
    {"grow", grow, METH_VARARGS, "grow(mesh, nodes, triangles, root, group): as sim.rays.tree.grow."},
    {NULL, NULL, 0, NULL},
};

static PyMethodDef caster_methods[] = {
    {"geometry", caster_geometry, METH_NOARGS, "geometry(): a capsule for sim.native._picture, which keeps the caster."},
    {"cast", (PyCFunction)(void (*)(void))caster_cast, METH_FASTCALL,
     "cast(origin, rotation, directions, reach, distances[, points, normals, objects]): as sim.rays.single.cast."},
    {NULL, NULL, 0, NULL},
};

static PyType_Slot caster_slots[] = {
    {Py_tp_doc, "Rays: Caster((rows, columns, north_min, east_min, scale, depth), depths, solids, nodes, triangles)."},
    {Py_tp_new, caster_new},
    {Py_tp_dealloc, caster_dealloc},
    {Py_tp_methods, caster_methods},
    {0, NULL},
};

static PyType_Spec caster_spec = {
    "sim.native._rays.Caster", sizeof(Caster), 0, Py_TPFLAGS_DEFAULT | Py_TPFLAGS_IMMUTABLETYPE, caster_slots,
};

static int module_exec(PyObject *module)
{
    return add_type(module, &caster_spec, "Caster") ? 0 : -1;
}

static PyModuleDef_Slot module_slots[] = {{Py_mod_exec, module_exec}, {0, NULL}};

static PyModuleDef module = {
    PyModuleDef_HEAD_INIT, "sim.native._rays", "Rays in C. " SOURCE_BYTES, 0, module_methods, module_slots, NULL, NULL, NULL,
};

PyMODINIT_FUNC PyInit__rays(void)
{
    return PyModuleDef_Init(&module);
}
