/* What moves a vehicle, as types of Python: State, Kernel, Mixer, and Coast, which is a step of all three at once. */

#include "numbers.h"

#include "errors.h"
#include "kernel.h"

/* -- State: 13 numbers as in kernel.h, then nu_dot ------------------------------------------------------------------*/

enum { NU_DOT = SIZE, NUMBERS = NU_DOT + 6 };

typedef struct {
    PyObject_HEAD
    double numbers[NUMBERS];
} State;

typedef struct {
    const char *name;
    Py_ssize_t first, size;
    PyObject *interned;
} Part;

static Part parts[] = {
    {"position", POSITION, 3, NULL},
    {"quaternion", QUATERNION, 4, NULL},
    {"nu", NU, 6, NULL},
    {"nu_dot", NU_DOT, 6, NULL},
};
enum { PARTS = sizeof parts / sizeof parts[0] };

static PyTypeObject *state_type, *kernel_type, *mixer_type;

static int is_native(PyObject *state)
{
    return Py_TYPE(state) == state_type;
}

/* The numbers of a state, ours or one of Python's. */
static int load_state(PyObject *state, double *numbers)
{
    if (is_native(state)) {
        memcpy(numbers, ((State *)state)->numbers, sizeof ((State *)state)->numbers);
        return 1;
    }
    for (int i = 0; i < PARTS; i++) {
        PyObject *value = PyObject_GetAttr(state, parts[i].interned);
        int ok = value != NULL && read_numbers(value, numbers + parts[i].first, parts[i].size);
        Py_XDECREF(value);
        if (!ok)
            return 0;
    }
    return 1;
}

/* One of Python's gets new lists, as from Python: who kept the old ones keeps the old numbers. */
static int store_state(PyObject *state, const double *numbers)
{
    if (is_native(state)) {
        memcpy(((State *)state)->numbers, numbers, sizeof ((State *)state)->numbers);
        return 1;
    }
    for (int i = 0; i < PARTS; i++) {
        PyObject *list = new_list(numbers + parts[i].first, parts[i].size);
        int ok = list != NULL && PyObject_SetAttr(state, parts[i].interned, list) == 0;
        Py_XDECREF(list);
        if (!ok)
            return 0;
    }
    return 1;
}

static PyObject *state_new(PyTypeObject *type, PyObject *arguments, PyObject *keywords)
{
    PyObject *position, *quaternion;
    (void)keywords;
    if (!PyArg_ParseTuple(arguments, "OO", &position, &quaternion))
        return NULL;
    PyObject *self = PyType_GenericAlloc(type, 0);
    if (self == NULL)
        return NULL;
    double *numbers = ((State *)self)->numbers;
    if (!read_numbers(position, numbers + POSITION, 3) || !read_numbers(quaternion, numbers + QUATERNION, 4))
        Py_CLEAR(self);
    return self;
}

static PyObject *state_get(PyObject *self, void *part)
{
    return new_number_tuple(((State *)self)->numbers + ((Part *)part)->first, ((Part *)part)->size);
}

static int state_set(PyObject *self, PyObject *value, void *closure)
{
    const Part *part = closure;
    double numbers[6];
    if (value == NULL) {
        PyErr_Format(PyExc_AttributeError, "a state cannot be without its %s", part->name);
        return -1;
    }
    if (!read_numbers(value, numbers, part->size))
        return -1;
    memcpy(((State *)self)->numbers + part->first, numbers, (size_t)part->size * sizeof(double));
    return 0;
}

static PyGetSetDef state_attributes[] = {
    {"position", state_get, state_set, "NED in m", &parts[0]},
    {"quaternion", state_get, state_set, "(w, x, y, z), body to world", &parts[1]},
    {"nu", state_get, state_set, "u v w (m/s), p q r (rad/s) over ground along the body axes", &parts[2]},
    {"nu_dot", state_get, state_set, "the rate of nu over the last step", &parts[3]},
    {NULL, NULL, NULL, NULL, NULL},
};

