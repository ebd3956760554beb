/* An extended Kalman filter with sensitivities along a recording. `filter.py` does the same in
 * Python and says what it is.
 *
 * Matrices stand by rows. States are in SI, their corrections, covariance and sensitivities over the
 * states' scales. */

#include <math.h>
#include <string.h>

#include "equations.h"

typedef struct {
    Function slope;  /* rates, and A = d rates / d x, B = d rates / d parameters (scaled) */
    Function rates;  /* rates, in SI */
    Function read;   /* measurements, and H = d / d x, D = d / d parameters (scaled) */
    Function noise;  /* covariance added in one sample (scaled) */
    int64_t states, inputs, measurements, corrected, free;
    int64_t calm, few; /* pieces of a sample tried first, and steps in each; none if these are 0 */
    int64_t again;     /* steps in a calm piece that bends along few; 0 if these are not tried */
    int64_t pieces;    /* of a sample of which a calm piece bends, with one linearisation each */
    int64_t straight, steps; /* in such a piece: as many as will do if nothing bends, and all */
    int64_t finer;     /* parts of such a step that bends */
    const int64_t *places; /* of the states that measurements correct */
    const double *scale;   /* of each state */
    double sample_time, outlier, faded, little, little_bent, much_bent, nothing;
    int64_t most_doublings;
    int64_t uneasy, rough, bent, kinks; /* calm pieces of all samples that bent along few steps, and
                                           along more; pieces that needed all steps; of these steps
                                           those that bent */
    double *work;
} Filter;

/* Columns j to j + WIDTH of ROWS rows of the product below, which stay in registers. */
#define PATCH(ROWS, WIDTH)                                                                         \
    for (; j + (WIDTH) <= end; j += (WIDTH)) {                                                     \
        double sum[ROWS][WIDTH];                                                                   \
        for (int s = 0; s < (ROWS); s++)                                                           \
            for (int q = 0; q < (WIDTH); q++)                                                      \
                sum[s][q] = add ? to[s * m + j + q] : 0.0;                                         \
        for (int64_t l = 0; l < k; l++) {                                                          \
            const double *other = b + l * m + j;                                                   \
            if (from[l] == 0.0 && from[((ROWS) - 1) * k + l] == 0.0)                               \
                continue;                                                                          \
            for (int s = 0; s < (ROWS); s++)                                                       \
                for (int q = 0; q < (WIDTH); q++)                                                  \
                    sum[s][q] += from[s * k + l] * other[q];                                       \
        }                                                                                          \
        for (int s = 0; s < (ROWS); s++)                                                           \
            for (int q = 0; q < (WIDTH); q++)                                                      \
                to[s * m + j + q] = sum[s][q];                                                     \
    }

#define BAND(ROWS)                                                                                 \
    for (; i + (ROWS) <= n; i += (ROWS)) {                                                         \
        const double *from = a + i * k;                                                            \
        double *to = c + i * m;                                                                    \
        const int64_t end = lower ? i + (ROWS) : m;                                                \
        int64_t j = 0;                                                                             \
        PATCH(ROWS, 16)                                                                            \
        PATCH(ROWS, 8)                                                                             \
        PATCH(ROWS, 4)                                                                             \
        PATCH(ROWS, 2)                                                                             \
        PATCH(ROWS, 1)                                                                             \
    }

/* c = a b, or c += a b, for a of shape (n, k) that may be sparse and b of shape (k, m); of a
 * symmetric c the lower half will do. */
static void product(double *restrict c, const double *restrict a, const double *restrict b, int64_t n,
                    int64_t k, int64_t m, int add, int lower)
{
    int64_t i = 0;
    BAND(2)
    BAND(1)
}

static double dot(const double *a, const double *b, int64_t n)
{
    double sum = 0.0;
    for (int64_t i = 0; i < n; i++)
        sum += a[i] * b[i];
    return sum;
}

/* Weights of Zonneveld's five slopes: what his method of third order adds to the classical one. */
static const double LESS[5] = {-2.0 / 3.0, 2.0, 2.0, 2.0, -16.0 / 3.0};

/* The four slopes of a classical Runge-Kutta step, of which the one with this number, if there is
 * one, comes with A and B. */
static int slopes(Filter *g, const double *x, double h, const double *u, const double *p, double **k,
                  double *at, int with)
{
    const double ahead[4] = {0.0, 0.5, 0.5, 1.0};
    for (int s = 0; s < 4; s++) {
        for (int64_t i = 0; i < g->states; i++)
            at[i] = s ? x[i] + ahead[s] * h * k[s - 1][i] : x[i];
        Function *of = s == with ? &g->slope : &g->rates;
        of->res[0] = k[s];
        if (evaluate_at(of, at, u, p))
            return 1;
    }
    return 0;
}

static void go(double *x, double h, double **k, int64_t n)
{
    for (int64_t i = 0; i < n; i++)
        x[i] += h / 6.0 * (k[0][i] + 2.0 * k[1][i] + 2.0 * k[2][i] + k[3][i]);
}

