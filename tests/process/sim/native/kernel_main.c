/* Drives the step of sim/native/kernel.h without Python: body, state, dt and count, then a wrench and a
 * current for each step from standard input; the 19 numbers after each step to standard output. All doubles. */
#include <stdio.h>

#include "kernel.h"

int main(void)
{
    Model model = {0};
    double at[SIZE], nu_dot[6] = {0}, timing[2], input[9];
    if (fread(&model.body, sizeof model.body, 1, stdin) != 1 || fread(at, sizeof at, 1, stdin) != 1
        || fread(timing, sizeof timing, 1, stdin) != 1)
        return 1;
    for (long i = 0; i < (long)timing[1]; i++) {
        if (fread(input, sizeof input, 1, stdin) != 1 || !step(&model, at, nu_dot, input, input + 6, timing[0]))
            return 1;
        fwrite(at, sizeof at, 1, stdout);
        fwrite(nu_dot, sizeof nu_dot, 1, stdout);
    }
    return 0;
}
