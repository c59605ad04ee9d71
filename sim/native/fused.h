/* The Python type FusedStep: a whole step of a simulation in one call. Include step_types.h first. */

/* sim.assembly.make_fused_step describes the arguments. */
typedef struct {
    PyObject_HEAD
    State *state;
    ThrusterBank *bank;
    Kernel *kernel;
    WaveField *wave_field;          /* NULL in water without waves */
    PyObject *command; /* called with each new tuple of pulses */
    PyObject *current; /* returns the current at a time and depth; NULL if it is steady */
    PyObject *pulses;  /* the last tuple of pulses; NULL before the first */
    double steady[3], flow[3], wrench[6], wave_inertia[6][3];
    double hull[5]; /* HullShape: reach, extent */
    long long time_ns, dt_ns;
    double north, east, free, seabed; /* arguments of set_clearance(); 0 at first, so that the first step is checked */
    double reach, hubs[MAX_THRUSTERS][4]; /* Ventilation.numbers() */
    int is_ventilated; /* 1 if thrust may be reduced near the surface */
} FusedStep;

static PyObject *fused_new(PyTypeObject *type, PyObject *arguments, PyObject *keywords)
{
    PyObject *state, *kernel, *bank, *command, *steady, *current, *wave_field, *mass, *air, *hull;
    double shape[5], water[3], pushed[18] = {0.0}, ventilation[1 + 4 * MAX_THRUSTERS];
    long long dt_ns;
    (void)keywords;
    if (!PyArg_ParseTuple(arguments, "O!O!O!OLOOOOOO", state_type, &state, kernel_type, &kernel, bank_type, &bank,
                          &command, &dt_ns, &hull, &steady, &current, &wave_field, &mass, &air)
        || !read_numbers(hull, shape, 5) || !read_numbers(air, ventilation, 1 + 4 * ((ThrusterBank *)bank)->count)
        || !read_numbers(steady, water, 3) || (wave_field != Py_None && !read_numbers(mass, pushed, 18)))
        return NULL;
    if (wave_field != Py_None && Py_TYPE(wave_field) != wave_field_type)
        return PyErr_Format(PyExc_TypeError, "a WaveField or None is needed");
    FusedStep *fused = (FusedStep *)PyType_GenericAlloc(type, 0);
    if (fused == NULL)
        return NULL;
    fused->state = (State *)Py_NewRef(state);
    fused->bank = (ThrusterBank *)Py_NewRef(bank);
    fused->kernel = (Kernel *)Py_NewRef(kernel);
    fused->command = Py_NewRef(command);
    fused->current = current != Py_None ? Py_NewRef(current) : NULL;
    fused->wave_field = wave_field != Py_None ? (WaveField *)Py_NewRef(wave_field) : NULL;
    memcpy(fused->steady, water, sizeof water);
    memcpy(fused->flow, water, sizeof water);
    memcpy(fused->wave_inertia, pushed, sizeof pushed);
    fused->dt_ns = dt_ns;
    fused->reach = ventilation[0];
    memcpy(fused->hubs, ventilation + 1, (size_t)(4 * fused->bank->count) * sizeof(double));
    fused->is_ventilated = 1;
    memcpy(fused->hull, shape, sizeof shape);
    return (PyObject *)fused;
}

/* Only `command` and `current` can be part of a reference cycle. */
static int fused_traverse(PyObject *self, visitproc visit, void *arg)
{
    FusedStep *fused = (FusedStep *)self;
    Py_VISIT(Py_TYPE(self));
    Py_VISIT(fused->command);
    Py_VISIT(fused->current);
    return 0;
}

static int fused_clear(PyObject *self)
{
    Py_CLEAR(((FusedStep *)self)->command);
    Py_CLEAR(((FusedStep *)self)->current);
    return 0;
}

static void fused_deallocate(PyObject *self)
{
    FusedStep *fused = (FusedStep *)self;
    PyTypeObject *type = Py_TYPE(self);
    PyObject_GC_UnTrack(self);
    fused_clear(self);
    Py_XDECREF((PyObject *)fused->state);
    Py_XDECREF((PyObject *)fused->bank);
    Py_XDECREF((PyObject *)fused->kernel);
    Py_XDECREF((PyObject *)fused->wave_field);
    Py_XDECREF(fused->pulses);
    PyObject_GC_Del(self);
    Py_DECREF(type);
}

/* Calls `command` if the pulses differ from the last ones. An identical tuple needs no comparison; a list may change. */
static int fused_command(FusedStep *fused, PyObject *pwm_us)
{
    if (pwm_us == fused->pulses)
        return 1;
    PyObject *pulses = PySequence_Tuple(pwm_us);
    if (pulses == NULL)
        return 0;
    int same = fused->pulses != NULL ? PyObject_RichCompareBool(pulses, fused->pulses, Py_EQ) : 0;
    if (same == 0) {
        PyObject *done = PyObject_CallFunctionObjArgs(fused->command, pulses, NULL);
        same = done != NULL ? 1 : -1;
        Py_XDECREF(done);
    }
    if (same < 0) {
        Py_DECREF(pulses);
        return 0;
    }
    PyObject *last = fused->pulses;
    fused->pulses = pulses;
    Py_XDECREF(last);
    return 1;
}

