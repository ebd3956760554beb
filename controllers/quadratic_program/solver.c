/* Dual active-set solver of small dense quadratic programs; `solver.py` explains the method. */
#include <math.h>

#define QP_ROUNDING 1e-13 /* relative violation that is rounding */
#define QP_DEPENDENT 1e-9 /* what is left of a row that depends on the active ones */
#define QP_FORGIVEN 1e-7  /* relative violation of such a row that is rounding */

/* Status: the minimiser was found, or why not. */
enum { QP_SUCCESS = 0, QP_LIMITED = 1, QP_INFEASIBLE = 2, QP_NOT_FINITE = 3 };

static double qp_Q[QP_N][QP_N]; /* orthonormal basis of the active rows, one vector per row */
static double qp_T[QP_N][QP_N]; /* turns the basis into the active rows' multipliers */
static double qp_y[QP_N];       /* the point of least length on the active rows, in the basis */
static double qp_sign[QP_N], qp_wanted[QP_N], qp_multiplier[QP_N];
static double qp_along[QP_N], qp_left[QP_N], qp_fall[QP_N], qp_u[QP_N], qp_v[QP_N];
static double qp_low[QP_ROWS], qp_high[QP_ROWS], qp_at[QP_ROWS];
static int qp_row[QP_N], qp_count;
static char qp_closed[QP_ROWS];

static double qp_dot(const double *a, const double *b, int n) {
  double sum = 0.0;
  int i;
  for (i = 0; i < n; ++i) sum += a[i] * b[i];
  return sum;
}

/* Split sign * row into its part along the basis and what is left; return the length of that. */
static double qp_split(const double *row, double sign) {
  int i, k, pass;
  for (i = 0; i < QP_N; ++i) {
    qp_left[i] = sign * row[i];
    qp_along[i] = 0.0;
  }
  for (pass = 0; pass < 2; ++pass) {
    for (k = 0; k < qp_count; ++k) {
      const double part = qp_dot(qp_Q[k], qp_left, QP_N);
      qp_along[k] += part;
      for (i = 0; i < QP_N; ++i) qp_left[i] -= part * qp_Q[k][i];
    }
  }
  return sqrt(qp_dot(qp_left, qp_left, QP_N));
}

/* Take in the row that was split last. */
static void qp_add(int row, double sign, double wanted, double length) {
  const int k = qp_count;
  int i, j;
  for (i = 0; i < QP_N; ++i) qp_Q[k][i] = qp_left[i] / length;
  for (i = 0; i < k; ++i) {
    double sum = 0.0;
    for (j = i; j < k; ++j) sum += qp_T[i][j] * qp_along[j];
    qp_T[i][k] = -sum / length;
  }
  qp_T[k][k] = 1.0 / length;
  qp_y[k] = (wanted - qp_dot(qp_along, qp_y, k)) / length;
  qp_row[k] = row;
  qp_sign[k] = sign;
  qp_wanted[k] = wanted;
  qp_count = k + 1;
}

/* Let an active row go; those that came after it are taken in again. */
static void qp_drop(int place, const double *rows) {
  const int before = qp_count;
  int k;
  qp_count = place;
  for (k = place + 1; k < before; ++k) {
    const double length = qp_split(rows + QP_N * qp_row[k], qp_sign[k]);
    qp_add(qp_row[k], qp_sign[k], qp_wanted[k], length);
  }
}

/* H = R' R; write R^-1, the rows of (A, 1) R^-1 scaled to length 1, and their lengths before. */
#ifdef QP_FACTOR
static int qp_factor(const double *H, const double *A, double *inverse, double *rows,
                     double *sizes) {
  static double lower[QP_N][QP_N];
  int i, j, k;
  for (j = 0; j < QP_N; ++j) {
    double pivot = H[j * QP_N + j] - qp_dot(lower[j], lower[j], j);
    if (!(pivot > 0.0)) return QP_NOT_FINITE;
    pivot = sqrt(pivot);
    lower[j][j] = pivot;
    for (i = j + 1; i < QP_N; ++i)
      lower[i][j] = (H[i * QP_N + j] - qp_dot(lower[i], lower[j], j)) / pivot;
  }
  for (j = 0; j < QP_N; ++j) {
    /* Column j of the inverse of the lower triangle is row j of R^-1. */
    for (i = 0; i < j; ++i) inverse[j * QP_N + i] = 0.0;
    inverse[j * QP_N + j] = 1.0 / lower[j][j];
    for (i = j + 1; i < QP_N; ++i) {
      double sum = 0.0;
      for (k = j; k < i; ++k) sum += lower[i][k] * inverse[j * QP_N + k];
      inverse[j * QP_N + i] = -sum / lower[i][i];
    }
  }
  for (k = 0; k < QP_ROWS; ++k) {
    double *row = rows + k * QP_N;
    for (j = 0; j < QP_N; ++j) row[j] = 0.0;
    if (k < QP_ROWS - QP_N) {
      for (i = 0; i < QP_N; ++i)
        for (j = i; j < QP_N; ++j) row[j] += A[k * QP_N + i] * inverse[i * QP_N + j];
    } else {
      for (j = 0; j < QP_N; ++j) row[j] = inverse[(k - QP_ROWS + QP_N) * QP_N + j];
    }
    sizes[k] = sqrt(qp_dot(row, row, QP_N));
    if (!isfinite(sizes[k])) return QP_NOT_FINITE;
    if (!(sizes[k] > 0.0)) sizes[k] = 1.0;
    for (j = 0; j < QP_N; ++j) row[j] /= sizes[k];
  }
  return QP_SUCCESS;
}
#endif

