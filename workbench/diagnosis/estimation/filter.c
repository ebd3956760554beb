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
    int64_t halvings; /* how often a sample is halved at the most where it bends */
    int64_t steps;    /* Runge-Kutta steps of a part that bends all the same */
    int64_t finer;    /* parts of such a step that bends */
    int64_t deeper;   /* how often a part is halved beyond that, in which even these would grow */
    const int64_t *places; /* of the states that measurements correct */
    const double *scale;   /* of each state */
    double sample_time, outlier, faded, little, alike, little_bent, much_bent, curved, nothing, stiff;
    int64_t most_doublings;
    int64_t tries, bent, kinks; /* exponential steps tried; parts that took Runge-Kutta steps, and of
                                   these those that bent */
    double *work;
} Filter;

/* What carries a part of a sample, and room for it. */
typedef struct {
    double *A, *B;         /* slopes amid it, over the scales */
    double *step, *driven; /* exponential of A, and what B adds to the sensitivities */
    double *all;           /* product of those of the parts of the sample so far */
    int64_t parts;         /* how many these are */
    double *kept;          /* slopes amid the part before, with which the next one is tried */
    double *held, *mean;   /* their exponential along half the time `held_for`, and its mean */
    double held_for, fastest; /* a bound of the fastest mode of `kept`, times half that time */
    double *a, *square, *cube, *other; /* rooms for matrices, and for vectors */
    double *rest, *ahead, *half, *whole, *amid, *end, *bent, *kink, *even;
    double *k[5], *at, *to; /* rates, and states */
} Part;

typedef double Four __attribute__((vector_size(32), aligned(8), may_alias));

/* Columns j to j + 4 FOURS, or to the last one, of ROWS rows of a product of matrices. The last
 * four numbers may reach beyond a row of b, and are not stored there. */
#define BLOCK(ROWS, FOURS)                                                                         \
    {                                                                                              \
        Four sum[ROWS][FOURS];                                                                     \
        for (int s = 0; s < (ROWS); s++)                                                           \
            for (int q = 0; q < (FOURS); q++)                                                      \
                sum[s][q] = add ? *(Four *)(to + s * m + j + 4 * q) : (Four){0.0};                 \
        for (int64_t l = 0; l < k; l++)                                                            \
            for (int s = 0; s < (ROWS); s++)                                                       \
                for (int q = 0; q < (FOURS); q++)                                                  \
                    sum[s][q] += from[s * k + l] * *(const Four *)(b + l * m + j + 4 * q);         \
        for (int s = 0; s < (ROWS); s++)                                                           \
            for (int q = 0; q < (FOURS); q++) {                                                    \
                double *at = to + s * m + j + 4 * q;                                               \
                const int64_t left = m - j - 4 * q;                                                \
                if (left >= 4)                                                                     \
                    *(Four *)at = sum[s][q];                                                       \
                else                                                                               \
                    for (int64_t e = 0; e < left; e++)                                             \
                        at[e] = sum[s][q][e];                                                      \
            }                                                                                      \
    }

#define ROWS_OF(ROWS)                                                                              \
    for (; i + (ROWS) <= n; i += (ROWS)) {                                                         \
        const double *from = a + i * k;                                                            \
        double *to = c + i * m;                                                                    \
        int64_t j = 0;                                                                             \
        const int64_t end = lower ? i + (ROWS) : m;                                                \
        for (; j + 4 < end; j += 8)                                                                \
            BLOCK(ROWS, 2)                                                                         \
        if (j < end)                                                                               \
            BLOCK(ROWS, 1)                                                                         \
    }

/* c = a b, or c += a b, for a of shape (n, k) and b of shape (k, m), where b and c have three numbers
 * of room behind them; of a symmetric c the lower half will do. */
static void product(double *restrict c, const double *restrict a, const double *restrict b, int64_t n,
                    int64_t k, int64_t m, int add, int lower)
{
    int64_t i = 0;
    ROWS_OF(4)
    ROWS_OF(2)
    ROWS_OF(1)
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
                 double *at)
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
        if (!(h * fabs(away) <= g->much_bent * h * gone + g->nothing * g->scale[i]))
            return 1;
    }
    return 0;
}

