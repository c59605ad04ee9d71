/* The Python types of waves and of forces besides thrusters: WaveField and Force.
 * Include numbers.h and kernel.h first. */

static PyTypeObject *wave_field_type, *force_type;

/* Returns a copy of `bytes` bytes in new memory; NULL with an exception set if there is no memory. */
static void *new_copy(const char *numbers, Py_ssize_t bytes)
{
    void *copy = PyMem_Malloc((size_t)bytes);
    if (copy == NULL)
        return PyErr_NoMemory();
    return memcpy(copy, numbers, (size_t)bytes);
}

/* -- WaveField -------------------------------------------------------------------------------------------------------*/

typedef struct {
    PyObject_HEAD
    Waves waves;
    long long hold_ns, due_ns, time_ns;
    double last_position[3]; /* of the motion that `waves` holds */
    double half_sizes[3];    /* of the hull */
} WaveField;

#define FAR_M2 0.0625 /* _FAR_M2 of sim/environment/water.py */

/* SampledWaves.motion */
static void wave_field_sample(WaveField *wave_field, long long time_ns, const double *position, const double *rotation,
                              double *motion)
{
    double *held = wave_field->waves.held;
    double north = position[0] - wave_field->last_position[0], east = position[1] - wave_field->last_position[1], down = position[2] - wave_field->last_position[2];
    if (time_ns >= wave_field->due_ns || north * north + east * east + down * down > FAR_M2) {
        double *tangent = wave_field->waves.tangent, time = (double)time_ns * 1e-9;
        wave_field->due_ns = time_ns + wave_field->hold_ns;
        wave_field->time_ns = time_ns;
        memcpy(wave_field->last_position, position, sizeof wave_field->last_position);
        double length = wave_field->half_sizes[0], width = wave_field->half_sizes[1];
        double plan[4] = {length * rotation[0], length * rotation[3], width * rotation[1], width * rotation[4]};
        double half_draught = 0.5 * (position[2] + wave_field->half_sizes[2]);
        double depth = half_draught > position[2] ? half_draught : position[2];
        water_motion(&wave_field->waves, time, position[0], position[1], depth, plan, held);
        tangent[0] = time, tangent[1] = position[0], tangent[2] = position[1];
        memcpy(tangent + 3, held + 6, 4 * sizeof(double));
    }
    double later = (double)(time_ns - wave_field->time_ns) * 1e-9;
    memcpy(motion, held, MOTION * sizeof(double));
    for (int i = 0; i < 3; i++)
        motion[i] = motion[i] + motion[3 + i] * later;
}

static PyObject *wave_field_new(PyTypeObject *type, PyObject *arguments, PyObject *keywords)
{
    Bytes numbers;
    PyObject *sizes;
    double depth, half_sizes[3];
    long long hold_ns;
    (void)keywords;
    if (!PyArg_ParseTuple(arguments, "O&dLO", read_bytes, &numbers, &depth, &hold_ns, &sizes)
        || !read_numbers(sizes, half_sizes, 3))
        return NULL;
    if (numbers.size % (Py_ssize_t)sizeof(Wave) != 0)
        return PyErr_Format(PyExc_ValueError, "waves of %zu bytes are needed, found %zd bytes", sizeof(Wave),
                            numbers.size);
    WaveField *wave_field = (WaveField *)PyType_GenericAlloc(type, 0);
    if (wave_field == NULL)
        return NULL;
    wave_field->waves.depth = depth;
    wave_field->waves.tangent[0] = -INFINITY;
    wave_field->waves.count = (long)(numbers.size / (Py_ssize_t)sizeof(Wave));
    wave_field->hold_ns = hold_ns;
    memcpy(wave_field->half_sizes, half_sizes, sizeof half_sizes);
    wave_field->waves.waves = new_copy(numbers.data, numbers.size);
    if (wave_field->waves.waves == NULL)
        Py_CLEAR(wave_field);
    return (PyObject *)wave_field;
}

static void wave_field_deallocate(PyObject *self)
{
    PyMem_Free(((WaveField *)self)->waves.waves);
    deallocate(self);
}

static PyObject *wave_field_elevation(PyObject *self, PyObject *arguments)
{
    double time, north, east;
    if (!PyArg_ParseTuple(arguments, "ddd", &time, &north, &east))
        return NULL;
    return PyFloat_FromDouble(elevation(&((WaveField *)self)->waves, time, north, east));
}

static PyObject *wave_field_surface(PyObject *self, PyObject *arguments)
{
    double time, north, east;
    if (!PyArg_ParseTuple(arguments, "ddd", &time, &north, &east))
        return NULL;
    return PyFloat_FromDouble(surface(&((WaveField *)self)->waves, time, north, east));
}

