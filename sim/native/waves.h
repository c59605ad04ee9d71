/* The sums over wave components of sim/environment/waves.py in C, equal to the last bit.
 *
 * Sine, cosine and exponential are those of the C library, which Python uses, too: so C and Python agree on one machine,
 * however its library rounds. This file does not use the Python API.
 */

#include <math.h>
#include <string.h>

#include "check_doubles.h"

/* One wave component, as WaveField.numbers() lists it. */
typedef struct {
    double kn, ke, k, omega, phase, speed, echo, to_north, to_east, amplitude;
} Wave;

enum { MOTION = 20 }; /* numbers of WaterMotion */

typedef struct {
    long count;
    double depth;
    Wave *waves;
    double tangent[7]; /* WaveField._tangent */
    double held[MOTION]; /* WaveField.held */
} Waves;

/* As in sim/environment/waves.py: within this time (s) and squared distance (m2) the surface is extrapolated. */
#define NEAR_S 0.2
#define NEAR_M2 1.0
#define TILT 0.7745966692414834

static inline double wave_angle(const Wave *wave, double time, double north, double east)
{
    return wave->kn * north + wave->ke * east - wave->omega * time + wave->phase;
}

static double elevation(const Waves *waves, double time, double north, double east)
{
    double sum = 0.0;
    for (long i = 0; i < waves->count; i++)
        sum += waves->waves[i].amplitude * cos(wave_angle(&waves->waves[i], time, north, east));
    return sum;
}

/* WaveField.surface */
static double surface(const Waves *waves, double time, double north, double east)
{
    const double *at = waves->tangent;
    double later = time - at[0], away_north = north - at[1], away_east = east - at[2];
    if (!(fabs(later) <= NEAR_S && away_north * away_north + away_east * away_east <= NEAR_M2))
        return elevation(waves, time, north, east);
    return at[3] + at[4] * later + at[5] * away_north + at[6] * away_east;
}

static double pressure_depth(const Waves *waves, double time, double north, double east, double depth)
{
    double raised = elevation(waves, time, north, east), above = depth + raised, head = 0.0;
    double under = (above > 0.0 ? above : 0.0) * waves->depth / (waves->depth + raised);
    for (long i = 0; i < waves->count; i++) {
        const Wave *wave = &waves->waves[i];
        double decay = exp(-wave->k * under);
        double share = wave->echo != 0.0 ? (decay + wave->echo / decay) / (1.0 + wave->echo) : decay;
        head += wave->amplitude * share * cos(wave_angle(wave, time, north, east));
    }
    return depth + head;
}

static inline double sinc(double x)
{
    double s = x * x;
    if (s > 2.25)
        return sin(x) / x;
    return 1.0 - s / 6.0 * (1.0 - s / 20.0 * (1.0 - s / 42.0 * (1.0 - s / 72.0 * (1.0 - s / 110.0))));
}

/* Writes the MOTION numbers of WaterMotion in its order, as means over a hull whose `plan` is half its length and half its
 * width along north and east. */
static void water_motion(const Waves *waves, double time, double north, double east, double depth, const double *plan,
                         double *out)
{
    double v_north = 0.0, v_east = 0.0, v_down = 0.0, a_north = 0.0, a_east = 0.0, a_down = 0.0;
    double nn = 0.0, ne = 0.0, ee = 0.0, nd = 0.0, ed = 0.0;
    double nn_rate = 0.0, ne_rate = 0.0, ee_rate = 0.0, nd_rate = 0.0, ed_rate = 0.0;
    double height = 0.0, rate = 0.0, slope_north = 0.0, slope_east = 0.0;
    depth = 0.0 > depth ? 0.0 : depth;
    depth = waves->depth < depth ? waves->depth : depth;
    for (long i = 0; i < waves->count; i++) {
        const Wave *wave = &waves->waves[i];
        double kn = wave->kn, ke = wave->ke, omega = wave->omega, theta = wave_angle(wave, time, north, east);
        double decay = exp(-wave->k * depth), rise = wave->echo != 0.0 ? wave->echo / decay : 0.0;
        double x = kn * plan[0] + ke * plan[1], y = kn * plan[2] + ke * plan[3];
        double mean = sinc(x) * sinc(y), tilt = sinc(TILT * x) * sinc(TILT * y);
        double level = wave->speed * (decay + rise), steep = wave->speed * (decay - rise);
        double cosine = cos(theta), sine = sin(theta), along = mean * level * cosine, falling = wave->amplitude * sine;
        height += wave->amplitude * mean * cosine;
        rate += omega * mean * falling;
        slope_north -= kn * tilt * falling;
        slope_east -= ke * tilt * falling;
        v_north += along * wave->to_north;
        v_east += along * wave->to_east;
        v_down -= mean * steep * sine;
        along = omega * mean * level * sine;
        a_north += along * wave->to_north;
        a_east += along * wave->to_east;
        a_down += omega * mean * steep * cosine;
        level *= tilt;
        steep *= tilt;
        along = level * sine, falling = steep * cosine;
        nn -= along * kn * wave->to_north;
        ne -= along * kn * wave->to_east;
        ee -= along * ke * wave->to_east;
        nd -= falling * kn;
        ed -= falling * ke;
        along = omega * level * cosine, falling = omega * steep * sine;
        nn_rate += along * kn * wave->to_north;
        ne_rate += along * kn * wave->to_east;
        ee_rate += along * ke * wave->to_east;
        nd_rate -= falling * kn;
        ed_rate -= falling * ke;
    }
    a_north += v_north * nn + v_east * ne + v_down * nd;
    a_east += v_north * ne + v_east * ee + v_down * ed;
    a_down += v_north * nd + v_east * ed - v_down * (nn + ee);
    double all[MOTION] = {v_north, v_east, v_down, a_north, a_east, a_down, height, rate, slope_north, slope_east,
                          nn, ne, ee, nd, ed, nn_rate, ne_rate, ee_rate, nd_rate, ed_rate};
    memcpy(out, all, sizeof all);
}
