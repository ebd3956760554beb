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

/* The voltage that gives an opening, by straight lines between the points of the valve's curve. */
static double voltage_for(double opening) {
  const double size = opening < 0.0 ? -opening : opening;
  double distance = VOLTAGE[VALVE_LAST];
  int i = 1;
  if (size < FRACTION[VALVE_LAST]) {
    while (FRACTION[i] <= size) ++i;
    distance = VOLTAGE[i - 1] + (size - FRACTION[i - 1]) * (VOLTAGE[i] - VOLTAGE[i - 1]) /
                                    (FRACTION[i] - FRACTION[i - 1]);
  }
  return VALVE_CENTRE + (opening < 0.0 ? -distance : distance);
}

/* Give the command for an opening, and tell how it was found. */
static int given(double opening, int status, double slack, int iterations, double *command,
                 double *report) {
  command[0] = voltage_for(opening);
  report[0] = opening;
  report[1] = status == QP_SUCCESS ? slack : NAN;
  report[2] = iterations;
  report[3] = status == QP_SUCCESS ? 0.0 : 1.0;
  return status;
}