static PyObject *wave_field_pressure_depth(PyObject *self, PyObject *arguments)
{
    double time, north, east, depth;
    if (!PyArg_ParseTuple(arguments, "dddd", &time, &north, &east, &depth))
        return NULL;
    return PyFloat_FromDouble(pressure_depth(&((WaveField *)self)->waves, time, north, east, depth));
}

static PyObject *new_motion(const double *motion)
{
    static const int sizes[] = {3, 3, 4, 5, 5};
    PyObject *all = PyTuple_New(5);
    for (int i = 0; all != NULL && i < 5; motion += sizes[i++]) {
        PyObject *part = new_number_tuple(motion, sizes[i]);
        if (part == NULL)
            Py_CLEAR(all);
        else
            PyTuple_SetItem(all, i, part);
    }
    return all;
}

static PyObject *wave_field_motion(PyObject *self, PyObject *arguments)
{
    PyObject *hull;
    double time, north, east, depth, plan[4], motion[MOTION];
    if (!PyArg_ParseTuple(arguments, "ddddO", &time, &north, &east, &depth, &hull) || !read_numbers(hull, plan, 4))
        return NULL;
    water_motion(&((WaveField *)self)->waves, time, north, east, depth, plan, motion);
    return new_motion(motion);
}

static PyObject *wave_field_sampled_motion(PyObject *self, PyObject *arguments)
{
    long long time_ns;
    PyObject *position, *attitude;
    double point[3], rotation[9], motion[MOTION];
    if (!PyArg_ParseTuple(arguments, "LOO", &time_ns, &position, &attitude) || !read_numbers(position, point, 3)
        || !read_numbers(attitude, rotation, 9))
        return NULL;
    wave_field_sample((WaveField *)self, time_ns, point, rotation, motion);
    return new_motion(motion);
}

static PyMethodDef wave_field_methods[] = {
    {"elevation", wave_field_elevation, METH_VARARGS, "elevation(time, north, east), as of sim.environment.waves.WaveField."},
    {"surface", wave_field_surface, METH_VARARGS, "surface(time, north, east), as of that WaveField, near the last sampled_motion."},
    {"pressure_depth", wave_field_pressure_depth, METH_VARARGS, "pressure_depth(time, north, east, depth), as of that WaveField."},
    {"motion", wave_field_motion, METH_VARARGS, "motion(time, north, east, depth, plan), as of that WaveField: velocity, acceleration, surface."},
    {"sampled_motion", wave_field_sampled_motion, METH_VARARGS, "sampled_motion(time_ns, position, rotation), as SampledWaves.motion."},
    {NULL, NULL, 0, NULL},
};

static PyObject *wave_field_held(PyObject *self, void *closure)
{
    (void)closure;
    return new_motion(((WaveField *)self)->waves.held);
}

static PyGetSetDef wave_field_attributes[] = {
    {"held", wave_field_held, NULL, "the motion of the last sampled_motion", NULL},
    {NULL, NULL, NULL, NULL, NULL},
};

static PyType_Slot wave_field_slots[] = {
    {Py_tp_doc, "WaveField(bytes of WaveField.numbers(), depth, hold_ns, half_sizes): a sim.environment.waves.WaveField,\n"
                "and its SampledWaves."},
    {Py_tp_new, wave_field_new},
    {Py_tp_dealloc, wave_field_deallocate},
    {Py_tp_methods, wave_field_methods},
    {Py_tp_getset, wave_field_attributes},
    {0, NULL},
};

static PyType_Spec wave_field_spec = {
    "sim.native._native.WaveField", sizeof(WaveField), 0, Py_TPFLAGS_DEFAULT | Py_TPFLAGS_IMMUTABLETYPE, wave_field_slots,
};

/* -- Force ----------------------------------------------------------------------------------------------------------*/

typedef struct {
    PyObject_HEAD
    Force force;
    PyObject *wave_field;
} ForceObject;

static PyObject *force_new(PyTypeObject *type, PyObject *arguments, PyObject *keywords)
{
    int kind;
    Bytes numbers, servos;
    PyObject *wave_field;
    (void)keywords;
    if (!PyArg_ParseTuple(arguments, "iO&O&O", &kind, read_bytes, &numbers, read_bytes, &servos, &wave_field))
        return NULL;
    if (wave_field != Py_None && Py_TYPE(wave_field) != wave_field_type)
        return PyErr_Format(PyExc_TypeError, "a WaveField or None is needed");
    Force force = {kind, numbers.size / (Py_ssize_t)sizeof(double), servos.size / (Py_ssize_t)sizeof(Servo), NULL, NULL,
                   wave_field != Py_None ? &((WaveField *)wave_field)->waves : NULL, 0.0};
    if (numbers.size % (Py_ssize_t)sizeof(double) != 0 || servos.size % (Py_ssize_t)sizeof(Servo) != 0
        || !force_is_complete(&force))
        return PyErr_Format(PyExc_ValueError, "a force of kind %d is not made of %zd and %zd bytes", kind,
                            numbers.size, servos.size);
    ForceObject *self = (ForceObject *)PyType_GenericAlloc(type, 0);
    if (self == NULL)
        return NULL;
    self->force = force;
    self->wave_field = Py_NewRef(wave_field);
    self->force.numbers = new_copy(numbers.data, numbers.size);
    self->force.servos = self->force.numbers != NULL ? new_copy(servos.data, servos.size) : NULL;
    if (self->force.servos == NULL)
        Py_CLEAR(self);
    return (PyObject *)self;
}

