/* The step of sim/dynamics.py in C, equal to the last bit: same operations, same order, same names.
 *
 * sim/dynamics.py is the specification and explains the equations. Compile with -ffp-contract=off: a fused multiply-add
 * rounds once where Python rounds twice. This file does not use the Python API.
 */

#include <math.h>

#include "body.h"
#include "surface.h"

/* A body with the forces on it besides its thrusters. */
enum { MAX_FORCES = 8 };

typedef struct {
    Body body;
    int count;
    Force *forces[MAX_FORCES];
} Model;

/* A state is an array of 13 numbers: position, quaternion, nu. */
enum { POSITION = 0, QUATERNION = 3, NU = 7, SIZE = 13 };

/* sim/rotations.py */

static void matrix(const double *quaternion, double *rotation)
{
    double w = quaternion[0], x = quaternion[1], y = quaternion[2], z = quaternion[3];
    double xx = x * x, yy = y * y, zz = z * z;
    double xy = x * y, xz = x * z, yz = y * z;
    double wx = w * x, wy = w * y, wz = w * z;
    rotation[0] = 1.0 - 2.0 * (yy + zz), rotation[1] = 2.0 * (xy - wz), rotation[2] = 2.0 * (xz + wy);
    rotation[3] = 2.0 * (xy + wz), rotation[4] = 1.0 - 2.0 * (xx + zz), rotation[5] = 2.0 * (yz - wx);
    rotation[6] = 2.0 * (xz - wy), rotation[7] = 2.0 * (yz + wx), rotation[8] = 1.0 - 2.0 * (xx + yy);
}

static void multiply(const double *first, double w, double x, double y, double z, double *out)
{
    double a = first[0], b = first[1], c = first[2], d = first[3];
    out[0] = a * w - b * x - c * y - d * z;
    out[1] = a * x + b * w + c * z - d * y;
    out[2] = a * y - b * z + c * w + d * x;
    out[3] = a * z + b * y - c * x + d * w;
}

/* Returns 0 for a quaternion of length 0, where Python raises FloatingPointError. */
static int normalise(const double *quaternion, double *out)
{
    double w = quaternion[0], x = quaternion[1], y = quaternion[2], z = quaternion[3];
    double length = sqrt(w * w + x * x + y * y + z * z), scale = 1.0 / length;
    out[0] = w * scale, out[1] = x * scale, out[2] = y * scale, out[3] = z * scale;
    return length != 0.0;
}

/* `out` may be `quaternion`. Returns 0 as normalise does. */
static int integrate(const double *quaternion, const double *omega, double dt, double *out)
{
    double turned[4], half = 0.5 * dt;
    multiply(quaternion, 1.0, half * omega[0], half * omega[1], half * omega[2], turned);
    return normalise(turned, out);
}

/* sim/dynamics.py */

static void over_ground(const double *rotation, const double *nu, double *out)
{
    for (int i = 0; i < 3; i++)
        out[i] = rotation[3 * i] * nu[0] + rotation[3 * i + 1] * nu[1] + rotation[3 * i + 2] * nu[2];
}

static void damping(const Body *body, const double *nu, double *out)
{
    double squares[6], quadratic[6];
    if (body->diagonal) {
        for (int i = 0; i < 6; i++)
            out[i] = (body->linear[i][i] + body->quadratic[i][i] * fabs(nu[i])) * nu[i];
        return;
    }
    for (int i = 0; i < 6; i++)
        squares[i] = fabs(nu[i]) * nu[i];
    times(body->linear, nu, out);
    times(body->quadratic, squares, quadratic);
    for (int i = 0; i < 6; i++)
        out[i] = out[i] + quadratic[i];
}

static void munk_relief(const Body *body, const double *nu, double *out)
{
    double u = nu[0], v = nu[1], w = nu[2], momentum[3];
    const double *reduction = body->munk_reduction;
    for (int i = 0; i < 3; i++) {
        const double *row = body->added_mass_linear[i];
        momentum[i] = row[0] * u + row[1] * v + row[2] * w;
    }
    double lx = momentum[0], ly = momentum[1], lz = momentum[2];
    double p = nu[3] * reduction[0], q = nu[4] * reduction[1], r = nu[5] * reduction[2];
    out[0] = q * lz - r * ly;
    out[1] = r * lx - p * lz;
    out[2] = p * ly - q * lx;
    out[3] = reduction[0] * (v * lz - w * ly);
    out[4] = reduction[1] * (w * lx - u * lz);
    out[5] = reduction[2] * (u * ly - v * lx);
}

