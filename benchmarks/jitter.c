/* A long rest with jitter: the output at the same input must not move.  Built by endurance.py. */

#include "preisach_model.h"

#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>

int main(int count, char **words)
{
    static preisach_state state;
    static const double before[] = {-2.0, 8.0, 1.0, 3.01, 2.9, 3.0};
    long samples = count > 1 ? atol(words[1]) : 0, k;
    uint64_t random = 88172645463325252u;
    double first = 0.0, last, low = 1e300, high = -1e300;
    int corners = 0;
    preisach_init(&state);
    for (k = 0; k < 6; k++) first = (double)preisach_step(&state, (preisach_real)before[k]);
    for (k = 0; k < samples; k++) {
        double z;
        random ^= random << 13;
        random ^= random >> 7;
        random ^= random << 17;
        z = 0.02 * ((double)(random >> 11) / 9007199254740992.0 - 0.5);
        z = (double)preisach_step(&state, (preisach_real)(3.0 + z));
        if (z < low) low = z;
        if (z > high) high = z;
        if (state.count > corners) corners = state.count;
    }
    last = (double)preisach_step(&state, (preisach_real)3.0);
    printf("{\"moved\": %.17g, \"span\": %.17g, \"corners\": %d, \"most_corners\": %d}\n",
           last - first, high - low, corners, PREISACH_CORNERS);
    return 0;
}
