/* Shows control.h to Python: hil.slave.native._control.Cascade, Allocation and Pulses. */

#include "../../../sim/native/numbers.h"

#include "control.h"

typedef struct {
    PyObject_HEAD
    Law law;
    Loop loops[AXES];
} Cascade;

/* A number of a record that may be None, and whether it is there; -1 with an exception set if it is neither. */
static int read_optional(PyObject *record, Py_ssize_t place, double *out)
{
    PyObject *number = PyTuple_GetItem(record, place);
    if (number == NULL)
        return -1;
    if (number == Py_None)
        return 0;
    *out = PyFloat_AsDouble(number);
    return *out == -1.0 && PyErr_Occurred() ? -1 : 1;
}

static int read_command(PyObject *record, Command *command)
{
    double *const plain[4] = {&command->surge, &command->sway, &command->heave, &command->yaw_rate};
    for (int i = 0; i < 4; i++) {
        PyObject *number = PyTuple_GetItem(record, i);
        *plain[i] = number == NULL ? -1.0 : PyFloat_AsDouble(number);
        if (*plain[i] == -1.0 && PyErr_Occurred())
            return 0;
    }
    command->has_depth = read_optional(record, 4, &command->depth);
    command->has_heading = read_optional(record, 5, &command->heading);
    return command->has_depth >= 0 && command->has_heading >= 0;
}

static int read_navigation(PyObject *record, Navigation *navigation)
{
    double *const vectors[3] = {navigation->orientation, navigation->angular_velocity, navigation->velocity};
    const Py_ssize_t sizes[3] = {4, 3, 3};
    for (int i = 0; i < 3; i++) {
        PyObject *vector = PyTuple_GetItem(record, i);
        if (vector == NULL || !read_numbers(vector, vectors[i], sizes[i]))
            return 0;
    }
    PyObject *depth = PyTuple_GetItem(record, 3);
    navigation->depth = depth == NULL ? -1.0 : PyFloat_AsDouble(depth);
    return !(navigation->depth == -1.0 && PyErr_Occurred());
}

static PyObject *new_wrench(const double *wrench)
{
    return Py_BuildValue("(dddddd)", wrench[0], wrench[1], wrench[2], wrench[3], wrench[4], wrench[5]);
}

static PyObject *cascade_update(PyObject *self, PyObject *const *arguments, Py_ssize_t count)
{
    Cascade *controller = (Cascade *)self;
    Command command;
    Navigation navigation;
    double dt, residual[AXES], wrench[AXES];
    if (count != 4)
        return PyErr_Format(PyExc_TypeError, "update() takes command, navigation, dt and residual");
    if (!read_command(arguments[0], &command) || !read_navigation(arguments[1], &navigation)
        || !read_numbers(arguments[3], residual, AXES))
        return NULL;
    dt = PyFloat_AsDouble(arguments[2]);
    if (dt == -1.0 && PyErr_Occurred())
        return NULL;
    cascade(&controller->law, controller->loops, &command, &navigation, dt, residual, wrench);
    return new_wrench(wrench);
}

static PyObject *cascade_reset(PyObject *self, PyObject *nothing)
{
    (void)nothing;
    memset(((Cascade *)self)->loops, 0, sizeof ((Cascade *)self)->loops);
    Py_RETURN_NONE;
}

static PyObject *cascade_new(PyTypeObject *type, PyObject *arguments, PyObject *keywords)
{
    (void)keywords;
    return new_of_parameters(type, arguments, sizeof(Law), offsetof(Cascade, law)); /* its loops begin anew */
}

static PyMethodDef cascade_methods[] = {
    {"update", (PyCFunction)(void (*)(void))cascade_update, METH_FASTCALL,
     "update(command, navigation, dt, residual): the wrench, as CascadedController.update gives it."},
    {"reset", cascade_reset, METH_NOARGS, "reset(): forget all integrals and slopes."},
    {NULL, NULL, 0, NULL},
};

static PyType_Slot cascade_slots[] = {
    {Py_tp_doc, "The loops of one vehicle: Cascade(bytes of CascadedController.numbers())."},
    {Py_tp_new, cascade_new},
    {Py_tp_dealloc, deallocate},
    {Py_tp_methods, cascade_methods},
    {0, NULL},
};

