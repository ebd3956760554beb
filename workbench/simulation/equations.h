/* A function of a model's equations, as CasADi writes it in C. */

#ifndef EQUATIONS_H
#define EQUATIONS_H

#include <stdint.h>

typedef struct {
    int (*call)(const double **arg, double **res, long long int *iw, double *w, int mem);
    const double **arg;
    double **res;
    long long int *iw;
    double *w;
} Function;

/* Evaluate a function of states, inputs and parameters; its results go to where `res` points. */
static inline int evaluate_at(const Function *f, const double *x, const double *u, const double *p)
{
    f->arg[0] = x;
    f->arg[1] = u;
    f->arg[2] = p;
    return f->call(f->arg, f->res, f->iw, f->w, 0);
}

#endif
