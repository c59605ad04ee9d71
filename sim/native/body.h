/* The parameters of a vehicle in its water, the buoyancy of its hull and the 6x6 product, for kernel.h and forces.h. */

#ifndef UUV_HIL_BODY_H
#define UUV_HIL_BODY_H

#include "check_doubles.h"

/* The parameters of a vehicle in its water, as Dynamics.numbers() lists them. All are doubles, so there is no padding;
 * after them the triangles of Hull.triangles, nine numbers each. */
typedef struct {
    double mass[6][6], inverse_mass[6][6], linear[6][6], quadratic[6][6];
    double weight, weight_moment[3];
    double scale, submerged[4], reach; /* Hull.numbers() of sim/vehicle/buoyancy.py */
    double added_mass_linear[3][3], munk_reduction[3];
    double diagonal, reduces_munk; /* 1 or 0 */
    const double (*triangles)[9];
    long triangle_count;
} Body;

/* sim/vehicle/buoyancy.py */

static void crossing(const double *a, const double *b, double ha, double hb, double *out)
{
    double share = ha / (ha - hb);
    for (int i = 0; i < 3; i++)
        out[i] = a[i] + share * (b[i] - a[i]);
}

/* Adds six times the volume between `base` and a triangle to sums[0], and that times four times its centre. */
static void add_part(const double *base, const double *a, const double *b, const double *c, double *sums)
{
    double px = base[0], py = base[1], pz = base[2];
    double ux = b[0] - px, uy = b[1] - py, uz = b[2] - pz;
    double vx = c[0] - px, vy = c[1] - py, vz = c[2] - pz;
    double part = (a[0] - px) * (uy * vz - uz * vy) + (a[1] - py) * (uz * vx - ux * vz)
                  + (a[2] - pz) * (ux * vy - uy * vx);
    sums[0] += part;
    for (int i = 0; i < 3; i++)
        sums[1 + i] += part * (a[i] + b[i] + c[i] + base[i]);
}

/* _wet_parts, and what Hull.buoyancy does with them */
static void add_wet_parts(const double *base, const double *row, double ha, double hb, double hc, double *sums)
{
    const double *a = row, *b = row + 3, *c = row + 6, *corner;
    double ab[3], ac[3], height;
    if (ha <= 0.0 && hb <= 0.0 && hc <= 0.0)
        return;
    if (ha >= 0.0 && hb >= 0.0 && hc >= 0.0) {
        add_part(base, a, b, c, sums);
        return;
    }
    if ((hb > 0.0) != (ha > 0.0) && (hb > 0.0) != (hc > 0.0)) {
        corner = a, a = b, b = c, c = corner;
        height = ha, ha = hb, hb = hc, hc = height;
    } else if ((hc > 0.0) != (ha > 0.0) && (hc > 0.0) != (hb > 0.0)) {
        corner = c, c = b, b = a, a = corner;
        height = hc, hc = hb, hb = ha, ha = height;
    }
    crossing(a, b, ha, hb, ab);
    crossing(a, c, ha, hc, ac);
    if (ha > 0.0) {
        add_part(base, a, ab, ac, sums);
        return;
    }
    add_part(base, ab, b, c, sums);
    add_part(base, ab, c, ac, sums);
}

static void hull_buoyancy(const Body *body, double depth, const double *down, double *out)
{
    double nx = down[0], ny = down[1], nz = down[2], square = nx * nx + ny * ny + nz * nz, sums[4] = {0.0};
    if (depth > 0.0 && depth * depth >= body->reach * body->reach * square) {
        for (int i = 0; i < 4; i++)
            out[i] = body->submerged[i];
        return;
    }
    double lean = -depth / square, base[3] = {lean * nx, lean * ny, lean * nz}, heights[3];
    for (long i = 0; i < body->triangle_count; i++) {
        const double *row = body->triangles[i];
        for (int j = 0; j < 3; j++)
            heights[j] = depth + nx * row[3 * j] + ny * row[3 * j + 1] + nz * row[3 * j + 2];
        add_wet_parts(base, row, heights[0], heights[1], heights[2], sums);
    }
    double quarter = 0.25 * body->scale;
    out[0] = body->scale * sums[0];
    for (int i = 1; i < 4; i++)
        out[i] = quarter * sums[i];
}

/* sim/matrices.py */

static void times(const double matrix[6][6], const double *x, double *out)
{
    for (int i = 0; i < 6; i++) {
        const double *row = matrix[i];
        out[i] = row[0] * x[0] + row[1] * x[1] + row[2] * x[2] + row[3] * x[3] + row[4] * x[4] + row[5] * x[5];
    }
}

#endif
