/* The forces of a vehicle's equipment in C, equal to the last bit to sim/vehicle/body_lift.py, fins.py, ballast.py,
 * servos.py and thrusters/azimuth.py. Those at the surface are in surface.h.
 *
 * It uses the same functions of the C library as Python, see waves.h. This file does not use the Python API.
 */

#include <math.h>
#include <stddef.h>

#include "body.h"
#include "waves.h"

enum { HULL_LIFT, CROSS_FLOW, SPEED_DAMPING, SLOW_DAMPING, FINS, BLADDER, WAVY_SURFACE, WIND, AZIMUTHS, FORCE_KINDS };

typedef struct {
    double value, target, gain, max_change;
} Servo;

/* `numbers` as the class of this kind lists them: one of the structures below. */
typedef struct {
    int kind;
    long count, servo_count;
    double *numbers;
    Servo *servos;
    const Waves *wave_field; /* of a WAVY_SURFACE, and of a WIND over waves */
    double time;
} Force;

typedef struct {
    double lift_slope, stall_angle, stall_width, parasitic_drag, induced_drag, broadside_drag;
} Polar;

typedef struct {
    Polar polar;
    double scale, vertical, position[3];
} HullLift;

enum { STRIPS = 20 };

typedef struct {
    double sway_scale, heave_scale, stations[STRIPS], table[][2]; /* speed and coefficient */
} CrossFlow;

typedef struct {
    double damping[6], rate, exponent;
} SlowDamping;

typedef struct {
    double position[3], chord[3], normal[3], scale, share;
    Polar polar;
    double sine, cosine; /* of its servo's angle */
} Fin;

typedef struct {
    double number, position[3], ahead, aside, torque, thrust, sine, cosine; /* `number` of its thruster */
} Azimuth;

typedef struct {
    double position[3], specific_weight, neutral_volume;
} Bladder;

typedef struct {
    double calm_depth, gravity, slender[3], second[3], added[3], linear[3], quadratic[3];
} WavySurface;

typedef struct {
    double frontal, lateral, coupling, center[3], height, turn, north, east, speed, gusts[][3];
} WindForce;

/* How many numbers a kind has: `first`, plus `each` once or more; a WIND may have no gusts. */
static const struct {
    long first, each;
} force_sizes[FORCE_KINDS] = {
    [HULL_LIFT] = {sizeof(HullLift) / sizeof(double), 0},
    [CROSS_FLOW] = {sizeof(CrossFlow) / sizeof(double), 2},
    [SPEED_DAMPING] = {36, 0},
    [SLOW_DAMPING] = {sizeof(SlowDamping) / sizeof(double), 0},
    [FINS] = {0, sizeof(Fin) / sizeof(double)},
    [BLADDER] = {sizeof(Bladder) / sizeof(double), 0},
    [WAVY_SURFACE] = {sizeof(WavySurface) / sizeof(double), 0},
    [WIND] = {sizeof(WindForce) / sizeof(double), 3},
    [AZIMUTHS] = {0, sizeof(Azimuth) / sizeof(double)},
};

/* Returns 1 if the force has as many numbers and servos as its kind needs. */
static int force_is_complete(const Force *force)
{
    if (force->kind < 0 || force->kind >= FORCE_KINDS)
        return 0;
    long first = force_sizes[force->kind].first, each = force_sizes[force->kind].each, rest = force->count - first;
    int turns = force->kind == FINS || force->kind == AZIMUTHS;
    long servos = turns ? force->count / each : force->kind == BLADDER;
    if (each == 0 ? rest != 0 : rest < (force->kind == WIND ? 0 : each) || rest % each != 0)
        return 0;
    return force->servo_count == servos
           && (force->kind == WIND || (force->kind == WAVY_SURFACE) == (force->wave_field != NULL));
}

static void step_servos(Force *force)
{
    for (long i = 0; i < force->servo_count; i++) {
        Servo *servo = &force->servos[i];
        double move = servo->gain * (servo->target - servo->value);
        move = move < servo->max_change ? move : servo->max_change;
        move = move > -servo->max_change ? move : -servo->max_change;
        servo->value = servo->value + move;
        if (force->kind == FINS && move != 0.0) {
            Fin *fin = (Fin *)force->numbers + i;
            fin->sine = sin(servo->value), fin->cosine = cos(servo->value);
        } else if (force->kind == AZIMUTHS && move != 0.0) {
            Azimuth *azimuth = (Azimuth *)force->numbers + i;
            azimuth->sine = sin(servo->value), azimuth->cosine = cos(servo->value);
        }
    }
}

