/* What benchmarks/controller.py calls on the emulated controller: one sample of each function. */
#include "preisach_model.h"

preisach_state state;
preisach_real given, measured, found;

void start(void) { preisach_init(&state); }
void step(void) { found = preisach_step(&state, given); }
void inverse(void) { found = preisach_inverse_step(&state, given); }
void adapt(void) { found = preisach_adapt_step(&state, given, measured); }
