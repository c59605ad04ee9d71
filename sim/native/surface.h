/* The forces of waves and wind at the surface in C, equal to the last bit to sim/environment/stratification.py and
 * wind.py, and the choice among all forces.
 *
 * It uses the same functions of the C library as Python, see waves.h. This file does not use the Python API.
 */

#include "forces.h"

/* _shear of sim/environment/stratification.py */
static void shear(const double *gradient, const double *rotation, double *out)
{
    double nn = gradient[0], ne = gradient[1], ee = gradient[2], nd = gradient[3], ed = gradient[4], dd = -(nn + ee);
    double turned[3][3]; /* the gradient times the body's axes; that of x is not needed */
    for (int i = 1; i < 3; i++) {
        double north = rotation[i], east = rotation[3 + i], down = rotation[6 + i];
        turned[i][0] = nn * north + ne * east + nd * down;
        turned[i][1] = ne * north + ee * east + ed * down;
        turned[i][2] = nd * north + ed * east + dd * down;
    }
    out[0] = rotation[1] * turned[2][0] + rotation[4] * turned[2][1] + rotation[7] * turned[2][2];
    out[1] = -(rotation[0] * turned[2][0] + rotation[3] * turned[2][1] + rotation[6] * turned[2][2]);
    out[2] = rotation[0] * turned[1][0] + rotation[3] * turned[1][1] + rotation[6] * turned[1][2];
}

/* WavySurface._at_surface */
static double at_surface(const Force *force, const Body *body, const double *position, const double *rotation, double *out)
{
    const double *pull = force->wave_field->held + 3, *slopes = force->wave_field->held + 8;
    double calm[4], lift[4], mass[4], tilted[3], push[3], share;
    for (int i = 0; i < 3; i++) {
        tilted[i] = rotation[6 + i] + slopes[0] * rotation[i] + slopes[1] * rotation[3 + i];
        push[i] = rotation[i] * pull[0] + rotation[3 + i] * pull[1] + rotation[6 + i] * pull[2];
    }
    hull_buoyancy(body, position[2], rotation + 6, calm);
    hull_buoyancy(body, position[2] + surface(force->wave_field, force->time, position[0], position[1]), tilted, lift);
    share = lift[0] / body->submerged[0];
    for (int i = 0; i < 4; i++) {
        mass[i] = (lift[i] - body->submerged[i]) / ((const WavySurface *)force->numbers)->gravity;
        lift[i] = lift[i] - calm[i];
    }
    buoyancy_wrench(lift, rotation, out);
    for (int i = 0; i < 3; i++) {
        int next = (i + 1) % 3, last = (i + 2) % 3;
        out[i] = out[i] + mass[0] * push[i];
        out[3 + i] = out[3 + i] + (mass[1 + next] * push[last] - mass[1 + last] * push[next]);
    }
    return share;
}

static void wavy_surface_force(const Force *force, const Body *body, const double *position, const double *rotation,
                               const double *nu, double *out)
{
    const WavySurface *waves = (const WavySurface *)force->numbers;
    double turn[3], accelerated[3], share = 1.0;
    for (int i = 0; i < 6; i++)
        out[i] = 0.0;
    if (position[2] < waves->calm_depth)
        share = at_surface(force, body, position, rotation, out);
    shear(force->wave_field->held + 10, rotation, turn);
    shear(force->wave_field->held + 15, rotation, accelerated);
    for (int i = 0; i < 3; i++) {
        double speed = nu[3 + i], relative = nu[3 + i] - waves->slender[i] * turn[i];
        out[3 + i] = out[3 + i] + (share * waves->second[i] + waves->added[i] * waves->slender[i]) * accelerated[i]
                     + waves->linear[i] * (speed - relative)
                     + waves->quadratic[i] * (fabs(speed) * speed - fabs(relative) * relative);
    }
}

/* WindForce.wrench */
static void wind_force(const Force *force, const double *position, const double *rotation, const double *nu, double *out)
{
    const WindForce *wind = (const WindForce *)force->numbers;
    double x = wind->center[0], y = wind->center[1], z = wind->center[2], depth = position[2], speed = wind->speed;
    long gusts = (force->count - force_sizes[WIND].first) / force_sizes[WIND].each;
    for (int i = 0; i < 6; i++)
        out[i] = 0.0;
    if (force->wave_field != NULL)
        depth = depth + surface(force->wave_field, force->time, position[0], position[1]);
    double share = 0.5 - (depth + rotation[6] * x + rotation[7] * y + rotation[8] * z) / wind->height;
    if (!(share > 0.0))
        return;
    share = share < 1.0 ? share : 1.0;
    for (long i = 0; i < gusts; i++)
        speed += wind->gusts[i][0] * cos(wind->gusts[i][1] * force->time + wind->gusts[i][2]);
    double u = speed * (rotation[0] * wind->north + rotation[3] * wind->east) - nu[0];
    double v = speed * (rotation[1] * wind->north + rotation[4] * wind->east) - nu[1];
    double size = sqrt(u * u + v * v);
    if (size == 0.0)
        return;
    double ahead = u / size, aside = v / size;
    double factor = share * size / (1.0 - wind->coupling * (ahead * aside) * (ahead * aside));
    double surge = factor * wind->frontal * u, sway = factor * wind->lateral * v;
    ahead = ahead < 1.0 ? ahead : 1.0;
    x -= wind->turn * asin(ahead > -1.0 ? ahead : -1.0);
    z -= 0.5 * (1.0 - share) * wind->height;
    out[0] = surge, out[1] = sway;
    out[3] = -z * sway, out[4] = z * surge, out[5] = x * sway - y * surge;
}

/* The wrench of one force; arguments as in sim/forces.py, `nu_r` through the water, `nu` over ground. */
static void force_wrench(const Force *force, const Body *body, const double *position, const double *rotation,
                         const double *nu_r, const double *nu, double *out)
{
    const void *numbers = force->numbers;
    double speed = -fabs(nu_r[0]);
    switch (force->kind) {
    case HULL_LIFT:
        hull_lift_force(numbers, nu_r, out);
        break;
    case CROSS_FLOW:
        cross_flow_force(numbers, (force->count - force_sizes[CROSS_FLOW].first) / 2, nu_r, out);
        break;
    case SPEED_DAMPING:
        times(numbers, nu_r, out);
        for (int i = 0; i < 6; i++)
            out[i] = speed * out[i];
        break;
    case SLOW_DAMPING:
        slow_damping_force(numbers, nu_r, out);
        break;
    case FINS:
        fins_force(numbers, force->servos, force->servo_count, nu_r, out);
        break;
    case BLADDER:
        bladder_force(numbers, force->servos[0].value, rotation, out);
        break;
    case WAVY_SURFACE:
        wavy_surface_force(force, body, position, rotation, nu_r, out);
        break;
    case WIND:
        wind_force(force, position, rotation, nu, out);
        break;
    default:
        azimuths_force(numbers, force->servo_count, out);
    }
}
