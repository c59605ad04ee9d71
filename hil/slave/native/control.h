/* hil/autonomy/control.py, hil/autonomy/allocation.py and the pulses of sim/thrusters.py once more, to the last bit:
 * same operations, same order, same names.
 *
 * The Python says what they are and why; here is only what makes them fast. Compile with -ffp-contract=off. Nothing of
 * Python is in this file.
 */

#include <float.h>
#include <math.h>
#include <string.h>

#if FLT_EVAL_METHOD != 0 || defined(__FAST_MATH__)
#error "doubles must be computed as doubles, in the order written"
#endif

enum { AXES = 6, MOST_THRUSTERS = 16 };

static const double PI = 3.141592653589793, ABSURD = 1e6, ROUNDING = 1e-6, LEAST_UPRIGHT = 0.5;

/* What a cascade is, as CascadedController.numbers() lists it. */
typedef struct {
    double p, i, d, limit, feedforward, filter, slew;
} AxisGains;

typedef struct {
    double p, limit;
} HoldGains;

typedef struct {
    AxisGains axes[AXES];
    HoldGains depth, heading, roll, pitch;
    double inertia[AXES];
} Law;

/* What a loop keeps from call to call. */
typedef struct {
    double integral, slope, output, behind, last;
    int has_last;
} Loop;

typedef struct {
    double surge, sway, heave, yaw_rate, depth, heading;
    int has_depth, has_heading;
} Command;

typedef struct {
    double orientation[4], angular_velocity[3], velocity[3], depth;
} Navigation;

/* Python's max and min: of two that do not compare, the first. */
static double larger(double a, double b)
{
    return b > a ? b : a;
}

static double smaller(double a, double b)
{
    return b < a ? b : a;
}

static double clamp(double value, double limit)
{
    return value > limit ? limit : value < -limit ? -limit : value;
}

/* Python's %: the sign is that of the divisor, which is positive here. */
static double modulo(double value, double divisor)
{
    double rest = fmod(value, divisor);
    if (rest == 0.0)
        return 0.0;
    return rest < 0.0 ? rest + divisor : rest;
}

static double wrap(double angle)
{
    return modulo(angle + PI, 2.0 * PI) - PI;
}

static double heading_of(const double *orientation)
{
    double w = orientation[0], x = orientation[1], y = orientation[2], z = orientation[3];
    return atan2(2.0 * (w * z + x * y), 1.0 - 2.0 * (y * y + z * z));
}

static double slewed(Loop *loop, double slew, double output, double dt)
{
    double most = slew * dt, before = output;
    loop->output = smaller(larger(output, loop->output - most), loop->output + most);
    loop->behind = before - loop->output;
    return loop->output;
}

static double damped(Loop *loop, double measured, double dt, double time_constant)
{
    if (loop->has_last)
        loop->slope += ((measured - loop->last) / dt - loop->slope) * dt / (time_constant + dt);
    loop->last = measured;
    loop->has_last = 1;
    return loop->slope;
}

static double follow(Loop *loop, const AxisGains *gains, double target, double measured, double dt, double lack)
{
    double limit = gains->limit;
    if (!(fabs(measured) < ABSURD && fabs(target) < ABSURD))
        return slewed(loop, gains->slew, loop->integral, dt);
    double error = target - measured;
    double wanted = gains->p * error + gains->feedforward * target;
    if (gains->d != 0.0)
        wanted -= gains->d * damped(loop, measured, dt, gains->filter);
    double integral = loop->integral + gains->i * error * dt, output = wanted + integral;
    if (!((fabs(output) > limit && output * error > 0.0) || (fabs(lack) > ROUNDING && lack * error > 0.0)
          || loop->behind * error > 0.0))
        loop->integral = clamp(integral, limit);
    output = clamp(wanted + loop->integral, limit);
    return gains->slew == INFINITY ? output : slewed(loop, gains->slew, output, dt);
}

static double heave_for_depth(double depth, const Navigation *navigation, const double *down, const HoldGains *hold)
{
    double rate = clamp(hold->p * (depth - navigation->depth), hold->limit);
    double u = navigation->velocity[0], v = navigation->velocity[1];
    double heave = (rate - down[0] * u - down[1] * v) / larger(down[2], LEAST_UPRIGHT);
    return clamp(heave, hold->limit / LEAST_UPRIGHT);
}

