/* The errors of sim/sensors/error.py and the thrusts of sim/vehicle/thrusters/bank.py and ventilation.py in C, equal to
 * the last bit.
 *
 * Random numbers are those of Python's random.Random: the Mersenne Twister MT19937 (Matsumoto and Nishimura
 * 1998) with 53 bits a number, and its gauss(). Logarithm, sine and cosine are those of the C library, which
 * Python uses, too. This file does not use the Python API.
 */

#include <math.h>
#include <stdint.h>

/* One quantity: the state of an ErrorProcess, in the order of its numbers(). */
enum { BIASES = 4 };

typedef struct {
    double gain, constant, biases[BIASES], decays[BIASES], bias_noises[BIASES], warm_up, cooling;
    double noise, noise_share, outliers, outlier, resolution, limit;
} Channel;

enum { TWISTER_SIZE = 624, TWISTER_SHIFT = 397 };

/* The state of random.Random: its key, the index in it, and the second normal number of a pair if there is one. */
typedef struct {
    uint32_t key[TWISTER_SIZE];
    int index, has_second;
    double second;
} Random;

static void twist(Random *random)
{
    uint32_t *key = random->key;
    for (int i = 0; i < TWISTER_SIZE; i++) {
        uint32_t y = (key[i] & 0x80000000u) | (key[(i + 1) % TWISTER_SIZE] & 0x7fffffffu);
        key[i] = key[(i + TWISTER_SHIFT) % TWISTER_SIZE] ^ (y >> 1) ^ (y & 1u ? 0x9908b0dfu : 0u);
    }
    random->index = 0;
}

static uint32_t bits(Random *random)
{
    if (random->index >= TWISTER_SIZE)
        twist(random);
    uint32_t y = random->key[random->index++];
    y ^= y >> 11;
    y ^= (y << 7) & 0x9d2c5680u;
    y ^= (y << 15) & 0xefc60000u;
    return y ^ (y >> 18);
}

/* Uniform from 0 to 1, 1 excluded. */
static double uniform(Random *random)
{
    uint32_t high = bits(random) >> 5, low = bits(random) >> 6;
    return (high * 67108864.0 + low) * (1.0 / 9007199254740992.0);
}

/* Normal with mean 0, as random.gauss(0.0, sd). */
static double gauss(Random *random, double sd)
{
    double z = random->second;
    if (!random->has_second) {
        double angle = uniform(random) * 6.283185307179586;
        double radius = sqrt(-2.0 * log(1.0 - uniform(random)));
        z = cos(angle) * radius;
        random->second = sin(angle) * radius;
    }
    random->has_second = !random->has_second;
    return 0.0 + z * sd;
}

static double draw(Random *random, double sd)
{
    return sd != 0.0 ? gauss(random, sd) : 0.0;
}

/* Returns one measurement of `value`; advances the biases. */
static double measure(Channel *channel, Random *random, double value)
{
    double noise = channel->noise, of_value = channel->noise_share * value;
    value = channel->gain * value + channel->constant;
    for (int i = 0; i < BIASES; i++) {
        channel->biases[i] = channel->decays[i] * channel->biases[i] + draw(random, channel->bias_noises[i]);
        value += channel->biases[i];
    }
    channel->warm_up *= channel->cooling;
    value += channel->warm_up + draw(random, sqrt(noise * noise + of_value * of_value));
    if (channel->outliers != 0.0 && uniform(random) < channel->outliers)
        value += draw(random, channel->outlier);
    if (channel->resolution != 0.0)
        value = (rint(value / channel->resolution) + 0.0) * channel->resolution; /* + 0.0: Python's round has no -0 */
    if (channel->limit != 0.0) {
        double raised = value > -channel->limit ? value : -channel->limit;
        value = raised < channel->limit ? raised : channel->limit;
    }
    return value;
}

/* One thruster, as ThrusterSet.numbers() lists it: the gain of its lag in a step, its wrench of 1 N, the column
 * that converts a velocity to the speed along it, and its loss of thrust with that speed (Advance of
 * sim/vehicle/thrusters/curves.py; full_speed 0: no loss). */
typedef struct {
    double gain, wrench_column[6], speed_column[6], full_speed, full_forward, full_reverse, loss, inflow_share;
} Thruster;

/* The loss (N) of a thruster that makes `thrust` N at rest, at `nu` through the water. */
static double lost_thrust(const Thruster *thruster, double thrust, const double *nu)
{
    const double *c = thruster->speed_column;
    double speed = c[0] * nu[0] + c[1] * nu[1] + c[2] * nu[2] + c[3] * nu[3] + c[4] * nu[4] + c[5] * nu[5];
    double full = thrust < 0.0 ? thruster->full_reverse : thruster->full_forward;
    return thruster->loss * (thruster->full_speed * sqrt(fabs(thrust) / full)) * thruster->inflow_share * speed;
}

/* thrust_share of sim/vehicle/ventilation.py: the remaining share of a thrust at an immersion of h / R. */
static double thrust_share(double immersion)
{
    double under = 1.0 - 0.769 * immersion, left;
    if (immersion >= 1.3)
        return 1.0;
    if (immersion <= -0.48)
        return 0.0;
    left = 1.0 - 0.675 * pow(under > 0.0 ? under : 0.0, 1.258);
    left = left > 0.0 ? left : 0.0;
    return left < 1.0 ? left : 1.0;
}

/* Moves the thrusts towards their targets by one step; writes the thrusts that act at `nu` through the water, and their
 * wrench. */
static void step_thrusters(const Thruster *thrusters, int count, double *thrusts, const double *targets, const double *shares,
                   const double *nu, double *scaled_thrusts, double *wrench)
{
    for (int axis = 0; axis < 6; axis++)
        wrench[axis] = 0.0;
    for (int i = 0; i < count; i++) {
        thrusts[i] = thrusts[i] + thrusters[i].gain * (targets[i] - thrusts[i]);
        scaled_thrusts[i] = thrusts[i];
        if (thrusters[i].full_speed != 0.0)
            scaled_thrusts[i] = scaled_thrusts[i] - lost_thrust(&thrusters[i], thrusts[i], nu);
        scaled_thrusts[i] = scaled_thrusts[i] * shares[i];
        for (int axis = 0; axis < 6; axis++)
            wrench[axis] += thrusters[i].wrench_column[axis] * scaled_thrusts[i];
    }
}
