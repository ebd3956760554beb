/* A linear MPC on the whole linear model. The state is the estimate (N_Z), openings, then lags. */

static int mpc_start_(const double *measurement, double *state) {
  double deviation[SENSORS];
  int i;
  for (i = 0; i < SENSORS; ++i) deviation[i] = measurement[i] - REST[i];
  product(START, deviation, N_Z, SENSORS, state);
  for (i = 0; i < OPENINGS; ++i) state[N_Z + i] = REST_OPENING[i];
  for (i = 0; i < FOLLOWED; ++i)
    state[N_Z + OPENINGS + i] = state[N_Z + OPENINGS + FOLLOWED + i] = measurement[i];
#ifdef PACED
  for (i = 0; i < FOLLOWED; ++i) {
    state[N_Z + OPENINGS + 2 * FOLLOWED + i] = measurement[i];
    state[N_Z + OPENINGS + 3 * FOLLOWED + i] = 0.0;
  }
#endif
  return 0;
}

/* The unconstrained regulator us - K (x - xs). */
static void regulator(const double *estimate, const double *reference, double *move) {
  double cause[N_W + FOLLOWED], at_rest[N_X + OPENINGS], error[N_X];
  int i;
  for (i = 0; i < N_W; ++i) cause[i] = estimate[N_X + i];
  for (i = 0; i < FOLLOWED; ++i) cause[N_W + i] = reference[i];
  product(TARGET, cause, N_X + OPENINGS, N_W + FOLLOWED, at_rest);
  for (i = 0; i < N_X; ++i) error[i] = estimate[i] - at_rest[i];
  product(GAIN, error, OPENINGS, N_X, move);
  for (i = 0; i < OPENINGS; ++i) move[i] = at_rest[N_X + i] - move[i];
}

static int mpc_step_(const double *measurement, const double *reference, double *state,
                     double *command, double *report) {
  static double estimate[N_Z], part[N_Z], residual[SENSORS], wanted[FOLLOWED * HORIZON], lags[3];
  static double gradient[QP_N], other[QP_N], free_rows[ROWS_A], lower[QP_ROWS], upper[QP_ROWS];
  static double x[QP_N], before[OPENINGS], move[OPENINGS], opening[OPENINGS], last[FOLLOWED];
  double *const filtered = state + N_Z + OPENINGS, *const target = filtered + FOLLOWED;
#ifdef PACED
  double *const paced = target + FOLLOWED, *const moved = paced + FOLLOWED;
  double away, fast, less, more;
#endif
  int i, k, iterations, status;
  for (i = 0; i < OPENINGS; ++i) before[i] = state[N_Z + i] - REST_OPENING[i];
  product(C, state, SENSORS, N_Z, residual);
  for (i = 0; i < SENSORS; ++i) residual[i] = measurement[i] - REST[i] - residual[i];
  product(M, residual, N_Z, SENSORS, part);
  for (i = 0; i < N_Z; ++i) estimate[i] = state[i] + part[i];
  for (k = 0; k < FOLLOWED; ++k) {
    double *const own = wanted + k * HORIZON;
#ifdef PREVIEW_STRIDE
    for (i = 0; i < HORIZON; ++i)
      own[i] = reference[FOLLOWED * PREVIEW_STRIDE * (i + 1) + k] - REST[k];
    lags[0] = lags[1] = lags[2] = reference[k];
#else
    lags[0] = reference[k];
#ifdef PACED
    away = reference[k] - paced[k];
    fast = 4.0 * fabs(away) / (1.0 + sqrt(1.0 + 8.0 * fabs(away) / BRAKE[k]));
    fast = fmin(fmax(fast, LEAP[k]), PACE[k]);
    away = clipped(away, -fast, fast);
    less = BRAKE[k] - moved[k];
    more = BRAKE[k] + moved[k];
    if (moved[k] <= LEAP[k]) less = fmax(less, LEAP[k]);
    if (moved[k] >= -LEAP[k]) more = fmax(more, LEAP[k]);
    moved[k] = clipped(away, -less, more);
    lags[0] = paced[k] += moved[k];
#endif
    lags[1] = filtered[k] + FRESH[k] * (lags[0] - filtered[k]);
    lags[2] = target[k] + FRESH[k] * (lags[1] - target[k]);
    product(PATH + 3 * k * HORIZON, lags, HORIZON, 3, own);
    for (i = 0; i < HORIZON; ++i) own[i] -= REST[k];
#endif
    filtered[k] = lags[1];
    target[k] = lags[2];
    last[k] = own[HORIZON - 1];
  }
  product(G_ESTIMATE, estimate, QP_N, N_Z, gradient);
  product(G_REFERENCE, wanted, QP_N, FOLLOWED * HORIZON, other);
  for (i = 0; i < QP_N; ++i) gradient[i] += other[i];
  product(G_BEFORE, before, QP_N, OPENINGS, other);
  for (i = 0; i < QP_N; ++i) gradient[i] += other[i];
  product(ROWS_ESTIMATE, estimate, ROWS_A, N_Z, free_rows);
  for (i = 0; i < QP_ROWS; ++i) {
    const double free_row = i < ROWS_A ? free_rows[i] : 0.0;
    lower[i] = LOWER[i] - free_row;
    upper[i] = UPPER[i] - free_row;
  }
  for (i = 0; i < OPENINGS; ++i) {
    lower[i] += before[i];
    upper[i] += before[i];
  }
  status = qp_solve(INVERSE, ROWS, SIZES, gradient, lower, upper, x, &iterations);
  if (status == QP_SUCCESS)
    for (i = 0; i < OPENINGS; ++i) move[i] = x[i];
  else
    regulator(estimate, last, move);
  for (i = 0; i < OPENINGS; ++i) {
    move[i] = clipped(move[i], LOWER[ROWS_A + i], UPPER[ROWS_A + i]);
    opening[i] = clipped(move[i] + REST_OPENING[i], -1.0, 1.0);
    before[i] = opening[i] - REST_OPENING[i];
    state[N_Z + i] = opening[i];
  }
  product(F, estimate, N_Z, N_Z, state);
  product(G, before, N_Z, OPENINGS, part);
  for (i = 0; i < N_Z; ++i) state[i] += part[i];
  return given(opening, status, x[QP_N - 1] * SLACK_SCALE, iterations, command, report);
}