/* to = a x, four rows at a time, so that no sum waits for itself. */
static void times(double *restrict to, const double *restrict a, const double *restrict x, int64_t n)
{
    int64_t i = 0;
    for (; i + 4 <= n; i += 4) {
        const double *from = a + i * n;
        double sum[4] = {0.0};
        for (int64_t j = 0; j < n; j++)
            for (int s = 0; s < 4; s++)
                sum[s] += from[s * n + j] * x[j];
        memcpy(to + i, sum, sizeof sum);
    }
    for (; i < n; i++)
        to[i] = dot(a + i * n, x, n);
}

/* Largest sum along a row. */
static double norm(const double *a, int64_t n)
{
    double most = 0.0;
    for (int64_t i = 0; i < n; i++) {
        double sum = 0.0;
        for (int64_t j = 0; j < n; j++)
            sum += fabs(a[i * n + j]);
        most = sum > most ? sum : most;
    }
    return most;
}

/* Exponential of the slopes kept along half a part of this length, and its mean on the way. */
static void hold(const Filter *g, Part *m, double time)
{
    const int64_t n = g->corrected;
    const size_t size = (size_t)(n * n) * sizeof(double);
    double *a = m->a, *square = m->square, *cube = m->cube, *other = m->other;
    double *held = m->held, *mean = m->mean;
    for (int64_t i = 0; i < n * n; i++)
        a[i] = time / 2.0 * m->kept[i];
    product(square, a, a, n, n, n, 0, 0);
    product(cube, a, square, n, n, n, 0, 0);
    /* Parts along which the slopes do little; scales of states are seldom balanced. */
    const double by_square = sqrt(norm(square, n)), by_cube = cbrt(norm(cube, n));
    const double most = fmax(by_square, by_cube);
    double part = 1.0;
    int doublings = 0;
    for (; most * part > g->little && doublings < g->most_doublings; doublings++)
        part /= 2.0;
    for (int64_t i = 0; i < n * n; i++) {
        a[i] *= part;
        square[i] *= part * part;
        cube[i] *= part * part * part;
        /* mean = sum of a^k / (k + 1)!, held = I + a mean */
        mean[i] = a[i] / 2.0 + square[i] / 6.0;
        other[i] = a[i] / 120.0 + square[i] / 720.0;
    }
    for (int64_t i = 0; i < n; i++) {
        mean[i * n + i] += 1.0;
        other[i * n + i] += 1.0 / 24.0;
    }
    product(mean, cube, other, n, n, n, 1, 0);
    product(held, a, mean, n, n, n, 0, 0);
    for (int64_t i = 0; i < n; i++)
        held[i * n + i] += 1.0;
    /* Twice as far: mean = (mean + held mean) / 2, held = held^2 */
    for (; doublings; doublings--) {
        memcpy(other, mean, size);
        product(mean, held, other, n, n, n, 1, 0);
        for (int64_t i = 0; i < n * n; i++)
            mean[i] *= 0.5;
        memcpy(other, held, size);
        product(held, other, other, n, n, n, 0, 0);
    }
    m->held_for = time;
    m->fastest = fmin(by_square, by_cube);
}

/* What is left at the end of a part of what is added along it, a parabola from zero with these values
 * amid it and at its end: its mean over each half. */
static void added(Part *m, double time, const double *amid, const double *end, double *sum,
                  int64_t n)
{
    for (int64_t c = 0; c < n; c++)
        m->even[c] = time * (4.0 * amid[c] - end[c] / 2.0) / 12.0;
    times(m->rest, m->mean, m->even, n);
    times(sum, m->held, m->rest, n);
    for (int64_t c = 0; c < n; c++)
        m->even[c] = time * (4.0 * amid[c] + 2.5 * end[c]) / 12.0;
    times(m->rest, m->mean, m->even, n);
    for (int64_t c = 0; c < n; c++)
        sum[c] += m->rest[c];
}

/* Carry a state along a part by the exponential of the slopes amid it, where those of the part before
 * lead, and what they leave out by Simpson's rule, unless that is much: `m->to` is where it ends. */
