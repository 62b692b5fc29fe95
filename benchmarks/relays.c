/* The paper's recursion and the model's output, with relays, as one would write them in C.

   Rows of the plane lie one behind another, the lanes of a cell side by side.  A sample that passes
   no threshold costs a comparison; one that does touches only the relays that it switches.  The
   input moves before the first threshold at the start, and never rests on one.  */

#include <stdlib.h>
#include <string.h>

typedef struct {
    int levels, level;
    int *lowest, *highest;
} Memory;

static int level_of(double x, double low, double per_unit, int levels) {
    double position = (x - low) * per_unit + 0.5;
    int level = (int)position;
    return level < 0 ? 0 : level > levels ? levels : level;
}

/* From saturated low. */
static Memory begun_at(int levels, int level) {
    Memory m = {levels, level, calloc(levels, sizeof(int)), calloc(levels, sizeof(int))};
    for (int i = 0; i < level; i++) m.lowest[i] = level;
    for (int i = 0; i < levels; i++) m.highest[i] = level;
    return m;
}

/* After the crossings of one sample were dealt with. */
static void settle(Memory *m, int to) {
    for (int i = m->level; i < to; i++) m->lowest[i] = to;
    for (int j = to; j < m->level; j++) m->highest[j] = to;
    for (int i = 0; i < m->levels; i++) {
        if (m->lowest[i] > to) m->lowest[i] = to;
        if (m->highest[i] < to) m->highest[i] = to;
    }
    m->level = to;
}

static long cell(long i, long j) { return i * (i + 1) / 2 + j; }

static double output_at(const Memory *m, const double *weights) {
    double output = 0.0;
    for (long c = 0; c < cell(m->level, 0); c++) output += weights[c];
    return output;
}

/* For all relays that a move from m->level to `to` switches: c is the index of the cell. */
#define FOR_SWITCHED(BODY)                                                          \
    if (to > m.level)                                                               \
        for (int i = m.level; i < to; i++)                                          \
            for (int j = m.lowest[i]; j <= i; j++) { long c = cell(i, j); BODY }    \
    else                                                                            \
        for (int j = m.level - 1; j >= to; j--)                                     \
            for (int i = j; i < m.highest[j]; i++) { long c = cell(i, j); BODY }

/* Weights (cells, lanes) are adapted in place to the outputs z (samples, lanes) of one input. */
void adapt(int levels, long samples, int lanes, double low, double delta_x, const double *x,
           const double *z, double *weights) {
    Memory m = begun_at(levels, level_of(x[0], low, 1 / delta_x, levels));
    double *error = malloc(lanes * sizeof(double)), *reference = malloc(lanes * sizeof(double));
    memcpy(reference, z, lanes * sizeof(double));
    for (long k = 1; k < samples; k++) {
        int to = level_of(x[k], low, 1 / delta_x, levels);
        if (to == m.level) continue;
        double sign = to > m.level ? 1.0 : -1.0;
        long area = 0;
        memset(error, 0, lanes * sizeof(double));
        FOR_SWITCHED({
            const double *w = weights + c * lanes;
            for (int l = 0; l < lanes; l++) error[l] += w[l];
            area++;
        })
        if (area) {
            for (int l = 0; l < lanes; l++) {
                double increment = z[k * lanes + l] - reference[l];
                error[l] = sign * (increment - sign * error[l]) / area;
                reference[l] = z[k * lanes + l];
            }
            FOR_SWITCHED({
                double *w = weights + c * lanes;
                for (int l = 0; l < lanes; l++) w[l] += error[l];
            })
        }
        settle(&m, to);
    }
    free(error); free(reference); free(m.lowest); free(m.highest);
}

/* The filter as `AdaptiveFilter.run` is: one output of raw samples, weights adapted in place, and the
   model's output at every sample, before its update. */
void run(int levels, long samples, double low, double delta_x, const double *x, const double *z,
         double *weights, double *output) {
    Memory m = begun_at(levels, level_of(x[0], low, 1 / delta_x, levels));
    double now = output_at(&m, weights), reference = z[0];
    for (long k = 0; k < samples; k++) {
        int to = level_of(x[k], low, 1 / delta_x, levels);
        if (to == m.level) { output[k] = now; continue; }
        double sign = to > m.level ? 1.0 : -1.0, rise = 0.0;
        long area = 0;
        FOR_SWITCHED({ rise += weights[c]; area++; })
        now += sign * rise;
        output[k] = now;
        double error = z[k] - reference - sign * rise, move = sign * error / area;
        FOR_SWITCHED({ weights[c] += move; })
        if (to > m.level) now += error;
        reference = z[k];
        settle(&m, to);
    }
    free(m.lowest); free(m.highest);
}

/* Output (samples,) of the model with given weights. */
void simulate(int levels, long samples, double low, double delta_x, const double *x,
              const double *weights, double *output) {
    Memory m = begun_at(levels, level_of(x[0], low, 1 / delta_x, levels));
    double now = output_at(&m, weights);
    for (long k = 0; k < samples; k++) {
        int to = level_of(x[k], low, 1 / delta_x, levels);
        if (to != m.level) {
            double sign = to > m.level ? 1.0 : -1.0;
            FOR_SWITCHED({ now += sign * weights[c]; })
            settle(&m, to);
        }
        output[k] = now;
    }
    free(m.lowest); free(m.highest);
}