/* Whether a method of third order adds more than a little to a step with these slopes. */
static int bends(Filter *g, const double *x, double h, const double *u, const double *p, double **k,
                 double *at, double little)
{
    for (int64_t i = 0; i < g->states; i++)
        at[i] = x[i] + h / 32.0 * (5.0 * k[0][i] + 7.0 * k[1][i] + 13.0 * k[2][i] - k[3][i]);
    g->rates.res[0] = k[4];
    if (evaluate_at(&g->rates, at, u, p))
        return 1;
    for (int64_t i = 0; i < g->states; i++) {
        double away = 0.0;
        for (int s = 0; s < 5; s++)
            away += LESS[s] * k[s][i];
        const double gone =
            (fabs(k[0][i]) + 2.0 * fabs(k[1][i]) + 2.0 * fabs(k[2][i]) + fabs(k[3][i])) / 6.0;
        if (!(h * fabs(away) <= little * h * gone + g->nothing * g->scale[i]))
            return 1;
    }
    return 0;
}

/* Carry a state along a piece by a few Runge-Kutta steps, if these show no bend: A and B are those
 * in the middle then, which is the midpoint of a step or begins one, and `to` is where it ends. */
static int straight(Filter *g, int64_t pieces, int64_t steps, const double *x, const double *u,
                    const double *p, double **k, double *at, double *to)
{
    const double h = g->sample_time / (double)(pieces * steps);
    memcpy(to, x, (size_t)g->states * sizeof(double));
    for (int64_t step = 0; step < steps; step++) {
        if (slopes(g, to, h, u, p, k, at, step == steps / 2 ? (int)(steps % 2) : -1) ||
            bends(g, to, h, u, p, k, at, g->little_bent))
            return 0;
        go(to, h, k, g->states);
    }
    return 1;
}

/* Filter the samples of a recording; the results have a row for each. Returns how many were done
 * before the states left the finite numbers. */
