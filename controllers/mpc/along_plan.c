/* A linear MPC along planned moves: tables over the angle, interpolated and factored at every step.
   Start, front end and end of a step are generated from the law's own text. */

static double H[QP_N * QP_N], A[ROWS_A * QP_N], G_Z[QP_N * 4], ROWS_Z[ROWS_A * 4], K[4];
static double inverse[QP_N * QP_N], rows[QP_ROWS * QP_N], sizes[QP_ROWS];
static double gradient[QP_N], free_rows[ROWS_A], lower[QP_ROWS], upper[QP_ROWS], x[QP_N];
static double z[4], feedforward[3], following[FRONT_STATES], next[STATES];
static const double *arg[KERNEL_ARG];
static double *res[KERNEL_RES], w[KERNEL_W];
static long long int iw[KERNEL_IW];

/* Write table[place] + share (table[place + 1] - table[place]). */
static void between(const double *table, int place, double share, int count, double *out) {
  const double *low = table + place * count, *high = low + count;
  int i;
  for (i = 0; i < count; ++i) out[i] = low[i] + share * (high[i] - low[i]);
}

static int mpc_start_(const double *measurement, double *state) {
  arg[0] = measurement;
  res[0] = state;
  return START_KERNEL(arg, res, iw, w, 0);
}

static int mpc_step_(const double *measurement, const double *reference, double *state,
                     double *command, double *report) {
  const double before = state[DEVIATION], reach = UPPER[0];
  double steps, share, forward, move[1], opening;
  int i, place = 0, iterations = 0, status;
  arg[0] = state;
  arg[1] = measurement;
  arg[2] = reference;
  res[0] = z;
  res[1] = feedforward;
  res[2] = following;
  FRONT_KERNEL(arg, res, iw, w, 0);
  steps = (measurement[0] - FIRST_ANGLE) / SPACING;
  while (place < ANGLES - 2 && steps >= place + 1) ++place;
  share = clipped(steps - place, 0.0, 1.0);
  forward = clipped(feedforward[1], -1.0, 1.0);
  between(HESSIAN, place, share, QP_N * QP_N, H);
  between(CONSTRAINT, place, share, ROWS_A * QP_N, A);
  between(G_ESTIMATE, place, share, QP_N * 4, G_Z);
  between(ROWS_ESTIMATE, place, share, ROWS_A * 4, ROWS_Z);
  between(GAIN, place, share, 4, K);
  product(G_Z, z, QP_N, 4, gradient);
  for (i = 0; i < QP_N; ++i) gradient[i] += G_BEFORE[i] * before;
  product(ROWS_Z, z, ROWS_A, 4, free_rows);
  for (i = 0; i < QP_ROWS; ++i) {
    lower[i] = LOWER[i];
    upper[i] = UPPER[i];
  }
  for (i = 0; i < LIMITED; ++i) {
    lower[MOVES + i] = (feedforward[0] - ROOM) / SLACK_SCALE;
    upper[MOVES + LIMITED + i] = (feedforward[0] + ROOM) / SLACK_SCALE;
  }
  for (i = 0; i < ROWS_A; ++i) {
    lower[i] -= free_rows[i];
    upper[i] -= free_rows[i];
  }
  lower[0] += before;
  upper[0] += before;
  for (i = ROWS_A; i < ROWS_A + MOVES; ++i) {
    lower[i] -= forward;
    upper[i] -= forward;
  }
  if (before + reach < lower[ROWS_A]) lower[ROWS_A] = before + reach;
  if (before - reach > upper[ROWS_A]) upper[ROWS_A] = before - reach;
  status = qp_factor(H, A, inverse, rows, sizes);
  if (status == QP_SUCCESS)
    status = qp_solve(inverse, rows, sizes, gradient, lower, upper, x, &iterations);
  if (status == QP_SUCCESS) {
    move[0] = x[0];
  } else {
    product(K, z, 1, 4, move);
    move[0] = -move[0];
  }
  opening = clipped(forward + move[0], -1.0, 1.0);
  arg[0] = state;
  arg[1] = z;
  arg[2] = feedforward;
  arg[3] = following;
  arg[4] = &opening;
  res[0] = next;
  AFTER_KERNEL(arg, res, iw, w, 0);
  for (i = 0; i < STATES; ++i) state[i] = next[i];
  status = given(&opening, status, x[QP_N - 1] * SLACK_SCALE, iterations, command, report);
#ifdef LEARNED
  command[0] = clipped(voltage_of(0, opening - state[LEARNED]) +
                           (voltage_of(0, state[KNOWN] + state[LEARNED]) - voltage_of(0, state[KNOWN])),
                       VALVE_CENTRE[0] - VOLTAGE[VALVE_LAST],
                       VALVE_CENTRE[0] + VOLTAGE[VALVE_LAST]);
#endif
  return status;
}