static int at_once(Filter *g, Part *m, double time, const double *x, const double *u,
                   const double *p)
{
    const int64_t n = g->corrected;
    double **k = m->k, *to = m->to, *ahead = m->ahead;
    g->tries++;
    g->rates.res[0] = k[0];
    if (evaluate_at(&g->rates, x, u, p))
        return 0;
    for (int64_t i = 0; i < g->states; i++)
        to[i] = x[i] + time / 2.0 * k[0][i];
    for (int64_t c = 0; c < n; c++)
        m->rest[c] = time / 2.0 * k[0][g->places[c]] / g->scale[g->places[c]];
    times(ahead, m->mean, m->rest, n);
    for (int64_t c = 0; c < n; c++)
        to[g->places[c]] = x[g->places[c]] + g->scale[g->places[c]] * ahead[c];
    g->slope.res[0] = k[1];
    if (evaluate_at(&g->slope, to, u, p))
        return 0;
    for (int64_t i = 0; i < n * n; i++)
        m->other[i] = m->A[i] - m->kept[i];
    if (!(norm(m->other, n) * time / 2.0 <= g->alike)) {
        memcpy(m->kept, m->A, (size_t)(n * n) * sizeof(double));
        hold(g, m, time);
    }
    times(m->half, m->mean, m->rest, n);
    times(m->whole, m->held, m->half, n);
    for (int64_t i = 0; i < g->states; i++)
        to[i] = x[i] + time * k[1][i];
    for (int64_t c = 0; c < n; c++) {
        m->whole[c] += m->half[c];
        to[g->places[c]] = x[g->places[c]] + g->scale[g->places[c]] * m->whole[c];
    }
    g->rates.res[0] = k[2];
    if (evaluate_at(&g->rates, to, u, p))
        return 0;
    times(m->amid, m->kept, ahead, n);
    times(m->end, m->kept, m->whole, n);
    for (int64_t c = 0; c < n; c++) {
        const int64_t i = g->places[c];
        m->amid[c] = (k[1][i] - k[0][i]) / g->scale[i] - m->amid[c];
        m->end[c] = (k[2][i] - k[0][i]) / g->scale[i] - m->end[c];
    }
    added(m, time, m->amid, m->end, m->bent, n);
    /* What is at the end is nothing, if all is smooth. */
    for (int64_t c = 0; c < n; c++)
        m->even[c] = time / 6.0 * m->end[c];
    times(m->kink, m->mean, m->even, n);
    for (int64_t c = 0; c < n; c++) {
        const double gone = fabs(m->half[c]) + fabs(m->whole[c] - m->half[c]);
        if (!(fabs(m->kink[c]) <= g->little_bent * gone + g->nothing) ||
            !(fabs(m->bent[c]) <= g->curved * gone + g->nothing))
            return 0;
        to[g->places[c]] += g->scale[g->places[c]] * m->bent[c];
    }
    for (int64_t i = 0, c = 0; i < g->states; i++) {
        if (c < n && g->places[c] == i) {
            c++;
            continue;
        }
        const double away = time / 6.0 * (2.0 * k[1][i] - k[0][i] - k[2][i]);
        const double gone = time / 6.0 * (fabs(k[0][i]) + 4.0 * fabs(k[1][i]) + fabs(k[2][i]));
        if (!(fabs(away) <= g->curved * gone + g->nothing * g->scale[i]))
            return 0;
        to[i] = x[i] + time / 6.0 * (k[0][i] + 4.0 * k[1][i] + k[2][i]);
    }
    return 1;
}

/* Carry a state along a part by Runge-Kutta steps, and those that bend in finer ones. Returns
 * whether the equations could not be evaluated. */
static int in_steps(Filter *g, Part *m, double time, double *x, const double *u, const double *p)
{
    const double h = time / (double)g->steps, fine = h / (double)g->finer;
    g->bent++;
    for (int64_t s = 0; s < g->steps; s++) {
        /* The middle is the midpoint of a step, or begins one where their number is even. */
        const int with = s == g->steps / 2 ? (int)(g->steps % 2) : -1;
        if (slopes(g, x, h, u, p, m->k, m->at, with))
            return 1;
        const int kink = bends(g, x, h, u, p, m->k, m->at);
        g->kinks += kink;
        if (!kink)
            go(x, h, m->k, g->states);
        for (int64_t part = kink ? 0 : g->finer; part < g->finer; part++) {
            if (slopes(g, x, fine, u, p, m->k, m->at, -1))
                return 1;
            go(x, fine, m->k, g->states);
        }
    }
    return 0;
}

/* Carry a state, and the sensitivities G, along a part of a sample, or along both halves of it. Returns
 * whether the equations could not be evaluated. */
