/* The Python types of a step: State, Kernel and ThrusterBank. */

#include "numbers.h"

#include "errors.h"
#include "kernel.h"
#include "force_types.h"

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

static PyTypeObject *state_type, *kernel_type, *bank_type;

static int is_native(PyObject *state)
{
    return Py_TYPE(state) == state_type;
}

/* Reads the numbers of a state, either a native one or a sim.dynamics.State. */
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

/* Stores numbers in a state. A sim.dynamics.State gets new lists, as in Python, so that references to the old lists
 * keep their values. */
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
        PyErr_Format(PyExc_AttributeError, "%s of a state cannot be deleted", part->name);
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
    {"nu_dot", state_get, state_set, "rate of change of nu over the last step (m/s2, rad/s2)", &parts[3]},
    {NULL, NULL, NULL, NULL, NULL},
};

static PyType_Slot state_slots[] = {
    {Py_tp_doc, "State(position, quaternion): a sim.dynamics.State at rest, whose numbers are kept in C.\n\n"
                "Its attributes accept any sequence of numbers and return tuples, which are copies."},
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
    Model model;
    double *triangles;
    PyObject *forces; /* a tuple of the forces: keeps the memory alive to which `model` points */
} Kernel;

static int kernel_advance(PyObject *self, double *numbers, const double *wrench, const double *current, double dt)
{
    double sum = 0.0; /* not finite if one of the numbers is not */
    if (!step(&((Kernel *)self)->model, numbers, numbers + NU_DOT, wrench, current, dt)) {
        PyErr_SetString(PyExc_FloatingPointError, "a quaternion of length 0");
        return 0;
    }
    for (int i = 0; i < SIZE; i++)
        sum += numbers[i];
    if (isfinite(sum))
        return 1;
    PyErr_SetString(PyExc_FloatingPointError, "the state is not finite any more");
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

static PyObject *kernel_predict_midpoint(PyObject *self, PyObject *const *arguments, Py_ssize_t count)
{
    double numbers[NUMBERS], mid[SIZE], rotation[9], dt;
    if (count != 2)
        return PyErr_Format(PyExc_TypeError, "predict_midpoint() takes state and dt");
    dt = PyFloat_AsDouble(arguments[1]);
    if ((dt == -1.0 && PyErr_Occurred()) || !load_state(arguments[0], numbers))
        return NULL;
    if (!predict_midpoint(&((Kernel *)self)->model.body, numbers, numbers + NU_DOT, dt, mid, rotation))
        return PyErr_Format(PyExc_FloatingPointError, "a quaternion of length 0");
    PyObject *parts[] = {new_number_tuple(mid, 3), new_number_tuple(rotation, 9), new_number_tuple(mid + NU, 6)};
    PyObject *all = parts[0] && parts[1] && parts[2] ? PyTuple_Pack(3, parts[0], parts[1], parts[2]) : NULL;
    for (int i = 0; i < 3; i++)
        Py_XDECREF(parts[i]);
    return all;
}

static PyObject *kernel_new(PyTypeObject *type, PyObject *arguments, PyObject *keywords)
{
    enum { NUMBER_BYTES = offsetof(Body, triangles) };
    Bytes numbers, hull;
    PyObject *forces;
    (void)keywords;
    if (!PyArg_ParseTuple(arguments, "O&O&O!", read_bytes, &numbers, read_bytes, &hull, &PyTuple_Type, &forces))
        return NULL;
    Py_ssize_t count = PyTuple_Size(forces), triangle_bytes = (Py_ssize_t)sizeof *((Body *)NULL)->triangles;
    if (numbers.size != NUMBER_BYTES || hull.size % triangle_bytes != 0 || count > MAX_FORCES)
        return PyErr_Format(PyExc_ValueError,
                            "%d bytes of parameters, whole triangles and up to %d forces are needed, found %zd, %zd and %zd",
                            NUMBER_BYTES, MAX_FORCES, numbers.size, hull.size, count);
    for (Py_ssize_t i = 0; i < count; i++)
        if (Py_TYPE(PyTuple_GetItem(forces, i)) != force_type)
            return PyErr_Format(PyExc_TypeError, "a tuple of forces is needed");
    Kernel *kernel = (Kernel *)PyType_GenericAlloc(type, 0);
    if (kernel == NULL)
        return NULL;
    memcpy(&kernel->model.body, numbers.data, NUMBER_BYTES);
    kernel->forces = Py_NewRef(forces);
    kernel->triangles = new_copy(hull.data, hull.size);
    if (kernel->triangles == NULL) {
        Py_DECREF(kernel);
        return NULL;
    }
    kernel->model.body.triangles = (const double (*)[9])kernel->triangles;
    kernel->model.body.triangle_count = (long)(hull.size / triangle_bytes);
    kernel->model.count = (int)count;
    for (Py_ssize_t i = 0; i < count; i++)
        kernel->model.forces[i] = &((ForceObject *)PyTuple_GetItem(forces, i))->force;
    return (PyObject *)kernel;
}

static void kernel_deallocate(PyObject *self)
{
    PyMem_Free(((Kernel *)self)->triangles);
    Py_XDECREF(((Kernel *)self)->forces);
    deallocate(self);
}

static PyMethodDef kernel_methods[] = {
    {"step", (PyCFunction)(void (*)(void))kernel_step, METH_FASTCALL,
     "step(state, wrench, current, dt): advance the state by dt s, as Dynamics.step does."},
    {"predict_midpoint", (PyCFunction)(void (*)(void))kernel_predict_midpoint, METH_FASTCALL,
     "predict_midpoint(state, dt): position, rotation and nu at which a step evaluates the forces, as Dynamics."},
    {NULL, NULL, 0, NULL},
};

static PyType_Slot kernel_slots[] = {
    {Py_tp_doc, "The step of one vehicle: Kernel(bytes of Dynamics.numbers(), of Hull.triangles, tuple of Force)."},
    {Py_tp_new, kernel_new},
    {Py_tp_dealloc, kernel_deallocate},
    {Py_tp_methods, kernel_methods},
    {0, NULL},
};

static PyType_Spec kernel_spec = {
    "sim.native._native.Kernel", sizeof(Kernel), 0, Py_TPFLAGS_DEFAULT | Py_TPFLAGS_IMMUTABLETYPE, kernel_slots,
};

/* -- ThrusterBank ----------------------------------------------------------------------------------------------------------*/

enum { MAX_THRUSTERS = 16 };

typedef struct {
    PyObject_HEAD
    Py_ssize_t count;
    long long steps;
    double wrench[6], thrusts[MAX_THRUSTERS], targets[MAX_THRUSTERS], shares[MAX_THRUSTERS];
    double scaled_thrusts[MAX_THRUSTERS];
    Thruster thrusters[MAX_THRUSTERS];
} ThrusterBank;

static void bank_advance(ThrusterBank *bank, const double *nu)
{
    bank->steps++;
    step_thrusters(bank->thrusters, (int)bank->count, bank->thrusts, bank->targets, bank->shares, nu, bank->scaled_thrusts,
           bank->wrench);
}

static PyObject *bank_new(PyTypeObject *type, PyObject *arguments, PyObject *keywords)
{
    (void)keywords;
    PyObject *self = new_of_records(type, arguments, sizeof(Thruster), MAX_THRUSTERS, offsetof(ThrusterBank, thrusters));
    for (int i = 0; self != NULL && i < MAX_THRUSTERS; i++)
        ((ThrusterBank *)self)->shares[i] = 1.0;
    return self;
}

static PyObject *bank_set_targets(PyObject *self, PyObject *targets)
{
    double numbers[MAX_THRUSTERS];
    ThrusterBank *bank = (ThrusterBank *)self;
    if (!read_numbers(targets, numbers, bank->count))
        return NULL;
    memcpy(bank->targets, numbers, (size_t)bank->count * sizeof(double));
    Py_RETURN_NONE;
}

static PyObject *bank_scale_thrusts(PyObject *self, PyObject *shares)
{
    double numbers[MAX_THRUSTERS];
    ThrusterBank *bank = (ThrusterBank *)self;
    if (!read_numbers(shares, numbers, bank->count))
        return NULL;
    memcpy(bank->shares, numbers, (size_t)bank->count * sizeof(double));
    Py_RETURN_NONE;
}

static PyObject *bank_wrench(PyObject *self, void *closure)
{
    (void)closure;
    return new_number_tuple(((ThrusterBank *)self)->wrench, 6);
}

static PyObject *bank_step(PyObject *self, PyObject *nu_r)
{
    double nu[6];
    if (!read_numbers(nu_r, nu, 6))
        return NULL;
    bank_advance((ThrusterBank *)self, nu);
    return bank_wrench(self, NULL);
}

static PyObject *bank_thrusts(PyObject *self, void *closure)
{
    (void)closure;
    return new_list(((ThrusterBank *)self)->thrusts, ((ThrusterBank *)self)->count);
}

static PyObject *bank_scaled_thrusts(PyObject *self, void *closure)
{
    (void)closure;
    return new_list(((ThrusterBank *)self)->scaled_thrusts, ((ThrusterBank *)self)->count);
}

static PyObject *bank_shares(PyObject *self, void *closure)
{
    (void)closure;
    return new_list(((ThrusterBank *)self)->shares, ((ThrusterBank *)self)->count);
}

static PyObject *bank_steps(PyObject *self, void *closure)
{
    (void)closure;
    return PyLong_FromLongLong(((ThrusterBank *)self)->steps);
}

static PyMethodDef bank_methods[] = {
    {"set_targets", bank_set_targets, METH_O, "set_targets(targets): set the target thrusts (N) of all following steps."},
    {"scale_thrusts", bank_scale_thrusts, METH_O, "scale_thrusts(shares): set the share of each thrust that acts from now on."},
    {"step", bank_step, METH_O, "step(nu_r): advance the thrusts by a step at nu_r through the water; return their wrench."},
    {NULL, NULL, 0, NULL},
};

static PyGetSetDef bank_attributes[] = {
    {"thrusts", bank_thrusts, NULL, "the present thrust of each in N, deep in water at rest", NULL},
    {"scaled_thrusts", bank_scaled_thrusts, NULL, "the thrust of each that acts, in N: less losses, times its share", NULL},
    {"wrench", bank_wrench, NULL, "their wrench at the end of the last step: X Y Z (N) K M N (N m), body axes", NULL},
    {"shares", bank_shares, NULL, "the share of each thrust that acts", NULL},
    {"steps", bank_steps, NULL, "number of steps so far", NULL},
    {NULL, NULL, NULL, NULL, NULL},
};

static PyType_Slot bank_slots[] = {
    {Py_tp_doc, "The thrusters of one vehicle, at rest: ThrusterBank(bytes of ThrusterSet.numbers())."},
    {Py_tp_new, bank_new},
    {Py_tp_dealloc, deallocate},
    {Py_tp_methods, bank_methods},
    {Py_tp_getset, bank_attributes},
    {0, NULL},
};

static PyType_Spec bank_spec = {
    "sim.native._native.ThrusterBank", sizeof(ThrusterBank), 0, Py_TPFLAGS_DEFAULT | Py_TPFLAGS_IMMUTABLETYPE, bank_slots,
};

static int add_step_types(PyObject *module)
{
    for (int i = 0; i < PARTS; i++)
        if (parts[i].interned == NULL && (parts[i].interned = PyUnicode_InternFromString(parts[i].name)) == NULL)
            return 0;
    return add_known_type(module, &state_spec, "State", &state_type)
        && add_known_type(module, &kernel_spec, "Kernel", &kernel_type)
        && add_known_type(module, &bank_spec, "ThrusterBank", &bank_type);
}
