/* What every step of a model-predictive controller needs; the valve's curve stands before. */

/* out = matrix vector, summed from the first column to the last. */
static void product(const double *matrix, const double *vector, int rows, int columns,
                    double *out) {
  int i, j;
  for (i = 0; i < rows; ++i) {
    double sum = matrix[i * columns] * vector[0];
    for (j = 1; j < columns; ++j) sum += matrix[i * columns + j] * vector[j];
    out[i] = sum;
  }
}

static double clipped(double value, double lower, double upper) {
  return value < lower ? lower : value > upper ? upper : value;
}

/* The voltage that gives an opening, by straight lines between the points of a valve's curve. */
static double voltage_of(int valve, double opening) {
  const int side = 2 * valve + (opening < 0.0);
  const double *fraction = FRACTION + side * (VALVE_LAST + 1);
  const double *voltage = VOLTAGE + side * (VALVE_LAST + 1);
  const double size = opening < 0.0 ? -opening : opening;
  double distance = voltage[VALVE_LAST];
  int i = 1;
  if (size < fraction[VALVE_LAST]) {
    while (fraction[i] <= size) ++i;
    distance = voltage[i - 1] + (size - fraction[i - 1]) * (voltage[i] - voltage[i - 1]) /
                                    (fraction[i] - fraction[i - 1]);
  }
  return VALVE_CENTRE[valve] + (opening < 0.0 ? -distance : distance);
}

/* Give the commands for openings, and tell how they were found. */
static int given(const double *opening, int status, double slack, int iterations, double *command,
                 double *report) {
  int i;
  for (i = 0; i < OPENINGS; ++i) {
    command[i] = voltage_of(i, opening[i]);
    report[i] = opening[i];
  }
  report[OPENINGS] = status == QP_SUCCESS ? slack : NAN;
  report[OPENINGS + 1] = iterations;
  report[OPENINGS + 2] = status == QP_SUCCESS ? 0.0 : 1.0;
  return status;
}
