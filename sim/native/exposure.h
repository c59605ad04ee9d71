/* Convert light to bytes as a camera's sensor does: sim/sensors/imaging/camera/image_sensor.py in C, equal to 1 of 256
 * levels.
 *
 * That file is the specification and explains the method. This file does not use the Python API.
 */

#include <math.h>
#include <stddef.h>
#include <stdint.h>

enum { QUANTILE_BITS = 12, QUANTILES = 1 << QUANTILE_BITS, GREYS = 8192, BLOCK = 64 };

/* The parameters and buffers of a picture; `quantiles` are those of noise, `grey` the byte of each level of light. */
typedef struct {
    uint64_t key;
    float gain, full_well, dark, depth_noise, reach;
    const float *radiance, *falloff, *axial, *quantiles;
    const double *ranges;
    const unsigned char *grey;
    unsigned char *pixels;
    float *depths;
} Exposure;

/* The finaliser of splitmix64 (Steele, Lea & Flood 2014) of a pixel's number. */
static uint64_t random_bits(uint64_t key, uint64_t number)
{
    uint64_t bits = key + number * UINT64_C(0x9E3779B97F4A7C15);
    bits = (bits ^ (bits >> 30)) * UINT64_C(0xBF58476D1CE4E5B9);
    bits = (bits ^ (bits >> 27)) * UINT64_C(0x94D049BB133111EB);
    return bits ^ (bits >> 31);
}

static float noise(const Exposure *e, uint64_t bits, int which)
{
    return e->quantiles[(bits >> (QUANTILE_BITS * which)) & (QUANTILES - 1)];
}

static void develop_block(const Exposure *e, size_t first, size_t count)
{
    float signal[3 * BLOCK];
    const float *radiance = e->radiance + 3 * first;
    float share = 1.0f / e->full_well;
    uint64_t bits[BLOCK];
    for (size_t i = 0; i < count; i++)
        bits[i] = random_bits(e->key, first + i);
    for (size_t i = 0; i < count; i++)
        for (int c = 0; c < 3; c++)
            signal[3 * i + c] = radiance[3 * i + c] * e->falloff[first + i] * e->gain;
    for (size_t i = 0; i < count; i++)
        for (int c = 0; c < 3; c++) {
            float light = signal[3 * i + c];
            light += sqrtf(light * share + e->dark) * noise(e, bits[i], c);
            light = light > 0.0f ? light < 1.0f ? light : 1.0f : 0.0f;
            e->pixels[3 * (first + i) + c] = e->grey[(int)(light * (float)(GREYS - 1))];
        }
    for (size_t i = 0; i < count; i++) {
        float depth = (float)(e->ranges[first + i] * (double)e->axial[first + i]);
        float error = noise(e, bits[i], 3) * e->depth_noise * (depth < e->reach ? depth : e->reach);
        float measured = e->depth_noise > 0.0f ? depth * (1.0f + error) : depth;
        e->depths[first + i] = measured > 0.0f ? measured : 0.0f;
    }
}

static void develop_all(const Exposure *e, size_t count)
{
    for (size_t first = 0; first < count; first += BLOCK)
        develop_block(e, first, count - first < BLOCK ? count - first : BLOCK);
}
