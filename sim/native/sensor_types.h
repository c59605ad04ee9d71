/* The Python types of sensors: Errors, and Imu, which makes a sample of an inertial measurement unit in one call.
 * Include step_types.h first. */

/* -- Errors ---------------------------------------------------------------------------------------------------------*/

enum { MAX_CHANNELS = 32 };

typedef struct {
    PyObject_HEAD
    Py_ssize_t count;
    Random random;
    Channel channels[MAX_CHANNELS];
} Errors;

static PyTypeObject *errors_type;

static PyObject *errors_new(PyTypeObject *type, PyObject *arguments, PyObject *keywords)
{
    Bytes numbers, key;
    PyObject *second;
    (void)keywords;
    if (!PyArg_ParseTuple(arguments, "O&O&O", read_bytes, &numbers, read_bytes, &key, &second))
        return NULL;
    if (key.size != (TWISTER_SIZE + 1) * (Py_ssize_t)sizeof(uint32_t))
        return PyErr_Format(PyExc_ValueError, "a state of %d numbers is needed", TWISTER_SIZE + 1);
    PyObject *self = new_with_records(type, numbers, sizeof(Channel), MAX_CHANNELS, offsetof(Errors, channels));
    if (self == NULL)
        return NULL;
    Errors *errors = (Errors *)self;
    uint32_t index;
    memcpy(errors->random.key, key.data, sizeof errors->random.key);
    memcpy(&index, key.data + sizeof errors->random.key, sizeof index);
    errors->random.index = index < TWISTER_SIZE ? (int)index : TWISTER_SIZE;
    errors->random.has_second = second != Py_None;
    errors->random.second = errors->random.has_second ? PyFloat_AsDouble(second) : 0.0;
    if (PyErr_Occurred())
        Py_CLEAR(self);
    return self;
}

static void measure_all(Errors *errors, double *values)
{
    for (Py_ssize_t i = 0; i < errors->count; i++)
        values[i] = measure(&errors->channels[i], &errors->random, values[i]);
}

static PyObject *errors_measure(PyObject *self, PyObject *true_values)
{
    Errors *errors = (Errors *)self;
    double values[MAX_CHANNELS];
    if (!read_numbers(true_values, values, errors->count))
        return NULL;
    measure_all(errors, values);
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

/* -- Imu: sim/sensors/imu.py in C, for a unit aligned with the vehicle's axes ---------------------------------------*/

enum { IMU_CHANNELS = 9 };

typedef struct {
    PyObject_HEAD
    Errors *errors;
    PyTypeObject *record;
    double position[3], gravity;
} Imu;

static void specific_force(const double *numbers, const double *position, double gravity, double *out)
{
    const double *nu = numbers + NU, *nu_dot = numbers + NU_DOT;
    double u = nu[0], v = nu[1], w = nu[2], p = nu[3], q = nu[4], r = nu[5];
    double du = nu_dot[0], dv = nu_dot[1], dw = nu_dot[2], dp = nu_dot[3], dq = nu_dot[4], dr = nu_dot[5];
    double x = position[0], y = position[1], z = position[2], rotation[9];
    if (x != 0.0 || y != 0.0 || z != 0.0) {
        u += q * z - r * y;
        v += r * x - p * z;
        w += p * y - q * x;
        du = du + dq * z - dr * y;
        dv = dv + dr * x - dp * z;
        dw = dw + dp * y - dq * x;
    }
    matrix(numbers + QUATERNION, rotation);
    out[0] = du + q * w - r * v - gravity * rotation[6];
    out[1] = dv + r * u - p * w - gravity * rotation[7];
    out[2] = dw + p * v - q * u - gravity * rotation[8];
}

static PyObject *imu_new(PyTypeObject *type, PyObject *arguments, PyObject *keywords)
{
    PyObject *errors, *record, *position;
    double offset[3], gravity;
    (void)keywords;
    if (!PyArg_ParseTuple(arguments, "O!O!Od", errors_type, &errors, &PyType_Type, &record, &position, &gravity)
        || !read_numbers(position, offset, 3))
        return NULL;
    if (((Errors *)errors)->count != IMU_CHANNELS)
        return PyErr_Format(PyExc_ValueError, "the errors of %d quantities are needed", IMU_CHANNELS);
    if (!PyType_IsSubtype((PyTypeObject *)record, &PyTuple_Type))
        return PyErr_Format(PyExc_TypeError, "a class of tuples is needed");
    Imu *imu = (Imu *)PyType_GenericAlloc(type, 0);
    if (imu == NULL)
        return NULL;
    imu->errors = (Errors *)Py_NewRef(errors);
    imu->record = (PyTypeObject *)Py_NewRef(record);
    memcpy(imu->position, offset, sizeof offset);
    imu->gravity = gravity;
    return (PyObject *)imu;
}

static void imu_deallocate(PyObject *self)
{
    Py_XDECREF((PyObject *)((Imu *)self)->errors);
    Py_XDECREF((PyObject *)((Imu *)self)->record);
    deallocate(self);
}

static PyObject *imu_sample(PyObject *self, PyObject *const *arguments, Py_ssize_t count)
{
    Imu *imu = (Imu *)self;
    double numbers[NUMBERS], values[IMU_CHANNELS] = {0.0}, attitude[4];
    if (count != 2)
        return PyErr_Format(PyExc_TypeError, "sample() takes time_ns and state");
    if (!load_state(arguments[1], numbers))
        return NULL;
    memcpy(values + 3, numbers + NU + 3, 3 * sizeof(double));
    specific_force(numbers, imu->position, imu->gravity, values + 6);
    measure_all(imu->errors, values);
    if (!integrate(numbers + QUATERNION, values, 1.0, attitude))
        return PyErr_Format(PyExc_FloatingPointError, "a quaternion of length 0");
    const double *a = attitude, *rate = values + 3, *force = values + 6;
    return new_record(imu->record, Py_BuildValue("O(dddd)(ddd)(ddd)", arguments[0], a[0], a[1], a[2], a[3], rate[0],
                                                 rate[1], rate[2], force[0], force[1], force[2]));
}

static PyMethodDef imu_methods[] = {
    {"sample", (PyCFunction)(void (*)(void))imu_sample, METH_FASTCALL,
     "sample(time_ns, state): the measurement of the state, as sim.sensors.imu.Imu.sample does."},
    {NULL, NULL, 0, NULL},
};

static PyType_Slot imu_slots[] = {
    {Py_tp_doc, "One unit along the vehicle's axes: Imu(errors, the samples' class, position, gravity).\n\n"
                "Position in m along the body axes, gravity in m/s2."},
    {Py_tp_new, imu_new},
    {Py_tp_dealloc, imu_deallocate},
    {Py_tp_methods, imu_methods},
    {0, NULL},
};

static PyType_Spec imu_spec = {
    "sim.native._native.Imu", sizeof(Imu), 0, Py_TPFLAGS_DEFAULT | Py_TPFLAGS_IMMUTABLETYPE, imu_slots,
};

static int add_sensor_types(PyObject *module)
{
    return add_known_type(module, &errors_spec, "Errors", &errors_type) && add_type(module, &imu_spec, "Imu");
}