static void force_deallocate(PyObject *self)
{
    ForceObject *object = (ForceObject *)self;
    PyMem_Free(object->force.numbers);
    PyMem_Free(object->force.servos);
    Py_XDECREF(object->wave_field);
    deallocate(self);
}

static PyObject *force_begin(PyObject *self, PyObject *time)
{
    double now = PyFloat_AsDouble(time);
    if (now == -1.0 && PyErr_Occurred())
        return NULL;
    ((ForceObject *)self)->force.time = now;
    Py_RETURN_NONE;
}

static PyObject *force_set_targets(PyObject *self, PyObject *targets)
{
    Force *force = &((ForceObject *)self)->force;
    double *numbers = PyMem_Malloc(sizeof(double) * (size_t)force->servo_count);
    if (numbers == NULL)
        return PyErr_NoMemory();
    int ok = read_numbers(targets, numbers, force->servo_count);
    for (long i = 0; ok && i < force->servo_count; i++)
        force->servos[i].target = numbers[i];
    PyMem_Free(numbers);
    return ok ? Py_NewRef(Py_None) : NULL;
}

static PyObject *force_set_thrusts(PyObject *self, PyObject *thrusts)
{
    Force *force = &((ForceObject *)self)->force;
    double numbers[16];
    if (force->kind != AZIMUTHS || force->servo_count > 16)
        return PyErr_Format(PyExc_TypeError, "only azimuth thrusters take thrusts");
    if (!read_numbers(thrusts, numbers, force->servo_count))
        return NULL;
    for (long i = 0; i < force->servo_count; i++)
        ((Azimuth *)force->numbers)[i].thrust = numbers[i];
    Py_RETURN_NONE;
}

static PyObject *force_step(PyObject *self, PyObject *nothing)
{
    (void)nothing;
    step_servos(&((ForceObject *)self)->force);
    Py_RETURN_NONE;
}

static PyObject *force_values(PyObject *self, void *closure)
{
    const Force *force = &((ForceObject *)self)->force;
    (void)closure;
    PyObject *list = PyList_New(force->servo_count);
    for (long i = 0; list != NULL && i < force->servo_count; i++) {
        PyObject *number = PyFloat_FromDouble(force->servos[i].value);
        if (number == NULL)
            Py_CLEAR(list);
        else
            PyList_SetItem(list, i, number);
    }
    return list;
}

static PyMethodDef force_methods[] = {
    {"begin", force_begin, METH_O, "begin(time): set the time (s) of the waves for the next step."},
    {"set_targets", force_set_targets, METH_O, "set_targets(targets): set the servos' targets, as sim.vehicle.servos.Servos."},
    {"set_thrusts", force_set_thrusts, METH_O, "set_thrusts(thrusts): set the thrusts of azimuth thrusters, one a servo."},
    {"step", force_step, METH_NOARGS, "step(): move the servos by one step."},
    {NULL, NULL, 0, NULL},
};

static PyGetSetDef force_attributes[] = {
    {"values", force_values, NULL, "the present values of the servos", NULL},
    {NULL, NULL, NULL, NULL, NULL},
};

static PyType_Slot force_slots[] = {
    {Py_tp_doc, "Force(kind, bytes of its class's numbers(), bytes of its servos' numbers(), WaveField or None).\n\n"
                "The kinds are listed in sim/native/forces.py."},
    {Py_tp_new, force_new},
    {Py_tp_dealloc, force_deallocate},
    {Py_tp_methods, force_methods},
    {Py_tp_getset, force_attributes},
    {0, NULL},
};

static PyType_Spec force_spec = {
    "sim.native._native.Force", sizeof(ForceObject), 0, Py_TPFLAGS_DEFAULT | Py_TPFLAGS_IMMUTABLETYPE, force_slots,
};

static int add_force_types(PyObject *module)
{
    return add_known_type(module, &wave_field_spec, "WaveField", &wave_field_type)
           && add_known_type(module, &force_spec, "Force", &force_type);
}
