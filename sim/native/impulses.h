/* Collision impulses of a vehicle: sim/environment/contact/impulses.py explains what is computed and why. */

#define MAX_TOUCHES 8
#define MAX_ROUNDS 30
#define TOLERANCE 1e-4
#define MIN_SPEED 1e-12
#define REST_SPEED 0.03

typedef struct {
    double row[6], response[6], inertia, before, target, impulse;
} Impulse;

static double impulse_speed(const Impulse *impulse, const double *nu)
{
    const double *d = impulse->row;
    return d[0] * nu[0] + d[1] * nu[1] + d[2] * nu[2] + d[3] * nu[3] + d[4] * nu[4] + d[5] * nu[5];
}

static void impulse_set(Impulse *impulse, const double *n, const double *lever, const double *mass, const double *nu)
{
    double *d = impulse->row, x = lever[0], y = lever[1], z = lever[2];
    memcpy(d, n, 3 * sizeof *d);
    d[3] = y * n[2] - z * n[1];
    d[4] = z * n[0] - x * n[2];
    d[5] = x * n[1] - y * n[0];
    for (int i = 0; i < 6; i++) {
        const double *m = mass + 6 * i;
        impulse->response[i] = m[0] * d[0] + m[1] * d[1] + m[2] * d[2] + m[3] * d[3] + m[4] * d[4] + m[5] * d[5];
    }
    impulse->inertia = 1.0 / impulse_speed(impulse, impulse->response);
    impulse->before = impulse_speed(impulse, nu);
    impulse->target = impulse->impulse = 0.0;
}

/* The function _sliding; returns 0 if the point does not slide. */
static int impulse_sliding(Impulse *slide, const Impulse *normal, const double *lever, const double *mass,
                           const double *nu)
{
    double closing = normal->before, x = lever[0], y = lever[1], z = lever[2], p = nu[3], q = nu[4], r = nu[5];
    double u = nu[0] + q * z - r * y - closing * normal->row[0];
    double v = nu[1] + r * x - p * z - closing * normal->row[1];
    double w = nu[2] + p * y - q * x - closing * normal->row[2];
    double speed = sqrt(u * u + v * v + w * w);
    if (!(speed > MIN_SPEED))
        return 0;
    double along[3] = {u / speed, v / speed, w / speed};
    impulse_set(slide, along, lever, mass, nu);
    return 1;
}

static void apply_impulse(const Impulse *impulse, double change, double *nu)
{
    for (int i = 0; i < 6; i++)
        nu[i] = nu[i] + change * impulse->response[i];
}

static void impulses_solve(Impulse *normals, Impulse *slides, const int *is_sliding, int count, double friction,
                           double *nu)
{
    double closing = normals[0].target - normals[0].before;
    for (int i = 1; i < count; i++)
        if (normals[i].target - normals[i].before > closing)
            closing = normals[i].target - normals[i].before;
    for (int round = 0; round < MAX_ROUNDS; round++) {
        double largest = 0.0;
        for (int i = 0; i < count; i++) {
            Impulse *row = normals + i, *slide = slides + i;
            double change = (row->target - impulse_speed(row, nu)) * row->inertia;
            if (change < -row->impulse)
                change = -row->impulse;
            if (change != 0.0) {
                double moved = fabs(change) / row->inertia;
                largest = moved > largest ? moved : largest;
                row->impulse += change;
                apply_impulse(row, change, nu);
            }
            if (is_sliding[i]) {
                double limit = friction * row->impulse;
                double target = slide->impulse - impulse_speed(slide, nu) * slide->inertia;
                target = target < -limit ? -limit : limit < target ? limit : target;
                change = target - slide->impulse;
                if (change != 0.0) {
                    slide->impulse = target;
                    apply_impulse(slide, change, nu);
                }
            }
        }
        if (largest <= TOLERANCE * closing || largest < MIN_SPEED)
            break;
    }
}

/* Reads the touches, 7 numbers each (depth, normal, lever), and the inverse mass. Returns their number, or -1. */
static int read_touches(PyObject *touches, PyObject *matrix, double *numbers, double *mass)
{
    Py_ssize_t size = PySequence_Size(touches);
    if (size < 7 || size > 7 * MAX_TOUCHES || size % 7) {
        PyErr_Format(PyExc_ValueError, "1 to %d touches of 7 numbers are needed", MAX_TOUCHES);
        return -1;
    }
    return read_numbers(touches, numbers, size) && read_numbers(matrix, mass, 36) ? (int)(size / 7) : -1;
}