static int along(Filter *g, Part *m, double time, int64_t halvings, double *x, double *G,
                 const double *u, const double *p)
{
    const int64_t n = g->corrected, nf = g->free;
    const size_t size = (size_t)(n * n) * sizeof(double);
    if (m->held_for != time)
        hold(g, m, time);
    const int once = at_once(g, m, time, x, u, p);
    /* The finest Runge-Kutta step must not grow. */
    const int grows = 2.0 * m->fastest > g->stiff * (double)(g->steps * g->finer);
    if (!once && (halvings > 0 || (grows && halvings > -g->deeper)))
        return along(g, m, time / 2.0, halvings - 1, x, G, u, p) ||
               along(g, m, time / 2.0, halvings - 1, x, G, u, p);
    if (once) {
        memcpy(x, m->to, (size_t)g->states * sizeof(double));
    } else {
        if (in_steps(g, m, time, x, u, p))
            return 1;
        memcpy(m->kept, m->A, size);
        hold(g, m, time);
    }
    /* Along both halves: step = held^2, driven = (I + held) mean B */
    for (int64_t i = 0; i < n * nf; i++)
        m->B[i] *= time / 2.0;
    product(m->driven, m->mean, m->B, n, n, nf, 0, 0);
    memcpy(m->B, m->driven, (size_t)(n * nf) * sizeof(double));
    product(m->driven, m->held, m->B, n, n, nf, 1, 0);
    product(m->step, m->held, m->held, n, n, n, 0, 0);
    product(m->B, m->step, G, n, n, nf, 0, 0);
    for (int64_t i = 0; i < n * nf; i++)
        G[i] = m->B[i] + m->driven[i];
    if (m->parts++) {
        memcpy(m->other, m->all, size);
        product(m->all, m->step, m->other, n, n, n, 0, 0);
    } else {
        memcpy(m->all, m->step, size);
    }
    return 0;
}

/* Filter the samples of a recording; the results have a row for each. P and G have three numbers of
 * room behind them. Returns how many were done before the states left the finite numbers. */
int64_t filter(Filter *g, int64_t samples, double *x, double *P, double *G, const double *u,
               const double *y, const double *r, const double *p, const double *d, double *whitened,
               double *rows, double *logs, double *states)
{
    const int64_t nx = g->states, n = g->corrected, ny = g->measurements, nf = g->free;
    const size_t size = (size_t)(n * n) * sizeof(double);
    double *w = g->work;
    Part m = {.held_for = 0.0};
    double **rooms[] = {&m.A,    &m.step, &m.all,    &m.kept, &m.held,
                        &m.mean, &m.a,    &m.square, &m.cube, &m.other};
    for (int i = 0; i < 10; i++, w += n * n)
        *rooms[i] = w;
    double *P_half = w, *Q = w + n * n;
    for (int i = 0; i < 5; i++)
        m.k[i] = Q + n * n + i * nx;
    m.at = m.k[4] + nx;
    m.to = m.at + nx;
    w = m.to + nx;
    double **vectors[] = {&m.rest, &m.ahead, &m.half, &m.whole, &m.amid,
                          &m.end,  &m.bent,  &m.kink, &m.even};
    for (int i = 0; i < 9; i++, w += n)
        *vectors[i] = w;
    m.B = w;
    m.driven = m.B + n * nf;
    double *predicted = m.driven + n * nf, *H = predicted + ny, *D = H + ny * n;
    double *moved = D + ny * nf, *gain = moved + n, *row = gain + n;
    g->slope.res[1] = m.A;
    g->slope.res[2] = m.B;
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
        /* Prediction, with the slopes here where none are kept. */
        if (t == 0) {
            g->slope.res[0] = m.k[0];
            if (evaluate_at(&g->slope, x, u, p))
                return t;
            memcpy(m.kept, m.A, size);
        }
        m.parts = 0;
        if (along(g, &m, g->sample_time, g->halvings, x, G, u, p))
            return t;
        product(P_half, m.all, P, n, n, n, 0, 0);
        for (int64_t i = 0; i < n; i++)
            for (int64_t j = 0; j < n; j++)
                m.other[j * n + i] = m.all[i * n + j];
        product(P, P_half, m.other, n, n, n, 0, 1);
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