/* Equipment.step and ThrusterSet.step: servos, then thrusters in the water velocity of the last step. */
static void fused_step_actuators(FusedStep *fused, const double *rotation)
{
    const double *flow = fused->flow;
    double nu_r[6];
    const Model *model = &fused->kernel->model;
    for (int i = 0; i < model->count; i++)
        step_servos(model->forces[i]);
    memcpy(nu_r, fused->state->numbers + NU, sizeof nu_r);
    for (int i = 0; i < 3; i++)
        nu_r[i] -= rotation[i] * flow[0] + rotation[3 + i] * flow[1] + rotation[6 + i] * flow[2];
    bank_advance(fused->bank, nu_r);
    memcpy(fused->wrench, fused->bank->wrench, sizeof fused->wrench);
}

/* FluidMotion.act: the velocity of the water and the force of waves. Returns 0 with an exception if `current` fails. */
static int fused_flow(FusedStep *fused, const double *rotation)
{
    const double *position = fused->state->numbers + POSITION;
    double time = (double)fused->time_ns * 1e-9;
    if (fused->current == NULL)
        memcpy(fused->flow, fused->steady, sizeof fused->flow);
    else {
        PyObject *current = PyObject_CallFunction(fused->current, "Ld", fused->time_ns, position[2]);
        int ok = current != NULL && read_numbers(current, fused->flow, 3);
        Py_XDECREF(current);
        if (!ok)
            return 0;
    }
    if (fused->wave_field != NULL) {
        double motion[MOTION], body[3];
        const double *pull = motion + 3;
        wave_field_sample(fused->wave_field, fused->time_ns, position, rotation, motion);
        for (int i = 0; i < 3; i++) {
            fused->flow[i] = fused->flow[i] + motion[i];
            body[i] = rotation[i] * pull[0] + rotation[3 + i] * pull[1] + rotation[6 + i] * pull[2];
        }
        for (int i = 0; i < 6; i++) {
            const double *mass = fused->wave_inertia[i];
            fused->wrench[i] = fused->wrench[i] + mass[0] * body[0] + mass[1] * body[1] + mass[2] * body[2];
        }
    }
    for (int i = 0; i < fused->kernel->model.count; i++) {
        Force *force = fused->kernel->model.forces[i];
        Azimuth *azimuths = (Azimuth *)force->numbers;
        force->time = time;
        for (long j = 0; force->kind == AZIMUTHS && j < force->servo_count; j++)
            if (azimuths[j].number >= 0.0 && azimuths[j].number < (double)fused->bank->count)
                azimuths[j].thrust = fused->bank->scaled_thrusts[(int)azimuths[j].number];
    }
    return 1;
}

/* Simulation._update_ventilation, for the next step. */
static void fused_update_ventilation(FusedStep *fused)
{
    const double *position = fused->state->numbers + POSITION;
    double *shares = fused->bank->shares, depth = position[2], rotation[9];
    if (!(depth < fused->reach)) {
        for (Py_ssize_t i = 0; fused->is_ventilated && i < fused->bank->count; i++)
            shares[i] = 1.0;
        fused->is_ventilated = 0;
        return;
    }
    if (fused->wave_field != NULL)
        depth = depth + surface(&fused->wave_field->waves, (double)fused->time_ns * 1e-9, position[0], position[1]);
    matrix(fused->state->numbers + QUATERNION, rotation);
    for (Py_ssize_t i = 0; i < fused->bank->count; i++) {
        const double *hub = fused->hubs[i];
        double immersed = depth + rotation[6] * hub[0] + rotation[7] * hub[1] + rotation[8] * hub[2];
        shares[i] = thrust_share(immersed / hub[3]);
    }
    fused->is_ventilated = 1;
}

/* The quick check of Contact.resolve in sim/environment/collision.py: returns 1 if no contact is possible. */
static int fused_is_clear(const FusedStep *fused, const double *numbers)
{
    const double *position = numbers + POSITION, *hull = fused->hull;
    double away_north = position[0] - fused->north, away_east = position[1] - fused->east;
    if (away_north * away_north + away_east * away_east >= fused->free * fused->free)
        return 0;
    if (!(position[2] + hull[0] > fused->seabed))
        return 1;
    double rotation[9];
    matrix(numbers + QUATERNION, rotation);
    double low = fabs(rotation[6]) * hull[1] + fabs(rotation[7]) * hull[2] + fabs(rotation[8]) * hull[3] + hull[4];
    return !(position[2] + low > fused->seabed);
}