static PyObject *apply_impulses(PyObject *module, PyObject *arguments)
{
    PyObject *touches, *matrix, *before;
    double numbers[7 * MAX_TOUCHES], mass[36], start[6], nu[6], friction, restitution, total[6] = {0.0};
    (void)module;
    if (!PyArg_ParseTuple(arguments, "OOOdd", &touches, &matrix, &before, &friction, &restitution)
        || !read_numbers(before, start, 6))
        return NULL;
    int count = read_touches(touches, matrix, numbers, mass), is_sliding[MAX_TOUCHES] = {0};
    if (count < 0)
        return NULL;
    Impulse normals[MAX_TOUCHES], slides[MAX_TOUCHES];
    int is_closing = 0;
    for (int i = 0; i < count; i++) {
        const double *touch = numbers + 7 * i;
        impulse_set(normals + i, touch + 1, touch + 4, mass, start);
        is_closing |= !(normals[i].before >= 0.0);
        if (friction > 0.0)
            is_sliding[i] = impulse_sliding(slides + i, normals + i, touch + 4, mass, start);
        normals[i].target = normals[i].before < -REST_SPEED ? -restitution * normals[i].before : 0.0;
    }
    memcpy(nu, start, sizeof nu);
    if (is_closing) {
        impulses_solve(normals, slides, is_sliding, count, friction, nu);
        double energy = 0.0;
        for (int i = 0; i < count; i++)
            energy += normals[i].impulse * (normals[i].before + impulse_speed(normals + i, nu));
        for (int i = 0; i < count; i++)
            if (is_sliding[i])
                energy += slides[i].impulse * (slides[i].before + impulse_speed(slides + i, nu));
        if (energy > 0.0) {
            for (int i = 0; i < count; i++)
                normals[i].impulse = normals[i].target = 0.0;
            memset(is_sliding, 0, sizeof is_sliding);
            memcpy(nu, start, sizeof nu);
            impulses_solve(normals, slides, is_sliding, count, 0.0, nu);
        }
        for (int i = 0; i < count; i++)
            for (int j = 0; j < 6; j++)
                total[j] = total[j] + normals[i].impulse * normals[i].row[j];
        for (int i = 0; i < count; i++)
            for (int j = 0; is_sliding[i] && j < 6; j++)
                total[j] = total[j] + slides[i].impulse * slides[i].row[j];
    }
    return Py_BuildValue("(NN)", new_list(nu, 6), new_list(total, 6));
}

static PyObject *impulses_separate(PyObject *module, PyObject *arguments)
{
    PyObject *touches, *matrix;
    double numbers[7 * MAX_TOUCHES], mass[36], motion[6] = {0.0};
    (void)module;
    if (!PyArg_ParseTuple(arguments, "OO", &touches, &matrix))
        return NULL;
    int count = read_touches(touches, matrix, numbers, mass), is_sliding[MAX_TOUCHES] = {0};
    if (count < 0)
        return NULL;
    Impulse normals[MAX_TOUCHES];
    for (int i = 0; i < count; i++) {
        impulse_set(normals + i, numbers + 7 * i + 1, numbers + 7 * i + 4, mass, motion);
        normals[i].target = numbers[7 * i];
    }
    impulses_solve(normals, normals, is_sliding, count, 0.0, motion);
    return new_list(motion, 6);
}

static PyMethodDef impulses_functions[] = {
    {"apply_impulses", apply_impulses, METH_VARARGS,
     "apply_impulses(touches, inverse_mass, nu, friction, restitution): nu and impulse after a collision. `touches` are 7 numbers each,\n"
     "depth, normal, lever; `inverse_mass` 36 numbers."},
    {"separate", impulses_separate, METH_VARARGS, "separate(touches, inverse_mass): the least displacement that removes all depths."},
    {NULL, NULL, 0, NULL},
};

static int add_impulses(PyObject *module)
{
    return PyModule_AddFunctions(module, impulses_functions) == 0;
}
