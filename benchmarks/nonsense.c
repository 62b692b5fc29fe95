/* Odd inputs to every function of generated code, for endurance.py. */
#include "preisach_model.h"
#include <math.h>
#include <stdio.h>
static preisach_state s;
static preisach_state stage; /* it gets the same inputs, learns nothing, and is what is read */
static unsigned long random_state = 1;
static double uniform(void)
{
    random_state = (random_state * 1103515245ul + 12345ul) & 0x7ffffffful;
    return (double)random_state / 2147483648.0;
}
static double odd(void)
{
    double r = uniform();
    if (r < 0.03) return NAN;
    if (r < 0.06) return INFINITY;
    if (r < 0.09) return -1e300;
    if (r < 0.12) return 1e-310;
    if (r < 0.5) return -2.0 + 10.0 * uniform();
    return 3.0 + 0.01 * uniform();
}
/* What the stage reads, or no reading at all. */
static double reading(void)
{
    double z = odd();
    return fabs(z) < 100.0 ? (double)stage.output : z;
}
int main(void)
{
    long k;
    preisach_init(&s);
    preisach_init(&stage);
    for (k = 0; k < SAMPLES; k++) {
        double r = uniform();
        preisach_real u = (preisach_real)(r < 0.75 ? odd() : r < 0.8 ? NAN : odd());
        preisach_real out;
        if (r < 0.8) {
            (void)preisach_step(&stage, u);
            out = preisach_step(&s, u);
        } else if (r < 0.95) {
            out = preisach_inverse_step(&s, u);
            (void)preisach_step(&stage, out);
        } else {
            (void)preisach_step(&stage, u);
            out = preisach_adapt_step(&s, u, (preisach_real)reading());
        }
        if (!(fabs((double)out) < 1e4) || s.count > PREISACH_CORNERS || s.refused == 0) {
            printf("%ld %g %d\n", k, (double)out, s.count);
            if (k > 100) return 1;
        }
    }
    return 0;
}