/* minimise 1/2 x' H x + g' x subject to lower <= (A x, x) <= upper, with the factors above. */
static int qp_solve(const double *inverse, const double *rows, const double *sizes,
                    const double *g, const double *lower, const double *upper, double *x,
                    int *iterations) {
  double base, size;
  int i, j, k, status = -1;
  *iterations = 0;
  qp_count = 0;
  for (j = 0; j < QP_N; ++j) {
    qp_v[j] = 0.0;
    for (i = 0; i <= j; ++i) qp_v[j] += g[i] * inverse[i * QP_N + j];
    qp_u[j] = 0.0;
  }
  base = sqrt(qp_dot(qp_v, qp_v, QP_N));
  if (!isfinite(base)) status = QP_NOT_FINITE;
  for (k = 0; k < QP_ROWS; ++k) {
    const double shift = qp_dot(rows + k * QP_N, qp_v, QP_N);
    qp_low[k] = lower[k] / sizes[k] + shift;
    qp_high[k] = upper[k] / sizes[k] + shift;
    qp_at[k] = 0.0;
    qp_closed[k] = 0;
    if (isnan(qp_low[k]) || isnan(qp_high[k]))
      status = QP_NOT_FINITE;
    else if (status < 0 && !(qp_low[k] - qp_high[k] <= QP_ROUNDING * base))
      status = QP_INFEASIBLE;
  }
  while (status < 0) {
    double worst = -INFINITY, sign, wanted, value;
    int p = 0;
    for (k = 0; k < QP_ROWS; ++k) {
      const double below = qp_low[k] - qp_at[k], above = qp_at[k] - qp_high[k];
      const double out = below >= above ? below : above;
      if (!qp_closed[k] && out > worst) {
        worst = out;
        p = k;
      }
    }
    size = base + sqrt(qp_dot(qp_u, qp_u, QP_N));
    if (worst <= QP_ROUNDING * size) {
      status = QP_SUCCESS;
      break;
    }
    sign = qp_low[p] - qp_at[p] >= qp_at[p] - qp_high[p] ? 1.0 : -1.0;
    wanted = sign > 0.0 ? qp_low[p] : -qp_high[p];
    value = sign * qp_at[p];
    for (;;) {
      double whole = INFINITY, first = INFINITY, length;
      int place = -1;
      if (*iterations == QP_LIMIT) {
        status = QP_LIMITED;
        break;
      }
      ++*iterations;
      length = qp_split(rows + p * QP_N, sign);
      /* Steps to where the row is met and to where the first multiplier is zero. */
      if (length > QP_DEPENDENT && qp_count < QP_N) whole = (wanted - value) / (length * length);
      for (i = 0; i < qp_count; ++i) {
        const double left = qp_multiplier[i] > 0.0 ? qp_multiplier[i] : 0.0;
        qp_fall[i] = 0.0;
        for (j = i; j < qp_count; ++j) qp_fall[i] += qp_T[i][j] * qp_along[j];
        if (qp_fall[i] > 0.0 && (place < 0 || left < first * qp_fall[i])) {
          first = left / qp_fall[i];
          place = i;
        }
      }
      if (place >= 0 && first < whole) {
        value += first * length * length;
        for (i = 0; i < qp_count; ++i) qp_multiplier[i] -= first * qp_fall[i];
        for (i = place; i + 1 < qp_count; ++i) qp_multiplier[i] = qp_multiplier[i + 1];
        for (k = 0; k < QP_ROWS; ++k) qp_closed[k] = 0;
        qp_drop(place, rows);
      } else if (whole < INFINITY) {
        qp_add(p, sign, wanted, length);
        break;
      } else if (wanted - value <= QP_FORGIVEN * size) {
        qp_closed[p] = 1;
        break;
      } else {
        status = QP_INFEASIBLE;
        break;
      }
    }
    for (i = 0; i < QP_N; ++i) qp_u[i] = 0.0;
    for (i = 0; i < qp_count; ++i) {
      for (j = 0; j < QP_N; ++j) qp_u[j] += qp_Q[i][j] * qp_y[i];
      qp_multiplier[i] = 0.0;
      for (j = i; j < qp_count; ++j) qp_multiplier[i] += qp_T[i][j] * qp_y[j];
      qp_closed[qp_row[i]] = 1;
    }
    for (k = 0; k < QP_ROWS; ++k) qp_at[k] = qp_dot(rows + k * QP_N, qp_u, QP_N);
  }
  for (i = 0; i < QP_N; ++i) {
    x[i] = 0.0;
    for (j = i; j < QP_N; ++j) x[i] += inverse[i * QP_N + j] * (qp_u[j] - qp_v[j]);
    if (status == QP_SUCCESS && !isfinite(x[i])) status = QP_NOT_FINITE;
  }
  return status;
}
