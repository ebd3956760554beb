/* Repeat a step of the rig, which `plant.py` writes down; the command u[j] is held during step j. The
   state is copied to out before every `keep` steps. */

#include <string.h>

#include "equations.h"

void run(const Function *step, int64_t states, int64_t steps, int64_t keep, double *x,
         const double *u, const double *p, double *out)
{
    const size_t size = (size_t)states * sizeof(double);
    double after[states];
    step->res[0] = after;
    for (int64_t j = 0; j < steps; j++) {
        if (j % keep == 0)
            memcpy(out + j / keep * states, x, size);
        evaluate_at(step, x, u + j, p);
        memcpy(x, after, size);
    }
}
