/* Shows kernel.h and errors.h to Python: sim.native._native.Kernel, Mixer and Errors. */

#include "numbers.h"

#include "errors.h"
#include "kernel.h"

typedef struct {
    PyObject_HEAD
    Body body;
} Kernel;

static PyObject *position_name, *quaternion_name, *nu_name, *nu_dot_name;

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
    PyObject *list = new_list(numbers, size);
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

static PyMethodDef kernel_methods[] = {
    {"step", (PyCFunction)(void (*)(void))kernel_step, METH_FASTCALL,
     "step(state, wrench, current, dt): move the state on by dt s, as Dynamics.step does."},
    {NULL, NULL, 0, NULL},
};

static PyType_Slot kernel_slots[] = {
    {Py_tp_doc, "The step of one vehicle: Kernel(bytes of Dynamics.numbers())."},
    {Py_tp_new, kernel_new},
    {Py_tp_dealloc, deallocate},
    {Py_tp_methods, kernel_methods},
    {0, NULL},
};

static PyType_Spec kernel_spec = {
    "sim.native._native.Kernel", sizeof(Kernel), 0, Py_TPFLAGS_DEFAULT | Py_TPFLAGS_IMMUTABLETYPE, kernel_slots,
};

enum { MOST_THRUSTERS = 16, MOST_CHANNELS = 32 };

typedef struct {
    PyObject_HEAD
    Py_ssize_t count;
    Thruster thrusters[MOST_THRUSTERS];
} Mixer;

static PyObject *mixer_new(PyTypeObject *type, PyObject *arguments, PyObject *keywords)
{
    (void)keywords;
    return new_of_records(type, arguments, sizeof(Thruster), MOST_THRUSTERS, offsetof(Mixer, thrusters));
}

static PyObject *mixer_step(PyObject *self, PyObject *const *arguments, Py_ssize_t count)
{
    const Mixer *mixer = (const Mixer *)self;
    double thrusts[MOST_THRUSTERS], targets[MOST_THRUSTERS], wrench[6];
    if (count != 2)
        return PyErr_Format(PyExc_TypeError, "step() takes thrusts and targets");
    if (!read_numbers(arguments[0], thrusts, mixer->count) || !read_numbers(arguments[1], targets, mixer->count))
        return NULL;
    follow(mixer->thrusters, (int)mixer->count, thrusts, targets, wrench);
    PyObject *list = new_list(thrusts, mixer->count);
    if (list == NULL)
        return NULL;
    return Py_BuildValue("N(dddddd)", list, wrench[0], wrench[1], wrench[2], wrench[3], wrench[4], wrench[5]);
}

static PyMethodDef mixer_methods[] = {
    {"step", (PyCFunction)(void (*)(void))mixer_step, METH_FASTCALL,
     "step(thrusts, targets): the thrusts a step later, and their wrench."},
    {NULL, NULL, 0, NULL},
};

static PyType_Slot mixer_slots[] = {
    {Py_tp_doc, "The thrusters of one vehicle: Mixer(bytes of ThrusterSet.numbers())."},
    {Py_tp_new, mixer_new},
    {Py_tp_dealloc, deallocate},
    {Py_tp_methods, mixer_methods},
    {0, NULL},
};

static PyType_Spec mixer_spec = {
    "sim.native._native.Mixer", sizeof(Mixer), 0, Py_TPFLAGS_DEFAULT | Py_TPFLAGS_IMMUTABLETYPE, mixer_slots,
};

typedef struct {
    PyObject_HEAD
    Py_ssize_t count;
    Random random;
    Channel channels[MOST_CHANNELS];
} Errors;

static PyObject *errors_new(PyTypeObject *type, PyObject *arguments, PyObject *keywords)
{
    const char *numbers, *key;
    Py_ssize_t bytes, key_bytes;
    PyObject *second;
    (void)keywords;
    if (!PyArg_ParseTuple(arguments, "y#y#O", &numbers, &bytes, &key, &key_bytes, &second))
        return NULL;
    if (key_bytes != (TWISTER_SIZE + 1) * (Py_ssize_t)sizeof(uint32_t))
        return PyErr_Format(PyExc_ValueError, "a state of %d numbers is needed", TWISTER_SIZE + 1);
    PyObject *self = new_with_records(type, numbers, bytes, sizeof(Channel), MOST_CHANNELS, offsetof(Errors, channels));
    if (self == NULL)
        return NULL;
    Errors *errors = (Errors *)self;
    uint32_t place;
    memcpy(errors->random.key, key, sizeof errors->random.key);
    memcpy(&place, key + sizeof errors->random.key, sizeof place);
    errors->random.place = place < TWISTER_SIZE ? (int)place : TWISTER_SIZE;
    errors->random.has_second = second != Py_None;
    errors->random.second = errors->random.has_second ? PyFloat_AsDouble(second) : 0.0;
    if (PyErr_Occurred())
        Py_CLEAR(self);
    return self;
}

static PyObject *errors_measure(PyObject *self, PyObject *true_values)
{
    Errors *errors = (Errors *)self;
    double values[MOST_CHANNELS];
    if (!read_numbers(true_values, values, errors->count))
        return NULL;
    for (Py_ssize_t i = 0; i < errors->count; i++)
        values[i] = measure(&errors->channels[i], &errors->random, values[i]);
    return new_list(values, errors->count);
}

static PyMethodDef errors_methods[] = {
    {"measure", errors_measure, METH_O, "measure(true): one measurement of each value, as ErrorBank.measure does."},
    {NULL, NULL, 0, NULL},
};

static PyType_Slot errors_slots[] = {
    {Py_tp_doc, "The errors of one sensor: Errors(bytes of their numbers(), bytes of random's key, its second number)."},
    {Py_tp_new, errors_new},
    {Py_tp_dealloc, deallocate},
    {Py_tp_methods, errors_methods},
    {0, NULL},
};

static PyType_Spec errors_spec = {
    "sim.native._native.Errors", sizeof(Errors), 0, Py_TPFLAGS_DEFAULT | Py_TPFLAGS_IMMUTABLETYPE, errors_slots,
};

static int module_exec(PyObject *module)
{
    position_name = PyUnicode_InternFromString("position");
    quaternion_name = PyUnicode_InternFromString("quaternion");
    nu_name = PyUnicode_InternFromString("nu");
    nu_dot_name = PyUnicode_InternFromString("nu_dot");
    if (position_name == NULL || quaternion_name == NULL || nu_name == NULL || nu_dot_name == NULL)
        return -1;
    return add_type(module, &kernel_spec, "Kernel") && add_type(module, &mixer_spec, "Mixer")
        && add_type(module, &errors_spec, "Errors") ? 0 : -1;
}

static PyModuleDef_Slot module_slots[] = {{Py_mod_exec, module_exec}, {0, NULL}};

static PyModuleDef module = {
    PyModuleDef_HEAD_INIT, "sim.native._native", "The step in C.", 0, NULL, module_slots, NULL, NULL, NULL,
};

PyMODINIT_FUNC PyInit__native(void)
{
    return PyModuleDef_Init(&module);
}