int64_t filter(Filter *g, int64_t samples, double *x, double *P, double *G, const double *u,
               const double *y, const double *r, const double *p, const double *d, double *whitened,
               double *rows, double *logs, double *states)
{
    const int64_t nx = g->states, n = g->corrected, ny = g->measurements, nf = g->free;
    const double h = g->sample_time / (double)(g->pieces * g->steps);
    double *w = g->work;
    double *k[5], *at = w + 5 * nx, *to = at + nx;
    for (int i = 0; i < 5; i++)
        k[i] = w + i * nx;
    w = to + nx;
    double *predicted = w, *H = w + ny, *D = H + ny * n, *moved = D + ny * nf, *gain = moved + n;
    double *row = gain + n, *A = row + nf, *B = A + n * n, *Q = B + n * nf, *half = Q + n * n;
    double *step = half + n * n, *all = step + n * n, *before = all + n * n;
    double *driven = before + n * n;
    g->slope.res[1] = A;
    g->slope.res[2] = B;
    for (int64_t t = 0; t < samples; t++, u += g->inputs, y += ny, r += ny) {
        /* Correction, one measurement after the other. */
        g->read.res[0] = predicted;
        g->read.res[1] = H;
        g->read.res[2] = D;
        if (evaluate_at(&g->read, x, u, p))
            return t;
        memset(moved, 0, (size_t)n * sizeof(double));
        for (int64_t i = 0; i < ny; i++) {
            const double *by_state = H + i * n;
            double *to = rows + (t * ny + i) * nf;
            if (isnan(y[i])) {
                whitened[t * ny + i] = logs[t * ny + i] = NAN;
                memset(to, 0, (size_t)nf * sizeof(double));
                continue;
            }
            const double error = y[i] - predicted[i] - dot(by_state, moved, n);
            /* P is symmetric, and a sensor reads few states. */
            memset(gain, 0, (size_t)n * sizeof(double));
            for (int64_t l = 0; l < n; l++)
                if (by_state[l] != 0.0)
                    for (int64_t j = 0; j < n; j++)
                        gain[j] += by_state[l] * P[l * n + j];
            double variance = dot(by_state, gain, n) + r[i], pull = 1.0;
            if (error * error > g->outlier * g->outlier * variance) {
                variance = error * error / (g->outlier * g->outlier);
                pull = 1.0 / (g->outlier * g->outlier);
            }
            const double deviation = sqrt(variance);
            memcpy(row, D + i * nf, (size_t)nf * sizeof(double));
            for (int64_t l = 0; l < n; l++)
                if (by_state[l] != 0.0)
                    for (int64_t j = 0; j < nf; j++)
                        row[j] += by_state[l] * G[l * nf + j];
            whitened[t * ny + i] = error / deviation;
            logs[t * ny + i] = log(deviation);
            for (int64_t j = 0; j < nf; j++)
                to[j] = -pull * row[j] / deviation;
            for (int64_t l = 0; l < n; l++) {
                const double part = gain[l] / variance;
                moved[l] += part * error;
                for (int64_t j = 0; j < nf; j++)
                    G[l * nf + j] -= part * row[j];
                for (int64_t j = 0; j < n; j++)
                    P[l * n + j] -= part * gain[j];
            }
        }
        for (int64_t l = 0; l < n; l++)
            x[g->places[l]] += g->scale[g->places[l]] * moved[l];
        memcpy(states + t * nx, x, (size_t)nx * sizeof(double));
        g->noise.arg[3] = d;
        g->noise.res[0] = Q;
        if (evaluate_at(&g->noise, x, u, p))
            return t;
        /* Prediction: classical Runge-Kutta steps, the exponential of the slopes amid each piece. */
        const int64_t inner = g->pieces / g->calm;
        int64_t left = 0; /* pieces of a calm one that bends */
        for (int64_t done = 0; done < g->pieces;) {
            int64_t gone = inner;
            int easy = 0;
            if (left == 0 && g->few) {
                easy = straight(g, g->calm, g->few, x, u, p, k, at, to);
                g->uneasy += !easy;
                if (!easy && g->again)
                    easy = straight(g, g->calm, g->again, x, u, p, k, at, to);
                g->rough += !easy;
            }
            if (!easy) {
                gone = 1;
                left = (left ? left : inner) - 1;
                easy = g->straight < g->steps &&
                       straight(g, g->pieces, g->straight, x, u, p, k, at, to);
                g->bent += !easy;
            }
            if (easy)
                memcpy(x, to, (size_t)nx * sizeof(double));
            for (int64_t s = easy ? g->steps : 0; s < g->steps; s++) {
                if (slopes(g, x, h, u, p, k, at, s == g->steps / 2 ? (int)(g->steps % 2) : -1))
                    return t;
                const int kink = bends(g, x, h, u, p, k, at, g->much_bent);
                g->kinks += kink;
                if (!kink)
                    go(x, h, k, nx);
                for (int64_t part = kink ? 0 : g->finer; part < g->finer; part++) {
                    if (slopes(g, x, h / (double)g->finer, u, p, k, at, -1))
                        return t;
                    go(x, h / (double)g->finer, k, nx);
                }
            }
            /* Parts of the piece along which the slopes do little. */
            double most = 0.0, part = g->sample_time * (double)gone / (double)g->pieces;
            for (int64_t i = 0; i < n; i++) {
                double sum = 0.0;
                for (int64_t j = 0; j < n; j++)
                    sum += fabs(A[i * n + j]);
                most = sum > most ? sum : most;
            }
            int doublings = 0;
            for (; most * part > g->little && doublings < g->most_doublings; doublings++)
                part /= 2.0;
            /* half = I + a / 2 (I + a / 3), step = I + a half, with a = part A */
            for (int64_t i = 0; i < n * n; i++) {
                A[i] *= part;
                half[i] = A[i] / 3.0;
            }
            for (int64_t i = 0; i < n; i++)
                half[i * n + i] += 1.0;
            product(step, A, half, n, n, n, 0, 0);
            for (int64_t i = 0; i < n * n; i++)
                half[i] = 0.5 * step[i];
            for (int64_t i = 0; i < n; i++)
                half[i * n + i] += 1.0;
            product(step, A, half, n, n, n, 0, 0);
            for (int64_t i = 0; i < n; i++)
                step[i * n + i] += 1.0;
            /* What the parameters add, driven = half B, takes fewer products than half itself. */
            for (int64_t i = 0; i < n * nf; i++)
                B[i] *= part;
            product(driven, half, B, n, n, nf, 0, 0);
            /* Twice as far: driven = driven + step driven, step = step^2 */
            for (; doublings; doublings--) {
                memcpy(B, driven, (size_t)(n * nf) * sizeof(double));
                product(driven, step, B, n, n, nf, 1, 0);
                memcpy(before, step, (size_t)(n * n) * sizeof(double));
                product(step, before, before, n, n, n, 0, 0);
            }
            product(B, step, G, n, n, nf, 0, 0);
            for (int64_t i = 0; i < n * nf; i++)
                G[i] = B[i] + driven[i];
            if (done == 0) {
                memcpy(all, step, (size_t)(n * n) * sizeof(double));
            } else {
                memcpy(before, all, (size_t)(n * n) * sizeof(double));
                product(all, step, before, n, n, n, 0, 0);
            }
            done += gone;
        }
        product(before, all, P, n, n, n, 0, 0);
        for (int64_t i = 0; i < n; i++)
            for (int64_t j = 0; j < n; j++)
                half[j * n + i] = all[i * n + j];
        product(P, before, half, n, n, n, 0, 1);
        for (int64_t i = 0; i < n; i++)
            for (int64_t j = 0; j <= i; j++) {
                double value = P[i * n + j];
                if (!(fabs(value) > g->faded))
                    value = value == value ? 0.0 : value;
                P[i * n + j] = P[j * n + i] = value;
            }
        for (int64_t i = 0; i < n * n; i++)
            P[i] += Q[i];
        for (int64_t i = 0; i < n * nf; i++)
            if (fabs(G[i]) <= g->faded)
                G[i] = 0.0;
        double sum = 0.0;
        for (int64_t i = 0; i < nx; i++)
            sum += x[i];
        if (!isfinite(sum))
            return t + 1;
    }
    return samples;
}
