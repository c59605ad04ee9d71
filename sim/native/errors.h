/* The errors of sim/sensors/error.py and the mixing of sim/thrusters.py once more, to the last bit.
 *
 * Random numbers are those of Python's random.Random: the Mersenne Twister MT19937 (Matsumoto and Nishimura
 * 1998) with 53 bits a number, and its gauss(). Logarithm, sine and cosine are those of the C library, which
 * Python uses too. Nothing of Python is in this file.
 */

#include <math.h>
#include <stdint.h>

/* One quantity: what ErrorProcess keeps, in the order of its numbers(). */
typedef struct {
    double gain, constant, bias, keep, kick, noise, resolution, limit;
} Channel;

enum { TWISTER_SIZE = 624, TWISTER_SHIFT = 397 };

/* random.Random: its key and place in it, and the second normal number of a pair where there is one. */
typedef struct {
    uint32_t key[TWISTER_SIZE];
    int place, has_second;
    double second;
} Random;

static void twist(Random *random)
{
    uint32_t *key = random->key;
    for (int i = 0; i < TWISTER_SIZE; i++) {
        uint32_t y = (key[i] & 0x80000000u) | (key[(i + 1) % TWISTER_SIZE] & 0x7fffffffu);
        key[i] = key[(i + TWISTER_SHIFT) % TWISTER_SIZE] ^ (y >> 1) ^ (y & 1u ? 0x9908b0dfu : 0u);
    }
    random->place = 0;
}

static uint32_t bits(Random *random)
{
    if (random->place >= TWISTER_SIZE)
        twist(random);
    uint32_t y = random->key[random->place++];
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

/* One measurement of `value`; the bias moves on. */
static double measure(Channel *channel, Random *random, double value)
{
    channel->bias = channel->keep * channel->bias + draw(random, channel->kick);
    value = channel->gain * value + channel->constant + channel->bias + draw(random, channel->noise);
    if (channel->resolution != 0.0)
        value = (rint(value / channel->resolution) + 0.0) * channel->resolution; /* + 0.0: Python's round has no -0 */
    if (channel->limit != 0.0) {
        double raised = value > -channel->limit ? value : -channel->limit;
        value = raised < channel->limit ? raised : channel->limit;
    }
    return value;
}

/* One thruster: its gain of a step, and the wrench of 1 N of it. */
typedef struct {
    double gain, column[6];
} Thruster;

/* Moves the thrusts towards their targets by one step, and adds up their wrench. */
static void follow(const Thruster *thrusters, int count, double *thrusts, const double *targets, double *wrench)
{
    for (int axis = 0; axis < 6; axis++)
        wrench[axis] = 0.0;
    for (int i = 0; i < count; i++) {
        thrusts[i] = thrusts[i] + thrusters[i].gain * (targets[i] - thrusts[i]);
        for (int axis = 0; axis < 6; axis++)
            wrench[axis] += thrusters[i].column[axis] * thrusts[i];
    }
}