static void restoring(const Body *body, double depth, const double *rotation, double *out)
{
    double zx = rotation[6], zy = rotation[7], zz = rotation[8];
    double lift[4], excess, moment_x, moment_y, moment_z;
    hull_buoyancy(body, depth, rotation + 6, lift);
    excess = body->weight - lift[0];
    moment_x = body->weight_moment[0] - lift[1];
    moment_y = body->weight_moment[1] - lift[2];
    moment_z = body->weight_moment[2] - lift[3];
    out[0] = excess * zx;
    out[1] = excess * zy;
    out[2] = excess * zz;
    out[3] = moment_y * zz - moment_z * zy;
    out[4] = moment_z * zx - moment_x * zz;
    out[5] = moment_x * zy - moment_y * zx;
}

/* Dynamics.add_forces and Dynamics.acceleration in one, because both need the velocity through the water. */
static void acceleration(const Model *model, const double *position, const double *rotation, const double *nu,
                         const double *thrust, const double *current, double *nu_dot)
{
    const Body *body = &model->body;
    double water[3], nu_r[6], wrench[6], momentum[6], d[6], g[6], force[6];
    for (int i = 0; i < 3; i++) {
        water[i] = rotation[i] * current[0] + rotation[3 + i] * current[1] + rotation[6 + i] * current[2];
        nu_r[i] = nu[i] - water[i];
        nu_r[3 + i] = nu[3 + i];
    }
    for (int i = 0; i < 6; i++)
        wrench[i] = thrust[i];
    for (int i = 0; i < model->count; i++) {
        force_wrench(model->forces[i], body, position, rotation, nu_r, nu, force);
        for (int axis = 0; axis < 6; axis++)
            wrench[axis] = wrench[axis] + force[axis];
    }
    double u = nu_r[0], v = nu_r[1], w = nu_r[2], p = nu[3], q = nu[4], r = nu[5];
    times(body->mass, nu_r, momentum);
    double lx = momentum[0], ly = momentum[1], lz = momentum[2];
    double hx = momentum[3], hy = momentum[4], hz = momentum[5];
    damping(body, nu_r, d);
    restoring(body, position[2], rotation, g);
    force[0] = wrench[0] + g[0] - d[0] - (q * lz - r * ly);
    force[1] = wrench[1] + g[1] - d[1] - (r * lx - p * lz);
    force[2] = wrench[2] + g[2] - d[2] - (p * ly - q * lx);
    force[3] = wrench[3] + g[3] - d[3] - (v * lz - w * ly + q * hz - r * hy);
    force[4] = wrench[4] + g[4] - d[4] - (w * lx - u * lz + r * hx - p * hz);
    force[5] = wrench[5] + g[5] - d[5] - (u * ly - v * lx + p * hy - q * hx);
    if (body->reduces_munk) {
        munk_relief(body, nu_r, d);
        for (int i = 0; i < 6; i++)
            force[i] = force[i] + d[i];
    }
    times(body->inverse_mass, force, nu_dot);
    nu_dot[0] += r * water[1] - q * water[2];
    nu_dot[1] += p * water[2] - r * water[0];
    nu_dot[2] += q * water[0] - p * water[1];
}

/* The state half a step later: `mid` is position, quaternion and predicted nu. Returns 0 as normalise does. */
static int predict_midpoint(const Body *body, const double *at, const double *nu_dot, double dt, double *mid, double *rotation)
{
    double velocity[3], half = 0.5 * dt;
    int ok = integrate(at + QUATERNION, at + NU + 3, half, mid + QUATERNION);
    matrix(mid + QUATERNION, rotation);
    over_ground(rotation, at + NU, velocity);
    for (int i = 0; i < 3; i++)
        mid[i] = at[i] + half * velocity[i];
    for (int i = 0; i < 6; i++) {
        double rate = body->linear[i][i] * body->inverse_mass[i][i];
        double slope = 2.0 * body->quadratic[i][i] * body->inverse_mass[i][i];
        double share = 1.0 - dt * (rate + slope * fabs(at[NU + i]));
        mid[NU + i] = at[NU + i] + half * (share > 0.0 ? share : 0.0) * nu_dot[i];
    }
    return ok;
}

/* Advances `at` by `dt`; `nu_dot` is that of the last step, then of this one. Returns 0 if its quaternion is zero. */
static int step(const Model *model, double *at, double *nu_dot, const double *wrench, const double *current, double dt)
{
    double mid[SIZE], rotation[9], velocity[3], half = 0.5 * dt;
    int ok = predict_midpoint(&model->body, at, nu_dot, dt, mid, rotation);
    acceleration(model, mid + POSITION, rotation, mid + NU, wrench, current, nu_dot);
    for (int i = 0; i < 6; i++)
        at[NU + i] = at[NU + i] + dt * nu_dot[i];
    over_ground(rotation, at + NU, velocity);
    for (int i = 0; i < 3; i++)
        at[i] = mid[i] + half * velocity[i];
    return integrate(mid + QUATERNION, at + NU + 3, half, at + QUATERNION) && ok;
}