/* remainder(alpha, pi). The C library's is exact but slow; up to 1.5 pi a difference is exact, too. */
static double remainder_by_pi(double alpha)
{
    const double pi = 3.141592653589793;
    double size = fabs(alpha);
    if (size <= 0.5 * pi)
        return alpha;
    if (size < 1.5 * pi)
        return alpha > 0.0 ? size - pi : -(size - pi);
    return remainder(alpha, pi);
}

static inline void polar_at(const Polar *polar, double alpha, double sine, double cosine, double *restrict lift,
                            double *restrict drag)
{
    double attached, beyond, share, attached_lift;
    alpha = remainder_by_pi(alpha);
    attached = alpha < polar->stall_angle ? alpha : polar->stall_angle;
    attached = attached > -polar->stall_angle ? attached : -polar->stall_angle;
    attached_lift = polar->lift_slope * attached;
    *lift = attached_lift;
    *drag = polar->parasitic_drag + polar->induced_drag * attached_lift * attached_lift;
    beyond = fabs(alpha - attached);
    if (beyond == 0.0)
        return;
    share = beyond / polar->stall_width < 1.0 ? beyond / polar->stall_width : 1.0;
    *lift = attached_lift + share * (polar->broadside_drag * (sine * cosine) - attached_lift);
    *drag = *drag + share * (polar->parasitic_drag + polar->broadside_drag * (sine * sine) - *drag);
}

/* Completes the force out[0..2] at `position` to a wrench. */
static void add_moment(const double *position, double *out)
{
    double x = position[0], y = position[1], z = position[2];
    out[3] = y * out[2] - z * out[1];
    out[4] = z * out[0] - x * out[2];
    out[5] = x * out[1] - y * out[0];
}

/* The linear velocity at `position` of a body that moves with `nu`. */
static void speed_at(const double *position, const double *nu, double *out)
{
    double x = position[0], y = position[1], z = position[2], p = nu[3], q = nu[4], r = nu[5];
    out[0] = nu[0] + q * z - r * y;
    out[1] = nu[1] + r * x - p * z;
    out[2] = nu[2] + p * y - q * x;
}

static void hull_lift_force(const HullLift *hull, const double *nu, double *out)
{
    double speed[3], lift, drag;
    speed_at(hull->position, nu, speed);
    double u = speed[0], v = speed[1], w = speed[2];
    double cross = hull->vertical != 0.0 ? w : sqrt(v * v + w * w);
    double planar = sqrt(u * u + cross * cross);
    out[0] = out[1] = out[2] = 0.0;
    if (planar != 0.0) {
        polar_at(&hull->polar, atan2(cross, u), cross / planar, u / planar, &lift, &drag);
        double factor = hull->scale * (u * u + v * v + w * w) / planar;
        double starboard = -factor * (drag * cross + lift * u);
        int is_planar = hull->vertical != 0.0 || cross == 0.0;
        out[0] = -factor * (drag * u - lift * cross);
        out[1] = is_planar ? 0.0 : starboard * v / cross;
        out[2] = is_planar ? starboard : starboard * w / cross;
    }
    add_moment(hull->position, out);
}

/* PiecewiseLinear of sim/interpolation.py, of one column. */
static double interpolate(const double (*table)[2], long rows, double x)
{
    long after = 0;
    while (after < rows && !(x < table[after][0]))
        after++;
    if (after == 0)
        return table[0][1];
    if (after == rows)
        return table[rows - 1][1];
    double share = (x - table[after - 1][0]) / (table[after][0] - table[after - 1][0]);
    return table[after - 1][1] + share * (table[after][1] - table[after - 1][1]);
}