static PyType_Spec cascade_spec = {
    "hil.slave.native._control.Cascade", sizeof(Cascade), 0, Py_TPFLAGS_DEFAULT | Py_TPFLAGS_IMMUTABLETYPE,
    cascade_slots,
};

typedef struct {
    PyObject_HEAD
    Py_ssize_t count;
    Share shares[MOST_THRUSTERS];
} Allocation;

static PyObject *allocation_new(PyTypeObject *type, PyObject *arguments, PyObject *keywords)
{
    (void)keywords;
    return new_of_records(type, arguments, sizeof(Share), MOST_THRUSTERS, offsetof(Allocation, shares));
}

static PyObject *allocation_allocate(PyObject *self, PyObject *asked)
{
    const Allocation *allocation = (const Allocation *)self;
    double wrench[AXES], thrusts[MOST_THRUSTERS], lack[AXES];
    if (!read_numbers(asked, wrench, AXES))
        return NULL;
    allocate(allocation->shares, (int)allocation->count, wrench, thrusts, lack);
    PyObject *list = new_list(thrusts, allocation->count);
    return list == NULL ? NULL : Py_BuildValue("NN", list, new_wrench(lack));
}

static PyMethodDef allocation_methods[] = {
    {"allocate", allocation_allocate, METH_O, "allocate(wrench): thrusts and what they lack, as Allocator.allocate."},
    {NULL, NULL, 0, NULL},
};

static PyType_Slot allocation_slots[] = {
    {Py_tp_doc, "The thrusters of one vehicle: Allocation(bytes of Allocator.numbers())."},
    {Py_tp_new, allocation_new},
    {Py_tp_dealloc, deallocate},
    {Py_tp_methods, allocation_methods},
    {0, NULL},
};

static PyType_Spec allocation_spec = {
    "hil.slave.native._control.Allocation", sizeof(Allocation), 0, Py_TPFLAGS_DEFAULT | Py_TPFLAGS_IMMUTABLETYPE,
    allocation_slots,
};

typedef struct {
    PyObject_HEAD
    Py_ssize_t count;
    Curve curves[MOST_THRUSTERS];
} Pulses;

static PyObject *pulses_new(PyTypeObject *type, PyObject *arguments, PyObject *keywords)
{
    (void)keywords;
    return new_of_records(type, arguments, sizeof(Curve), MOST_THRUSTERS, offsetof(Pulses, curves));
}

static PyObject *pulses_find(PyObject *self, PyObject *asked)
{
    const Pulses *pulses = (const Pulses *)self;
    double thrusts[MOST_THRUSTERS];
    long found[MOST_THRUSTERS];
    if (!read_numbers(asked, thrusts, pulses->count))
        return NULL;
    for (Py_ssize_t i = 0; i < pulses->count; i++)
        found[i] = pulse(&pulses->curves[i], thrusts[i]);
    return new_whole_tuple(found, pulses->count);
}

static PyMethodDef pulses_methods[] = {
    {"find", pulses_find, METH_O, "find(thrusts): the pulse (us) of each thruster, as pulse_finder finds it."},
    {NULL, NULL, 0, NULL},
};

static PyType_Slot pulses_slots[] = {
    {Py_tp_doc, "The curves of a vehicle's thrusters: Pulses(bytes of their curve_numbers())."},
    {Py_tp_new, pulses_new},
    {Py_tp_dealloc, deallocate},
    {Py_tp_methods, pulses_methods},
    {0, NULL},
};

static PyType_Spec pulses_spec = {
    "hil.slave.native._control.Pulses", sizeof(Pulses), 0, Py_TPFLAGS_DEFAULT | Py_TPFLAGS_IMMUTABLETYPE, pulses_slots,
};

static int module_exec(PyObject *module)
{
    return add_type(module, &cascade_spec, "Cascade") && add_type(module, &allocation_spec, "Allocation")
        && add_type(module, &pulses_spec, "Pulses") ? 0 : -1;
}

static PyModuleDef_Slot module_slots[] = {{Py_mod_exec, module_exec}, {0, NULL}};

static PyModuleDef module = {
    PyModuleDef_HEAD_INIT, "hil.slave.native._control", "What a command becomes, in C.", 0, NULL, module_slots, NULL,
    NULL, NULL,
};

PyMODINIT_FUNC PyInit__control(void)
{
    return PyModuleDef_Init(&module);
}
