/* The parameters of a vehicle in its water, the buoyancy of its hull and the 6x6 product, for kernel.h and forces.h. */

#ifndef UUV_HIL_BODY_H
#define UUV_HIL_BODY_H

#include "check_doubles.h"

/* The parameters of a vehicle in its water, as Dynamics.numbers() lists them. All are doubles, so there is no padding. */
typedef struct {
    double mass[6][6], inverse_mass[6][6], linear[6][6], quadratic[6][6];
    double weight, weight_moment[3];
    double points[8][3], share, filling, submerged[4], reach; /* Hull.numbers() of sim/vehicle/buoyancy.py */
    double added_mass_linear[3][3], munk_reduction[3];
    double diagonal, rk4, reduces_munk; /* 1 or 0 */
} Body;

/* sim/vehicle/buoyancy.py */

static void hull_buoyancy(const Body *body, double depth, const double *rotation, double *out)
{
    double zx = rotation[6], zy = rotation[7], zz = rotation[8];
    double lift = 0.0, lift_x = 0.0, lift_y = 0.0, lift_z = 0.0;
    if (depth >= body->reach) {
        for (int i = 0; i < 4; i++)
            out[i] = body->submerged[i];
        return;
    }
    for (int i = 0; i < 8; i++) {
        double x = body->points[i][0], y = body->points[i][1], z = body->points[i][2];
        double filled = 0.5 + body->filling * (depth + zx * x + zy * y + zz * z), part;
        if (filled <= 0.0)
            continue;
        part = filled >= 1.0 ? body->share : body->share * filled;
        lift += part;
        lift_x += part * x;
        lift_y += part * y;
        lift_z += part * z;
    }
    out[0] = lift, out[1] = lift_x, out[2] = lift_y, out[3] = lift_z;
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