static void velocity_targets(const Law *law, const Command *command, const Navigation *navigation, double *targets)
{
    const double *at = navigation->orientation;
    double w = at[0], x = at[1], y = at[2], z = at[3];
    double down[3] = {2.0 * (x * z - w * y), 2.0 * (y * z + w * x), 1.0 - 2.0 * (x * x + y * y)};
    double roll = atan2(down[1], down[2]), pitch = -asin(clamp(down[0], 1.0)), turn = command->yaw_rate;
    double roll_rate = clamp(-law->roll.p * roll, law->roll.limit);
    double pitch_rate = clamp(law->pitch.p * (0.0 - pitch), law->pitch.limit);
    if (command->has_heading) {
        double error = wrap(command->heading - heading_of(at));
        turn = clamp(turn + law->heading.p * error, law->heading.limit);
    }
    targets[0] = command->surge;
    targets[1] = command->sway;
    targets[2] = command->has_depth ? heave_for_depth(command->depth, navigation, down, &law->depth) : command->heave;
    targets[3] = roll_rate + turn * down[0];
    targets[4] = pitch_rate * cos(roll) + turn * down[1];
    targets[5] = -pitch_rate * sin(roll) + turn * down[2];
}

static void cascade(const Law *law, Loop *loops, const Command *command, const Navigation *navigation, double dt,
                    const double *residual, double *wrench)
{
    double targets[AXES];
    velocity_targets(law, command, navigation, targets);
    for (int i = 0; i < AXES; i++) {
        double measured = i < 3 ? navigation->velocity[i] : navigation->angular_velocity[i - 3];
        wrench[i] = law->inertia[i] * follow(&loops[i], &law->axes[i], targets[i], measured, dt, residual[i]);
    }
}

/* hil/autonomy/allocation.py: one thruster, as Allocator.numbers() lists it. */
typedef struct {
    double inverse[AXES], column[AXES], forward, reverse;
} Share;

static double thrust_for(const Share *share, const double *wrench)
{
    const double *row = share->inverse;
    return 0.0 + row[0] * wrench[0] + row[1] * wrench[1] + row[2] * wrench[2] + row[3] * wrench[3] + row[4] * wrench[4]
        + row[5] * wrench[5];
}

static void add_what_fits(const Share *shares, int count, double *thrusts, const double *wrench)
{
    double extra[MOST_THRUSTERS], share = 1.0;
    for (int i = 0; i < count; i++)
        extra[i] = thrust_for(&shares[i], wrench);
    for (int i = 0; i < count; i++) {
        if (thrusts[i] + share * extra[i] > shares[i].forward)
            share = (shares[i].forward - thrusts[i]) / extra[i];
        else if (thrusts[i] + share * extra[i] < shares[i].reverse)
            share = (shares[i].reverse - thrusts[i]) / extra[i];
    }
    for (int i = 0; i < count; i++)
        thrusts[i] = smaller(shares[i].forward, larger(shares[i].reverse, thrusts[i] + share * extra[i]));
}

static void allocate(const Share *shares, int count, const double *wrench, double *thrusts, double *lack)
{
    int beyond = 0;
    for (int i = 0; i < count; i++) {
        thrusts[i] = thrust_for(&shares[i], wrench);
        beyond |= thrusts[i] > shares[i].forward || thrusts[i] < shares[i].reverse;
    }
    if (beyond) {
        const double moments[AXES] = {0.0, 0.0, 0.0, wrench[3], wrench[4], wrench[5]};
        const double heave[AXES] = {0.0, 0.0, wrench[2], 0.0, 0.0, 0.0};
        const double horizontal[AXES] = {wrench[0], wrench[1], 0.0, 0.0, 0.0, 0.0};
        memset(thrusts, 0, (size_t)count * sizeof *thrusts);
        add_what_fits(shares, count, thrusts, moments);
        add_what_fits(shares, count, thrusts, heave);
        add_what_fits(shares, count, thrusts, horizontal);
    }
    for (int axis = 0; axis < AXES; axis++) {
        double had = 0.0;
        for (int i = 0; i < count; i++)
            had += shares[i].column[axis] * thrusts[i];
        lack[axis] = wrench[axis] - had;
    }
}

/* sim/thrusters.py: the curve of one thruster, as curve_numbers() lists it; the last three forward, then reverse. */
typedef struct {
    double neutral, share, squared, bend, ahead[3], astern[3];
} Curve;

static long pulse(const Curve *curve, double thrust)
{
    const double *side = thrust > 0.0 ? curve->ahead : curve->astern;
    double most = side[0], span = side[1], dead_band = side[2], y = thrust / most;
    if (y == 0.0)
        return (long)curve->neutral;
    if (!(y < 1.0))
        y = 1.0;
    double x = 2.0 * y / (curve->share + sqrt(curve->squared + curve->bend * y));
    return (long)rint(curve->neutral + (x * span + dead_band));
}
