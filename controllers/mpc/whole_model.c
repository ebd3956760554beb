/* A linear MPC on the whole linear model. The state is the estimate (N_Z), then opening and lags. */

static int mpc_start(const double *measurement, double *state) {
  double deviation[SENSORS];
  int i;
  for (i = 0; i < SENSORS; ++i) deviation[i] = measurement[i] - REST[i];
  product(START, deviation, N_Z, SENSORS, state);
  state[N_Z] = REST_OPENING;
  state[N_Z + 1] = state[N_Z + 2] = measurement[0];
  return 0;
}

/* The unconstrained regulator us - K (x - xs). */
static double regulator(const double *estimate, double reference) {
  double cause[N_W + 1], at_rest[N_X + 1], error[N_X], move[1];
  int i;
  for (i = 0; i < N_W; ++i) cause[i] = estimate[N_X + i];
  cause[N_W] = reference;
  product(TARGET, cause, N_X + 1, N_W + 1, at_rest);
  for (i = 0; i < N_X; ++i) error[i] = estimate[i] - at_rest[i];
  product(GAIN, error, 1, N_X, move);
  return at_rest[N_X] - move[0];
}

static int mpc_step(const double *measurement, const double *reference, double *state,
                    double *command, double *report) {
  static double estimate[N_Z], part[N_Z], residual[SENSORS], wanted[HORIZON], lags[3];
  static double gradient[QP_N], other[QP_N], free_rows[ROWS_A], lower[QP_ROWS], upper[QP_ROWS];
  static double x[QP_N];
  const double before = state[N_Z] - REST_OPENING;
  double move, opening;
  int i, iterations, status;
  product(C, state, SENSORS, N_Z, residual);
  for (i = 0; i < SENSORS; ++i) residual[i] = measurement[i] - REST[i] - residual[i];
  product(M, residual, N_Z, SENSORS, part);
  for (i = 0; i < N_Z; ++i) estimate[i] = state[i] + part[i];
#ifdef PREVIEW_STRIDE
  for (i = 0; i < HORIZON; ++i) wanted[i] = reference[PREVIEW_STRIDE * (i + 1)] - REST[0];
  lags[0] = lags[1] = lags[2] = reference[0];
#else
  lags[0] = reference[0];
  lags[1] = state[N_Z + 1] + FRESH * (reference[0] - state[N_Z + 1]);
  lags[2] = state[N_Z + 2] + FRESH * (lags[1] - state[N_Z + 2]);
  product(PATH, lags, HORIZON, 3, wanted);
  for (i = 0; i < HORIZON; ++i) wanted[i] -= REST[0];
#endif
  product(G_ESTIMATE, estimate, QP_N, N_Z, gradient);
  product(G_REFERENCE, wanted, QP_N, HORIZON, other);
  for (i = 0; i < QP_N; ++i) gradient[i] = gradient[i] + other[i] + G_BEFORE[i] * before;
  product(ROWS_ESTIMATE, estimate, ROWS_A, N_Z, free_rows);
  for (i = 0; i < QP_ROWS; ++i) {
    const double free_row = i < ROWS_A ? free_rows[i] : 0.0;
    lower[i] = LOWER[i] - free_row;
    upper[i] = UPPER[i] - free_row;
  }
  lower[0] += before;
  upper[0] += before;
  status = qp_solve(INVERSE, ROWS, SIZES, gradient, lower, upper, x, &iterations);
  move = status == QP_SUCCESS ? x[0] : regulator(estimate, wanted[HORIZON - 1]);
  move = clipped(move, LOWER[ROWS_A], UPPER[ROWS_A]);
  opening = clipped(move + REST_OPENING, -1.0, 1.0);
  product(F, estimate, N_Z, N_Z, state);
  for (i = 0; i < N_Z; ++i) state[i] += G[i] * (opening - REST_OPENING);
  state[N_Z + 1] = lags[1];
  state[N_Z + 2] = lags[2];
  state[N_Z] = opening;
  return given(opening, status, x[QP_N - 1] * SLACK_SCALE, iterations, command, report);
}
