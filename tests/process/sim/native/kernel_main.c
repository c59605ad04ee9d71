/* Drives the step of sim/native/kernel.h without Python: body, number of triangles and these, state, dt and count, then a
 * wrench and a current for each step from standard input; the 19 numbers after each step to standard output. All doubles. */
#include <stddef.h>
#include <stdio.h>

#include "kernel.h"

/* As a pointer, so that main does not contain it: gcc 12 would there fuse two operations despite -ffp-contract=off. */
static int (*volatile advance)(const Model *, double *, double *, const double *, const double *, double) = step;

int main(void)
{
    Model model = {0};
    static double triangles[1000][9];
    double at[SIZE], nu_dot[6] = {0}, timing[2], input[9], count;
    if (fread(&model.body, offsetof(Body, triangles), 1, stdin) != 1 || fread(&count, sizeof count, 1, stdin) != 1)
        return 1;
    model.body.triangles = (const double (*)[9])triangles;
    model.body.triangle_count = (long)count;
    if (count > 1000 || fread(triangles, sizeof *triangles, (size_t)count, stdin) != (size_t)count
        || fread(at, sizeof at, 1, stdin) != 1 || fread(timing, sizeof timing, 1, stdin) != 1)
        return 1;
    for (long i = 0; i < (long)timing[1]; i++) {
        if (fread(input, sizeof input, 1, stdin) != 1 || !advance(&model, at, nu_dot, input, input + 6, timing[0]))
            return 1;
        fwrite(at, sizeof at, 1, stdout);
        fwrite(nu_dot, sizeof nu_dot, 1, stdout);
    }
    return 0;
}