static PyType_Slot state_slots[] = {
    {Py_tp_doc, "State(position, quaternion): a sim.dynamics.State at rest, whose numbers are kept in C.\n\n"
                "Its attributes take any sequence of numbers and give tuples: copies, which cannot be written to."},
    {Py_tp_new, state_new},
    {Py_tp_dealloc, deallocate},
    {Py_tp_getset, state_attributes},
    {0, NULL},
};

static PyType_Spec state_spec = {
    "sim.native._native.State", sizeof(State), 0, Py_TPFLAGS_DEFAULT | Py_TPFLAGS_IMMUTABLETYPE, state_slots,
};

/* -- Kernel ---------------------------------------------------------------------------------------------------------*/

typedef struct {
    PyObject_HEAD
    Body body;
} Kernel;

static int kernel_advance(PyObject *self, double *numbers, const double *wrench, const double *current, double dt)
{
    if (step(&((Kernel *)self)->body, numbers, numbers + NU_DOT, wrench, current, dt))
        return 1;
    PyErr_SetString(PyExc_ZeroDivisionError, "float division by zero");
    return 0;
}

static PyObject *kernel_step(PyObject *self, PyObject *const *arguments, Py_ssize_t count)
{
    double numbers[NUMBERS], wrench[6], current[3], dt;
    if (count != 4)
        return PyErr_Format(PyExc_TypeError, "step() takes state, wrench, current and dt");
    PyObject *state = arguments[0];
    if (!load_state(state, numbers) || !read_numbers(arguments[1], wrench, 6)
        || !read_numbers(arguments[2], current, 3))
        return NULL;
    dt = PyFloat_AsDouble(arguments[3]);
    if (dt == -1.0 && PyErr_Occurred())
        return NULL;
    if (!kernel_advance(self, numbers, wrench, current, dt) || !store_state(state, numbers))
        return NULL;
    Py_RETURN_NONE;
}

