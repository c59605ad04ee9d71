/* Shows the step of kernel.h to Python: sim.native._native.Kernel. */

#define PY_SSIZE_T_CLEAN
#define Py_LIMITED_API 0x030B0000
#include <Python.h>
#include <string.h>

#include "kernel.h"

typedef struct {
    PyObject_HEAD
    Body body;
} Kernel;

static PyObject *position_name, *quaternion_name, *nu_name, *nu_dot_name;

/* `size` numbers out of a Python sequence; 0 with an exception set if it holds anything else. */
static int read_numbers(PyObject *sequence, double *out, Py_ssize_t size)
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

static int get_numbers(PyObject *object, PyObject *name, double *out, Py_ssize_t size)
{
    PyObject *value = PyObject_GetAttr(object, name);
    int ok = value != NULL && read_numbers(value, out, size);
    Py_XDECREF(value);
    return ok;
}

/* A new list each time, as in Python: who kept the old one keeps the old numbers. */
static int set_numbers(PyObject *object, PyObject *name, const double *numbers, Py_ssize_t size)
{
    PyObject *list = PyList_New(size);
    for (Py_ssize_t i = 0; list != NULL && i < size; i++) {
        PyObject *number = PyFloat_FromDouble(numbers[i]);
        if (number == NULL)
            Py_CLEAR(list);
        else
            PyList_SetItem(list, i, number);
    }
    int ok = list != NULL && PyObject_SetAttr(object, name, list) == 0;
    Py_XDECREF(list);
    return ok;
}

static PyObject *kernel_step(PyObject *self, PyObject *const *arguments, Py_ssize_t count)
{
    double at[SIZE], nu_dot[6], wrench[6], current[3], dt;
    if (count != 4)
        return PyErr_Format(PyExc_TypeError, "step() takes state, wrench, current and dt");
    PyObject *state = arguments[0];
    if (!get_numbers(state, position_name, at + POSITION, 3) || !get_numbers(state, quaternion_name, at + QUATERNION, 4)
        || !get_numbers(state, nu_name, at + NU, 6) || !read_numbers(arguments[1], wrench, 6)
        || !read_numbers(arguments[2], current, 3))
        return NULL;
    dt = PyFloat_AsDouble(arguments[3]);
    if (dt == -1.0 && PyErr_Occurred())
        return NULL;
    if (!step(&((Kernel *)self)->body, at, nu_dot, wrench, current, dt))
        return PyErr_Format(PyExc_ZeroDivisionError, "float division by zero");
    if (!set_numbers(state, position_name, at + POSITION, 3) || !set_numbers(state, quaternion_name, at + QUATERNION, 4)
        || !set_numbers(state, nu_name, at + NU, 6) || !set_numbers(state, nu_dot_name, nu_dot, 6))
        return NULL;
    Py_RETURN_NONE;
}

static PyObject *kernel_new(PyTypeObject *type, PyObject *arguments, PyObject *keywords)
{
    const char *numbers;
    Py_ssize_t size;
    (void)keywords;
    if (!PyArg_ParseTuple(arguments, "y#", &numbers, &size))
        return NULL;
    if (size != (Py_ssize_t)sizeof(Body))
        return PyErr_Format(PyExc_ValueError, "%zd bytes of parameters are needed, found %zd", sizeof(Body), size);
    PyObject *self = PyType_GenericAlloc(type, 0);
    if (self != NULL)
        memcpy(&((Kernel *)self)->body, numbers, sizeof(Body));
    return self;
}

static void kernel_dealloc(PyObject *self)
{
    PyTypeObject *type = Py_TYPE(self);
    PyObject_Free(self);
    Py_DECREF(type);
}

static PyMethodDef kernel_methods[] = {
    {"step", (PyCFunction)(void (*)(void))kernel_step, METH_FASTCALL,
     "step(state, wrench, current, dt): move the state on by dt s, as Dynamics.step does."},
    {NULL, NULL, 0, NULL},
};

static PyType_Slot kernel_slots[] = {
    {Py_tp_doc, "The step of one vehicle: Kernel(bytes of Dynamics.numbers())."},
    {Py_tp_new, kernel_new},
    {Py_tp_dealloc, kernel_dealloc},
    {Py_tp_methods, kernel_methods},
    {0, NULL},
};

static PyType_Spec kernel_spec = {
    "sim.native._native.Kernel", sizeof(Kernel), 0, Py_TPFLAGS_DEFAULT | Py_TPFLAGS_IMMUTABLETYPE, kernel_slots,
};

static int module_exec(PyObject *module)
{
    position_name = PyUnicode_InternFromString("position");
    quaternion_name = PyUnicode_InternFromString("quaternion");
    nu_name = PyUnicode_InternFromString("nu");
    nu_dot_name = PyUnicode_InternFromString("nu_dot");
    if (position_name == NULL || quaternion_name == NULL || nu_name == NULL || nu_dot_name == NULL)
        return -1;
    PyObject *type = PyType_FromSpec(&kernel_spec);
    int failed = type == NULL || PyModule_AddObjectRef(module, "Kernel", type) != 0;
    Py_XDECREF(type);
    return failed ? -1 : 0;
}

static PyModuleDef_Slot module_slots[] = {{Py_mod_exec, module_exec}, {0, NULL}};

static PyModuleDef module = {
    PyModuleDef_HEAD_INIT, "sim.native._native", "The step in C.", 0, NULL, module_slots, NULL, NULL, NULL,
};

PyMODINIT_FUNC PyInit__native(void)
{
    return PyModuleDef_Init(&module);
}
