/* The sums over wave components of sim/environment/waves.py in C, equal to the last bit.
 *
 * Sine, cosine and exponential are those of the C library, which Python uses, too: so C and Python agree on one machine,
 * however its library rounds. This file does not use the Python API.
 */

#include <math.h>

#include "check_doubles.h"

/* One wave component, as WaveField.numbers() lists it. */
typedef struct {
    double kn, ke, k, omega, phase, speed, echo, to_north, to_east, amplitude;
} Wave;

typedef struct {
    long count;
    double depth;
    Wave *waves;
    double tangent[7]; /* WaveField._tangent */
} Waves;

/* As in sim/environment/waves.py: within this time (s) and squared distance (m2) the surface is extrapolated. */
#define NEAR_S 0.2
#define NEAR_M2 1.0

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

/* Writes 10 numbers: velocity and acceleration of the water (each north, east, down), then WaterMotion.surface. */
static void water_motion(const Waves *waves, double time, double north, double east, double depth, double *out)
{
    double v_north = 0.0, v_east = 0.0, v_down = 0.0, a_north = 0.0, a_east = 0.0, a_down = 0.0;
    double nn = 0.0, ne = 0.0, ee = 0.0, nd = 0.0, ed = 0.0;
    double height = 0.0, rate = 0.0, slope_north = 0.0, slope_east = 0.0;
    depth = 0.0 > depth ? 0.0 : depth;
    depth = waves->depth < depth ? waves->depth : depth;
    for (long i = 0; i < waves->count; i++) {
        const Wave *wave = &waves->waves[i];
        double theta = wave_angle(wave, time, north, east);
        double decay = exp(-wave->k * depth);
        double rise = wave->echo != 0.0 ? wave->echo / decay : 0.0;
        double level = wave->speed * (decay + rise), steep = wave->speed * (decay - rise);
        double cosine = cos(theta), sine = sin(theta), along = level * cosine, falling = wave->amplitude * sine;
        height += wave->amplitude * cosine;
        rate += wave->omega * falling;
        slope_north -= wave->kn * falling;
        slope_east -= wave->ke * falling;
        v_north += along * wave->to_north;
        v_east += along * wave->to_east;
        v_down -= steep * sine;
        level *= sine;
        steep *= cosine;
        a_north += wave->omega * level * wave->to_north;
        a_east += wave->omega * level * wave->to_east;
        a_down += wave->omega * steep;
        nn -= level * wave->kn * wave->to_north;
        ne -= level * wave->kn * wave->to_east;
        ee -= level * wave->ke * wave->to_east;
        nd -= steep * wave->kn;
        ed -= steep * wave->ke;
    }
    a_north += v_north * nn + v_east * ne + v_down * nd;
    a_east += v_north * ne + v_east * ee + v_down * ed;
    a_down += v_north * nd + v_east * ed - v_down * (nn + ee);
    out[0] = v_north, out[1] = v_east, out[2] = v_down;
    out[3] = a_north, out[4] = a_east, out[5] = a_down;
    out[6] = height, out[7] = rate, out[8] = slope_north, out[9] = slope_east;
}