static void cross_flow_force(const CrossFlow *flow, long rows, const double *nu, double *out)
{
    double v = nu[1], w = nu[2], q = nu[4], r = nu[5], y = 0.0, z = 0.0, m = 0.0, n = 0.0;
    double starboards[STRIPS], downs[STRIPS];
    for (int i = 0; i < STRIPS; i++) { /* apart from the sums, so that compilers vectorise it */
        double x = flow->stations[i], starboard = v + x * r, down = w - x * q;
        double size = sqrt(starboard * starboard + down * down);
        starboards[i] = starboard * size;
        downs[i] = down * size;
    }
    for (int i = 0; i < STRIPS; i++) {
        double x = flow->stations[i];
        y += starboards[i];
        z += downs[i];
        m -= x * downs[i];
        n += x * starboards[i];
    }
    double coefficient = interpolate(flow->table, rows, sqrt(v * v + w * w));
    double sway_scale = -coefficient * flow->sway_scale, heave_scale = -coefficient * flow->heave_scale;
    out[0] = out[3] = 0.0;
    out[1] = sway_scale * y;
    out[2] = heave_scale * z;
    out[4] = heave_scale * m;
    out[5] = sway_scale * n;
}

static void slow_damping_force(const SlowDamping *slow, const double *nu, double *out)
{
    double u = nu[0], v = nu[1], w = nu[2];
    double share = -exp(-slow->rate * pow(sqrt(u * u + v * v + w * w), slow->exponent));
    for (int i = 0; i < 6; i++)
        out[i] = share * slow->damping[i] * nu[i];
}

static void fins_force(const Fin *fins, const Servo *servos, long count, const double *nu, double *restrict out)
{
    for (int i = 0; i < 6; i++)
        out[i] = 0.0;
    for (long i = 0; i < count; i++) {
        const Fin *fin = &fins[i];
        double speed[3], one[6], lift, drag;
        const double *chord = fin->chord, *normal = fin->normal;
        speed_at(fin->position, nu, speed);
        double along = speed[0] * chord[0] + speed[1] * chord[1] + speed[2] * chord[2];
        double across = fin->share * (speed[0] * normal[0] + speed[1] * normal[1] + speed[2] * normal[2]);
        double size = sqrt(along * along + across * across), sine = fin->sine, cosine = fin->cosine;
        if (size == 0.0)
            continue;
        polar_at(&fin->polar, servos[i].value - atan2(across, along), (sine * along - cosine * across) / size,
                 (cosine * along + sine * across) / size, &lift, &drag);
        double factor = fin->scale * size;
        double ahead = -factor * (drag * along + lift * across), aside = factor * (lift * along - drag * across);
        for (int axis = 0; axis < 3; axis++)
            one[axis] = ahead * chord[axis] + aside * normal[axis];
        add_moment(fin->position, one);
        for (int axis = 0; axis < 6; axis++)
            out[axis] = out[axis] + one[axis];
    }
}

/* sim/forces.py: `buoyancy` is a force up, and its centre times it, along the body axes. */
static void buoyancy_wrench(const double *buoyancy, const double *rotation, double *out)
{
    double force = buoyancy[0], x = buoyancy[1], y = buoyancy[2], z = buoyancy[3];
    double zx = rotation[6], zy = rotation[7], zz = rotation[8];
    out[0] = -force * zx, out[1] = -force * zy, out[2] = -force * zz;
    out[3] = z * zy - y * zz, out[4] = x * zz - z * zx, out[5] = y * zx - x * zy;
}

static void bladder_force(const Bladder *bladder, double volume, const double *rotation, double *out)
{
    double force = bladder->specific_weight * (volume - bladder->neutral_volume);
    const double *centre = bladder->position;
    double lift[4] = {force, force * centre[0], force * centre[1], force * centre[2]};
    buoyancy_wrench(lift, rotation, out);
}

/* AzimuthSet.wrench */
static void azimuths_force(const Azimuth *azimuths, long count, double *out)
{
    for (int i = 0; i < 6; i++)
        out[i] = 0.0;
    for (long i = 0; i < count; i++) {
        const Azimuth *one = &azimuths[i];
        double x = one->position[0], y = one->position[1], z = one->position[2];
        double ahead = one->thrust * (one->ahead * one->cosine - one->aside * one->sine - one->ahead);
        double aside = one->thrust * (one->ahead * one->sine + one->aside * one->cosine - one->aside);
        double all[6] = {ahead, aside, 0.0, one->torque * ahead - z * aside, z * ahead + one->torque * aside,
                         x * aside - y * ahead};
        for (int axis = 0; axis < 6; axis++)
            out[axis] = out[axis] + all[axis];
    }
}