static PyObject *fused_step(PyObject *self, PyObject *pwm_us)
{
    FusedStep *fused = (FusedStep *)self;
    double numbers[NUMBERS], before[6], rotation[9];
    if (!fused_command(fused, pwm_us))
        return NULL;
    matrix(fused->state->numbers + QUATERNION, rotation);
    fused_step_actuators(fused, rotation);
    if (!fused_flow(fused, rotation))
        return NULL;
    memcpy(numbers, fused->state->numbers, sizeof numbers);
    memcpy(before, numbers + NU, sizeof before);
    if (!kernel_advance((PyObject *)fused->kernel, numbers, fused->wrench, fused->flow, (double)fused->dt_ns * 1e-9))
        return NULL;
    memcpy(fused->state->numbers, numbers, sizeof numbers);
    fused->time_ns += fused->dt_ns;
    if (fused_is_clear(fused, numbers)) {
        fused_update_ventilation(fused);
        Py_RETURN_NONE;
    }
    return new_number_tuple(before, 6);
}

static PyObject *fused_set_clearance(PyObject *self, PyObject *arguments)
{
    FusedStep *fused = (FusedStep *)self;
    if (!PyArg_ParseTuple(arguments, "dddd", &fused->north, &fused->east, &fused->free, &fused->seabed))
        return NULL;
    fused_update_ventilation(fused);
    Py_RETURN_NONE;
}

static PyObject *fused_rebuild(PyObject *self, PyObject *arguments)
{
    FusedStep *fused = (FusedStep *)self;
    PyObject *kernel, *mass;
    double pushed[18] = {0.0};
    if (!PyArg_ParseTuple(arguments, "O!O", kernel_type, &kernel, &mass)
        || (fused->wave_field != NULL && !read_numbers(mass, pushed, 18)))
        return NULL;
    PyObject *last = (PyObject *)fused->kernel;
    fused->kernel = (Kernel *)Py_NewRef(kernel);
    Py_XDECREF(last);
    memcpy(fused->wave_inertia, pushed, sizeof pushed);
    Py_RETURN_NONE;
}

static PyObject *fused_wrench(PyObject *self, void *closure)
{
    (void)closure;
    return new_number_tuple(((FusedStep *)self)->wrench, 6);
}

static PyObject *fused_flow_now(PyObject *self, void *closure)
{
    (void)closure;
    return new_number_tuple(((FusedStep *)self)->flow, 3);
}

static PyMethodDef fused_methods[] = {
    {"step", fused_step, METH_O,
     "step(pwm_us): advance the state by a step under these pulses. Return None if no contact is possible at its end,\n"
     "else the nu before the step, for Contact.resolve."},
    {"set_clearance", fused_set_clearance, METH_VARARGS,
     "set_clearance(north, east, free, seabed): no contact is possible within `free` m of this place above `seabed` (m),\n"
     "as Contact.clearance. Call it after each step that returned a nu; it also updates the ventilation."},
    {"rebuild", fused_rebuild, METH_VARARGS,
     "rebuild(kernel, wave_inertia): continue with those of a vehicle that has dropped a weight."},
    {NULL, NULL, 0, NULL},
};

static PyGetSetDef fused_attributes[] = {
    {"wrench", fused_wrench, NULL,
     "the wrench of thrusters and waves in the last step: X Y Z (N) K M N (N m), body axes", NULL},
    {"flow", fused_flow_now, NULL, "the velocity of the water in the last step, NED in m/s", NULL},
    {NULL, NULL, NULL, NULL, NULL},
};

static PyType_Slot fused_slots[] = {
    {Py_tp_doc, "Whole steps: FusedStep(state, kernel, bank, command, dt_ns, hull, steady, current,\n"
                "wave_field, wave_inertia, numbers of Ventilation). `command` takes each new tuple of pulses, and aims\n"
                "bank and servos. `hull` is the reach and the extent of its HullShape. `steady` is the velocity of\n"
                "the water (NED, m/s) where `current` is None, else that is\n"
                "called with time (ns) and depth (m). `wave_field` may be None, and `wave_inertia` then too; its 18 numbers\n"
                "are M_A + rho V, row after row."},
    {Py_tp_new, fused_new},
    {Py_tp_dealloc, fused_deallocate},
    {Py_tp_traverse, fused_traverse},
    {Py_tp_clear, fused_clear},
    {Py_tp_methods, fused_methods},
    {Py_tp_getset, fused_attributes},
    {0, NULL},
};

static PyType_Spec fused_spec = {
    "sim.native._native.FusedStep", sizeof(FusedStep), 0,
    Py_TPFLAGS_DEFAULT | Py_TPFLAGS_IMMUTABLETYPE | Py_TPFLAGS_HAVE_GC, fused_slots,
};

static int add_fused(PyObject *module)
{
    return add_type(module, &fused_spec, "FusedStep");
}