static PyObject *kernel_new(PyTypeObject *type, PyObject *arguments, PyObject *keywords)
{
    (void)keywords;
    return new_of_parameters(type, arguments, sizeof(Body), offsetof(Kernel, body));
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

/* -- Mixer ----------------------------------------------------------------------------------------------------------*/

enum { MOST_THRUSTERS = 16 };

typedef struct {
    PyObject_HEAD
    Py_ssize_t count;
    long long steps;
    double wrench[6], thrusts[MOST_THRUSTERS], targets[MOST_THRUSTERS];
    Thruster thrusters[MOST_THRUSTERS];
} Mixer;

static void mixer_advance(Mixer *mixer)
{
    mixer->steps++;
    follow(mixer->thrusters, (int)mixer->count, mixer->thrusts, mixer->targets, mixer->wrench);
}

static PyObject *mixer_new(PyTypeObject *type, PyObject *arguments, PyObject *keywords)
{
    (void)keywords;
    return new_of_records(type, arguments, sizeof(Thruster), MOST_THRUSTERS, offsetof(Mixer, thrusters));
}

static PyObject *mixer_aim(PyObject *self, PyObject *targets)
{
    double numbers[MOST_THRUSTERS];
    Mixer *mixer = (Mixer *)self;
    if (!read_numbers(targets, numbers, mixer->count))
        return NULL;
    memcpy(mixer->targets, numbers, (size_t)mixer->count * sizeof(double));
    Py_RETURN_NONE;
}

static PyObject *mixer_wrench(PyObject *self, void *closure)
{
    (void)closure;
    return new_number_tuple(((Mixer *)self)->wrench, 6);
}

static PyObject *mixer_step(PyObject *self, PyObject *nothing)
{
    (void)nothing;
    mixer_advance((Mixer *)self);
    return mixer_wrench(self, NULL);
}

static PyObject *mixer_thrusts(PyObject *self, void *closure)
{
    (void)closure;
    return new_list(((Mixer *)self)->thrusts, ((Mixer *)self)->count);
}

static PyObject *mixer_steps(PyObject *self, void *closure)
{
    (void)closure;
    return PyLong_FromLongLong(((Mixer *)self)->steps);
}

static PyMethodDef mixer_methods[] = {
    {"aim", mixer_aim, METH_O, "aim(targets): the thrusts (N) that the steps from now on go towards."},
    {"step", mixer_step, METH_NOARGS, "step(): move the thrusts on by a step; their wrench."},
    {NULL, NULL, 0, NULL},
};

static PyGetSetDef mixer_attributes[] = {
    {"thrusts", mixer_thrusts, NULL, "the present thrust of each in N", NULL},
    {"wrench", mixer_wrench, NULL, "their wrench at the end of the last step: X Y Z (N) K M N (N m), body axes", NULL},
    {"steps", mixer_steps, NULL, "how many steps there were", NULL},
    {NULL, NULL, NULL, NULL, NULL},
};

static PyType_Slot mixer_slots[] = {
    {Py_tp_doc, "The thrusters of one vehicle, at rest: Mixer(bytes of ThrusterSet.numbers())."},
    {Py_tp_new, mixer_new},
    {Py_tp_dealloc, deallocate},
    {Py_tp_methods, mixer_methods},
    {Py_tp_getset, mixer_attributes},
    {0, NULL},
};

static PyType_Spec mixer_spec = {
    "sim.native._native.Mixer", sizeof(Mixer), 0, Py_TPFLAGS_DEFAULT | Py_TPFLAGS_IMMUTABLETYPE, mixer_slots,
};

/* -- Coast ----------------------------------------------------------------------------------------------------------*/

typedef struct {
    PyObject_HEAD
    State *state;
    Mixer *mixer;
    PyObject *kernel, *command;
    PyObject *pulses; /* the last ones, a tuple; NULL before the first */
    double current[3], dt, half_height;
    double north, east, free, seabed; /* what watch() was told; all 0 at first, so that the first step wants a look */
} Coast;

static PyObject *coast_new(PyTypeObject *type, PyObject *arguments, PyObject *keywords)
{
    PyObject *state, *kernel, *mixer, *command, *current;
    double dt, half_height, water[3];
    (void)keywords;
    if (!PyArg_ParseTuple(arguments, "O!O!O!OOdd", state_type, &state, kernel_type, &kernel, mixer_type, &mixer,
                          &command, &current, &dt, &half_height)
        || !read_numbers(current, water, 3))
        return NULL;
    Coast *coast = (Coast *)PyType_GenericAlloc(type, 0);
    if (coast == NULL)
        return NULL;
    coast->state = (State *)Py_NewRef(state);
    coast->mixer = (Mixer *)Py_NewRef(mixer);
    coast->kernel = Py_NewRef(kernel);
    coast->command = Py_NewRef(command);
    memcpy(coast->current, water, sizeof water);
    coast->dt = dt;
    coast->half_height = half_height;
    return (PyObject *)coast;
}

static void coast_deallocate(PyObject *self)
{
    Coast *coast = (Coast *)self;
    Py_XDECREF((PyObject *)coast->state);
    Py_XDECREF((PyObject *)coast->mixer);
    Py_XDECREF(coast->kernel);
    Py_XDECREF(coast->command);
    Py_XDECREF(coast->pulses);
    deallocate(self);
}

/* Passes pulses on that are others than the last ones. The very same tuple need not be looked into; lists change. */
static int coast_command(Coast *coast, PyObject *pwm_us)
{
    if (pwm_us == coast->pulses)
        return 1;
    PyObject *pulses = PySequence_Tuple(pwm_us);
    if (pulses == NULL)
        return 0;
    int same = coast->pulses != NULL ? PyObject_RichCompareBool(pulses, coast->pulses, Py_EQ) : 0;
    if (same == 0) {
        PyObject *done = PyObject_CallFunctionObjArgs(coast->command, pulses, NULL);
        same = done != NULL ? 1 : -1;
        Py_XDECREF(done);
    }
    if (same < 0) {
        Py_DECREF(pulses);
        return 0;
    }
    PyObject *last = coast->pulses;
    coast->pulses = pulses;
    Py_XDECREF(last);
    return 1;
}

/* Contact.resolve of sim/contact.py, as far as it finds nothing. */
static int coast_is_clear(const Coast *coast, const double *position)
{
    double away_north = position[0] - coast->north, away_east = position[1] - coast->east;
    return !(position[2] + coast->half_height > coast->seabed)
        && !(away_north * away_north + away_east * away_east >= coast->free * coast->free);
}

static PyObject *coast_step(PyObject *self, PyObject *pwm_us)
{
    Coast *coast = (Coast *)self;
    double numbers[NUMBERS], before[6];
    if (!coast_command(coast, pwm_us))
        return NULL;
    mixer_advance(coast->mixer);
    memcpy(numbers, coast->state->numbers, sizeof numbers);
    memcpy(before, numbers + NU, sizeof before);
    if (!kernel_advance(coast->kernel, numbers, coast->mixer->wrench, coast->current, coast->dt))
        return NULL;
    memcpy(coast->state->numbers, numbers, sizeof numbers);
    if (coast_is_clear(coast, numbers))
        Py_RETURN_NONE;
    return new_number_tuple(before, 6);
}

static PyObject *coast_watch(PyObject *self, PyObject *arguments)
{
    Coast *coast = (Coast *)self;
    if (!PyArg_ParseTuple(arguments, "dddd", &coast->north, &coast->east, &coast->free, &coast->seabed))
        return NULL;
    Py_RETURN_NONE;
}

static PyObject *coast_wrench(PyObject *self, void *closure)
{
    return mixer_wrench((PyObject *)((Coast *)self)->mixer, closure);
}

static PyMethodDef coast_methods[] = {
    {"step", coast_step, METH_O,
     "step(pwm_us): move the state on by a step under these pulses. None if it has to be looked at for no contact,\n"
     "else its nu before the step."},
    {"watch", coast_watch, METH_VARARGS,
     "watch(north, east, free, seabed): no contact within `free` m of this place above `seabed` (m), as Contact.room."},
    {NULL, NULL, 0, NULL},
};

static PyGetSetDef coast_attributes[] = {
    {"wrench", coast_wrench, NULL, "that of the thrusters in the last step: X Y Z (N) K M N (N m), body axes", NULL},
    {NULL, NULL, NULL, NULL, NULL},
};

static PyType_Slot coast_slots[] = {
    {Py_tp_doc, "Whole steps: Coast(state, kernel, mixer, command, current, dt, half_height).\n\n"
                "`command` takes each new tuple of pulses, and aims the mixer."},
    {Py_tp_new, coast_new},
    {Py_tp_dealloc, coast_deallocate},
    {Py_tp_methods, coast_methods},
    {Py_tp_getset, coast_attributes},
    {0, NULL},
};

static PyType_Spec coast_spec = {
    "sim.native._native.Coast", sizeof(Coast), 0, Py_TPFLAGS_DEFAULT | Py_TPFLAGS_IMMUTABLETYPE, coast_slots,
};

static int add_moving(PyObject *module)
{
    for (int i = 0; i < PARTS; i++)
        if (parts[i].interned == NULL && (parts[i].interned = PyUnicode_InternFromString(parts[i].name)) == NULL)
            return 0;
    return add_known_type(module, &state_spec, "State", &state_type)
        && add_known_type(module, &kernel_spec, "Kernel", &kernel_type)
        && add_known_type(module, &mixer_spec, "Mixer", &mixer_type) && add_type(module, &coast_spec, "Coast");
}
