/* Time of the generated functions, beside the kernel of relays.c, in ns a sample: the least of some
   runs on one thread's own clock.  Built by export.py. */

#define _POSIX_C_SOURCE 199309L

#include "preisach_model.h"

#include <stdio.h>
#include <stdlib.h>
#include <time.h>

void simulate(int levels, long samples, double low, double delta_x, const double *x,
              const double *weights, double *output);

static double now(void)
{
    struct timespec t;
    clock_gettime(CLOCK_THREAD_CPUTIME_ID, &t);
    return 1e9 * (double)t.tv_sec + (double)t.tv_nsec;
}

int main(int count, char **words)
{
    static preisach_state state;
    static double weights[PREISACH_CELLS];
    long samples = count > 4 ? atol(words[1]) : 0, few = samples / 20, k;
    double least[4] = {1e30, 1e30, 1e30, 1e30};
    double *u = malloc(8 * (size_t)samples), *z = malloc(8 * (size_t)samples);
    FILE *file = count > 4 ? fopen(words[4], "rb") : NULL;
    int run, i;
    if (!file || !u || !z || fread(u, 8, (size_t)samples, file) != (size_t)samples) return 1;
    preisach_init(&state);
    for (i = 0; i < PREISACH_CELLS; i++) weights[i] = state.weights[i];
    for (run = 0; run < 15; run++) {
        double began = now(), took;
        simulate(PREISACH_LEVELS, samples, atof(words[2]), atof(words[3]), u, weights, z);
        took = (now() - began) / (double)samples;
        if (took < least[0]) least[0] = took;
        preisach_init(&state);
        began = now();
        for (k = 0; k < samples; k++) z[k] = preisach_step(&state, u[k]);
        took = (now() - began) / (double)samples;
        if (took < least[1]) least[1] = took;
    }
    for (run = 0; run < 3; run++) {
        double began, took;
        preisach_init(&state);
        began = now();
        for (k = 0; k < few; k++) preisach_inverse_step(&state, z[k]);
        took = (now() - began) / (double)few;
        if (took < least[2]) least[2] = took;
        preisach_init(&state);
        began = now();
        for (k = 0; k < few; k++) preisach_adapt_step(&state, u[k], z[k]);
        took = (now() - began) / (double)few;
        if (took < least[3]) least[3] = took;
    }
    printf("{\"relays_c\": %.2f, \"step\": %.2f, \"inverse_step\": %.1f, \"adapt_step\": %.1f}\n",
           least[0], least[1], least[2], least[3]);
    return 0;
}
