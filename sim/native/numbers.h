/* Convert numbers between Python and C, and helpers for all our Python types. Include it first. */

#define PY_SSIZE_T_CLEAN
#define Py_LIMITED_API 0x030A0000
#include <Python.h>
#include <stddef.h>
#include <string.h>

/* Reads `size` numbers from a Python sequence; 0 with an exception set if it contains anything else. */
static inline int read_numbers(PyObject *sequence, double *out, Py_ssize_t size)
{
    PyObject *items = PySequence_Fast(sequence, "a sequence of numbers is needed");
    if (items == NULL)
        return 0;
    PyObject *(*item)(PyObject *, Py_ssize_t) = PyList_Check(items) ? PyList_GetItem : PyTuple_GetItem;
    Py_ssize_t count = PySequence_Size(items);
    if (count != size)
        PyErr_Format(PyExc_ValueError, "%zd numbers are needed, found %zd", size, count);
    for (Py_ssize_t i = 0; count == size && i < size; i++) {
        PyObject *number = item(items, i);
        out[i] = number == NULL ? -1.0 : PyFloat_AsDouble(number);
        if (out[i] == -1.0 && PyErr_Occurred())
            count = -1;
    }
    Py_DECREF(items);
    return count == size;
}

static inline PyObject *new_list(const double *numbers, Py_ssize_t size)
{
    PyObject *list = PyList_New(size);
    for (Py_ssize_t i = 0; list != NULL && i < size; i++) {
        PyObject *number = PyFloat_FromDouble(numbers[i]);
        if (number == NULL)
            Py_CLEAR(list);
        else
            PyList_SetItem(list, i, number);
    }
    return list;
}

static inline PyObject *new_number_tuple(const double *numbers, Py_ssize_t size)
{
    PyObject *tuple = PyTuple_New(size);
    for (Py_ssize_t i = 0; tuple != NULL && i < size; i++) {
        PyObject *number = PyFloat_FromDouble(numbers[i]);
        if (number == NULL)
            Py_CLEAR(tuple);
        else
            PyTuple_SetItem(tuple, i, number);
    }
    return tuple;
}

static inline PyObject *new_whole_tuple(const long *numbers, Py_ssize_t size)
{
    PyObject *tuple = PyTuple_New(size);
    for (Py_ssize_t i = 0; tuple != NULL && i < size; i++) {
        PyObject *number = PyLong_FromLong(numbers[i]);
        if (number == NULL)
            Py_CLEAR(tuple);
        else
            PyTuple_SetItem(tuple, i, number);
    }
    return tuple;
}

/* A NamedTuple of `items` (a reference that it takes), made as a tuple without calling the class's own __new__. */
static inline PyObject *new_record(PyTypeObject *type, PyObject *items)
{
    newfunc new = (newfunc)PyType_GetSlot(&PyTuple_Type, Py_tp_new);
    PyObject *arguments = items != NULL ? PyTuple_Pack(1, items) : NULL;
    PyObject *record = arguments != NULL ? new(type, arguments, NULL) : NULL;
    Py_XDECREF(arguments);
    Py_XDECREF(items);
    return record;
}

static inline void deallocate(PyObject *self)
{
    PyTypeObject *type = Py_TYPE(self);
    PyObject_Free(self);
    Py_DECREF(type);
}

typedef struct {
    const char *data;
    Py_ssize_t size;
} Bytes;

/* A converter for the format O& of PyArg_ParseTuple. The format y# is not used: compiled with the headers of 3.13, it
 * calls a function that earlier versions have under another name. */
static inline int read_bytes(PyObject *object, void *bytes)
{
    char *data;
    if (PyBytes_AsStringAndSize(object, &data, &((Bytes *)bytes)->size) != 0)
        return 0;
    ((Bytes *)bytes)->data = data;
    return 1;
}

/* The beginning of every type that holds records of one kind. */
typedef struct {
    PyObject_HEAD
    Py_ssize_t count;
} Records;

/* A new object of `type` with a copy of the records in `numbers`, of `size` bytes each, at `offset`. */
static inline PyObject *new_with_records(PyTypeObject *type, Bytes numbers, size_t size, size_t max_count,
                                         size_t offset)
{
    Py_ssize_t count = numbers.size / (Py_ssize_t)size;
    if (numbers.size % (Py_ssize_t)size != 0 || count > (Py_ssize_t)max_count)
        return PyErr_Format(PyExc_ValueError, "up to %zu records of %zu bytes are needed, found %zd bytes", max_count, size,
                            numbers.size);
    PyObject *self = PyType_GenericAlloc(type, 0);
    if (self != NULL) {
        ((Records *)self)->count = count;
        memcpy((char *)self + offset, numbers.data, (size_t)numbers.size);
    }
    return self;
}

/* The same for a type whose only argument is the bytes of its records. */
static inline PyObject *new_of_records(PyTypeObject *type, PyObject *arguments, size_t size, size_t max_count, size_t offset)
{
    Bytes numbers;
    if (!PyArg_ParseTuple(arguments, "O&", read_bytes, &numbers))
        return NULL;
    return new_with_records(type, numbers, size, max_count, offset);
}

/* Adds a type to the module and stores it in `type`, for checks of an object's type. */
static inline int add_known_type(PyObject *module, PyType_Spec *spec, const char *name, PyTypeObject **type)
{
    *type = (PyTypeObject *)PyType_FromSpec(spec);
    return *type != NULL && PyModule_AddObjectRef(module, name, (PyObject *)*type) == 0;
}

static inline int add_type(PyObject *module, PyType_Spec *spec, const char *name)
{
    PyTypeObject *type;
    int added = add_known_type(module, spec, name, &type);
    Py_XDECREF((PyObject *)type);
    return added;
}
