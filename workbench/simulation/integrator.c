/* The integrator: Dormand and Prince's explicit Runge-Kutta pair 5(4) with adaptive steps, restarted
 * at every sample, so that no step crosses a jump of the inputs. `integrators.py` does the same in
 * Python, in the same order of operations.
 *
 * Source: Hairer, Norsett, Wanner, Solving Ordinary Differential Equations I, 1993, table II.5.2 and
 * section II.4 (choice of the step). */

#include <math.h>
#include <stddef.h>

#include "equations.h"

typedef struct {
    Function rates;
    int64_t states, inputs, most_steps;
    const double *scale; /* of each state */
    double sample_time, tolerance;
    double step;  /* in s, what the last step suggests for the next */
    double *work; /* 9 * states */
    int64_t *steps, *evaluations; /* counted */
} Integrator;

static const double A[6][6] = {
    {1.0 / 5.0},
    {3.0 / 40.0, 9.0 / 40.0},
    {44.0 / 45.0, -56.0 / 15.0, 32.0 / 9.0},
    {19372.0 / 6561.0, -25360.0 / 2187.0, 64448.0 / 6561.0, -212.0 / 729.0},
    {9017.0 / 3168.0, -355.0 / 33.0, 46732.0 / 5247.0, 49.0 / 176.0, -5103.0 / 18656.0},
    {35.0 / 384.0, 0.0, 500.0 / 1113.0, 125.0 / 192.0, -2187.0 / 6784.0, 11.0 / 84.0},
};
static const double E[7] = {71.0 / 57600.0,     0.0,          -71.0 / 16695.0, 71.0 / 1920.0,
                            -17253.0 / 339200.0, 22.0 / 525.0, -1.0 / 40.0};

/* Advance the states by one sample in place. Returns 0, or 1 if it gives up. */
static int sample(Integrator *g, double *x, const double *u, const double *p)
{
    const int64_t n = g->states;
    double *k[7], *end = g->work + 7 * n, *now = g->work + 8 * n;
    double done = 0.0, h = g->step;
    for (int s = 0; s < 7; s++)
        k[s] = g->work + s * n;
    for (int64_t i = 0; i < n; i++)
        now[i] = x[i];
    g->rates.res[0] = k[0];
    *g->evaluations += 1;
    if (evaluate_at(&g->rates, now, u, p))
        return 1;
    for (int64_t steps = 0; steps < g->most_steps; steps++) {
        const double left = g->sample_time - done;
        const int last = h >= left;
        const double taken = last ? left : h;
        *g->steps += 1;
        *g->evaluations += 6;
        for (int s = 0; s < 6; s++) {
            for (int64_t i = 0; i < n; i++) {
                double sum = 0.0;
                for (int j = 0; j <= s; j++)
                    sum += A[s][j] * k[j][i];
                end[i] = now[i] + taken * sum;
            }
            g->rates.res[0] = k[s + 1];
            if (evaluate_at(&g->rates, end, u, p))
                return 1;
        }
        double error = 0.0;
        for (int64_t i = 0; i < n; i++) {
            double sum = 0.0;
            for (int s = 0; s < 7; s++)
                sum += E[s] * k[s][i];
            const double size = g->scale[i] + fmax(fabs(now[i]), fabs(end[i]));
            const double part = fabs(taken * sum) / (g->tolerance * size);
            /* A part that is not a number counts as too large. */
            error = part <= 1e30 ? fmax(error, part) : 1e30;
            if (error >= 1e30)
                break;
        }
        const double factor = fmin(5.0, fmax(0.2, 0.9 * pow(fmax(error, 1e-10), -0.2)));
        if (error <= 1.0) {
            done += taken;
            for (int64_t i = 0; i < n; i++) {
                now[i] = end[i];
                k[0][i] = k[6][i];
            }
            /* A step that the end of the sample cut short says little about a long one. */
            h = last ? fmax(h, taken * factor) : taken * factor;
            if (last) {
                h = fmin(h, g->sample_time);
                for (int64_t i = 0; i < n; i++)
                    x[i] = now[i];
                g->step = h;
                return 0;
            }
        } else {
            h = taken * factor;
        }
    }
    return 1;
}

/* Write the states after each of several samples; returns how many there are before it gives up. */
int64_t integrate(Integrator *g, int64_t samples, const double *start, const double *u,
                  const double *p, double *states)
{
    const double *x = start;
    for (int64_t t = 0; t < samples; t++) {
        double *next = states + t * g->states;
        for (int64_t i = 0; i < g->states; i++)
            next[i] = x[i];
        if (sample(g, next, u + t * g->inputs, p))
            return t;
        x = next;
    }
    return samples;
}

/* Advance by one sample in place and read the sensors there. Returns 0, or 1 if it gives up. */
int64_t hold(Integrator *g, Function *outputs, double *x, const double *u, const double *p, double *y)
{
    outputs->res[0] = y;
    return sample(g, x, u, p) || evaluate_at(outputs, x, u, p);
}

/* Evaluate a function at every row of states and inputs. Returns 0, or 1 if it fails. */
int64_t evaluate(Function *f, int64_t rows, int64_t states, int64_t inputs, int64_t results,
                 const double *x, const double *u, const double *p, double *table)
{
    for (int64_t t = 0; t < rows; t++) {
        f->res[0] = table + t * results;
        if (evaluate_at(f, x + t * states, u + t * inputs, p))
            return 1;
    }
    return 0;
}
