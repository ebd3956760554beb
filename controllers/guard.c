/* The guard around a law, as in guard.py, operation by operation. Limits and sizes stand before. */
#include <math.h>

enum {
  AT_MEASUREMENT = GUARD_LAW_STATES,
  AT_COMMAND = AT_MEASUREMENT + GUARD_SENSORS,
  AT_REFERENCE = AT_COMMAND + GUARD_COMMANDS,
  AT_ESTIMATE = AT_REFERENCE + GUARD_CONTROLLED,
  AT_DOUBTED = AT_ESTIMATE + GUARD_ESTIMATED,
  AT_SAME = AT_DOUBTED + GUARD_SENSORS,
  AT_MEND = AT_SAME + GUARD_SENSORS,
  AT_ORIGIN = AT_MEND + GUARD_SENSORS,
  AT_TARGET = AT_ORIGIN + GUARD_CONTROLLED,
  AT_BEST = AT_TARGET + GUARD_CONTROLLED,
  AT_IDLE,
  AT_RAILED,
  AT_SIDE,
  AT_TURNS,
  AT_BAD,
  AT_AWAY,
  AT_GOOD,
  AT_WAIT,
  AT_RAMP
};

#if GUARD_ESTIMATED > 0
static double guard_clip(double value, double lower, double upper) {
  return value < lower ? lower : value > upper ? upper : value;
}

/* out = start + matrix vector */
static void guard_sum(const double *start, const double *matrix, const double *vector, int rows,
                      int columns, double *out) {
  int i, j;
  for (i = 0; i < rows; ++i) {
    double sum = 0.0;
    for (j = 0; j < columns; ++j) sum += matrix[i * columns + j] * vector[j];
    out[i] = (start ? start[i] : 0.0) + sum;
  }
}

#if GUARD_CURVE > 0
static double guard_between(double x, const double *points, const double *values) {
  int i = 1;
  if (x <= points[0]) return values[0];
  if (x >= points[GUARD_CURVE - 1]) return values[GUARD_CURVE - 1];
  while (points[i] <= x) ++i;
  return (values[i] - values[i - 1]) / (points[i] - points[i - 1]) * (x - points[i - 1]) +
         values[i - 1];
}
#endif

/* Commands as the model takes them, less those at rest. */
static void guard_entered(const double *command, double *u) {
  int i;
  for (i = 0; i < GUARD_COMMANDS; ++i) {
    u[i] = command[i];
#if GUARD_CURVE > 0
    u[i] = guard_between(u[i], GUARD_CURVE_COMMANDS + i * GUARD_CURVE, GUARD_CURVE_ENTERED + i * GUARD_CURVE);
#endif
    u[i] -= GUARD_REST_COMMAND[i];
  }
}

static void guard_expected(const double *estimate, double *expected) {
  int i;
  guard_sum(GUARD_REST, GUARD_C, estimate, GUARD_SENSORS, GUARD_ESTIMATED, expected);
  for (i = 0; i < GUARD_SENSORS; ++i)
    expected[i] = guard_clip(expected[i], GUARD_SENSOR_LEAST[i], GUARD_SENSOR_MOST[i]);
}

/* Tell whether an output leaves its reference and can hardly be stopped in its range. */
static int guard_runs_away(const double *estimate, const double *following, const double *now) {
  double here[GUARD_SENSORS], there[GUARD_SENSORS];
  int i;
  guard_expected(estimate, here);
  guard_expected(following, there);
  for (i = 0; i < GUARD_CONTROLLED; ++i) {
    const int sensor = (int)GUARD_REFERENCE_SENSOR[i];
    double pace, end, braking;
    if (sensor < 0 || isinf(GUARD_REFERENCE_BRAKE[i])) continue;
    pace = there[sensor] - here[sensor];
    end = pace > 0.0 ? GUARD_REFERENCE_UPPER[i] : GUARD_REFERENCE_LOWER[i];
    braking = 0.5 * pace * pace / GUARD_REFERENCE_BRAKE[i];
    if ((now[i] - here[sensor]) * pace < 0.0 && braking > GUARD_REFERENCE_TOLERANCE[i] &&
        braking + fabs(pace) * GUARD_REFERENCE_LAG[i] >= fabs(end - here[sensor]))
      return 1;
  }
  return 0;
}

static void guard_at_rest(const double *measurement, double *estimate) {
  double away[GUARD_SENSORS];
  int i;
  for (i = 0; i < GUARD_SENSORS; ++i) away[i] = measurement[i] - GUARD_REST[i];
  guard_sum(0, GUARD_START, away, GUARD_ESTIMATED, GUARD_SENSORS, estimate);
}
#endif

static int guard_finite(const double *values, int count) {
  int i;
  for (i = 0; i < count; ++i)
    if (!isfinite(values[i])) return 0;
  return 1;
}

static int guard_begin(const double *measurement, double *state) {
  double seen[GUARD_SENSORS], at;
  int i, status;
  const int finite = guard_finite(measurement, GUARD_SENSORS);
  for (i = 0; i < GUARD_SENSORS; ++i) seen[i] = finite ? measurement[i] : 0.0;
  status = GUARD_LAW_START(seen, state);
  for (i = 0; i < GUARD_SENSORS; ++i) {
    state[AT_MEASUREMENT + i] = seen[i];
    state[AT_DOUBTED + i] = state[AT_SAME + i] = state[AT_MEND + i] = 0.0;
  }
  for (i = 0; i < GUARD_COMMANDS; ++i) state[AT_COMMAND + i] = GUARD_COMMAND_SAFE[i];
  for (i = 0; i < GUARD_CONTROLLED; ++i) {
    at = GUARD_REFERENCE_SENSOR[i] >= 0.0 ? seen[(int)GUARD_REFERENCE_SENSOR[i]] : 0.0;
    state[AT_REFERENCE + i] = state[AT_ORIGIN + i] = state[AT_TARGET + i] = at;
  }
#if GUARD_ESTIMATED > 0
  guard_at_rest(seen, state + AT_ESTIMATE);
#endif
  for (i = AT_BEST; i <= AT_WAIT; ++i) state[i] = 0.0;
  if (!finite) {
    state[AT_AWAY] = GUARD_INNER + 1.0;
    state[AT_WAIT] = GUARD_SETTLE;
  }
  state[AT_RAMP] = GUARD_RAMP;
  return finite ? status : 16 * GUARD_NOT_FINITE;
}

static int guard_start_(const double *measurement, double *state) {
  return guard_begin(measurement, state);
}

/* Remember a command, and what it lets expect. */
static void guard_commanded(double *state, const double *command) {
  int i;
#if GUARD_ESTIMATED > 0
  double u[GUARD_COMMANDS], forced[GUARD_ESTIMATED], next[GUARD_ESTIMATED];
  guard_entered(command, u);
  guard_sum(0, GUARD_G, u, GUARD_ESTIMATED, GUARD_COMMANDS, forced);
  guard_sum(forced, GUARD_F, state + AT_ESTIMATE, GUARD_ESTIMATED, GUARD_ESTIMATED, next);
  for (i = 0; i < GUARD_ESTIMATED; ++i) state[AT_ESTIMATE + i] = next[i];
#endif
  for (i = 0; i < GUARD_COMMANDS; ++i) state[AT_COMMAND + i] = command[i];
}

/* Give the law up. */
static void guard_fall(double *state, double wait) {
  int i;
#if GUARD_ESTIMATED > 0
  double expected[GUARD_SENSORS];
  guard_expected(state + AT_ESTIMATE, expected);
  for (i = 0; i < GUARD_CONTROLLED; ++i) {
    const double sensor = GUARD_REFERENCE_SENSOR[i], tolerance = GUARD_REFERENCE_TOLERANCE[i];
    if (sensor >= 0.0)
      state[AT_ORIGIN + i] =
          fmax(fmin(expected[(int)sensor], GUARD_REFERENCE_UPPER[i] - tolerance),
               GUARD_REFERENCE_LOWER[i] + tolerance);
    else
      state[AT_ORIGIN + i] = state[AT_REFERENCE + i];
  }
#endif
  for (i = AT_BEST; i <= AT_GOOD; ++i) state[i] = 0.0;
  state[AT_AWAY] = GUARD_HAS_INNER ? 0.0 : GUARD_INNER;
  state[AT_WAIT] = wait;
}

/* Give the command of the inner law, or the safe one. */
static int guard_apart(double *state, double *command, int fault) {
  int i;
  state[AT_AWAY] += 1.0;
  for (i = 0; i < GUARD_COMMANDS; ++i) command[i] = GUARD_COMMAND_SAFE[i];
#if GUARD_HAS_INNER > 0
  if (state[AT_AWAY] <= GUARD_INNER) {
    double away[GUARD_CONTROLLED], start[GUARD_COMMANDS], back[GUARD_COMMANDS];
    for (i = 0; i < GUARD_CONTROLLED; ++i)
      away[i] = state[AT_ORIGIN + i] - GUARD_REST_FOLLOWED[i];
    guard_sum(GUARD_REST_COMMAND, GUARD_K_REFERENCE, away, GUARD_COMMANDS, GUARD_CONTROLLED, start);
    guard_sum(0, GUARD_K, state + AT_ESTIMATE, GUARD_COMMANDS, GUARD_ESTIMATED, back);
    for (i = 0; i < GUARD_COMMANDS; ++i) {
      double u = start[i] - back[i];
#if GUARD_CURVE > 0
      u = guard_between(u, GUARD_CURVE_ENTERED + i * GUARD_CURVE, GUARD_CURVE_COMMANDS + i * GUARD_CURVE);
#endif
      start[i] = guard_clip(u, GUARD_COMMAND_LOWER[i], GUARD_COMMAND_UPPER[i]);
    }
    if (guard_finite(start, GUARD_COMMANDS))
      for (i = 0; i < GUARD_COMMANDS; ++i) command[i] = start[i];
  }
#endif
  guard_commanded(state, command);
  return 16 * fault;
}

/* Hold the last command, or give the law up. */
static int guard_refuse(double *state, double *command, int fault) {
  const double bad = state[AT_BAD] + 1.0;
  int i;
  if (bad <= GUARD_HOLD) {
    state[AT_BAD] = bad;
    state[AT_RAILED] = state[AT_IDLE] = 0.0;
    for (i = 0; i < GUARD_COMMANDS; ++i) command[i] = state[AT_COMMAND + i];
    guard_commanded(state, command);
    return 16 * fault;
  }
  guard_fall(state, GUARD_SETTLE);
  return guard_apart(state, command, fault);
}

/* Hold each measurement against what is expected of it; tell what is wrong and what is shown. */
static int guard_sensors(double *state, const double *measurement, double *seen) {
  double *last = state + AT_MEASUREMENT;
  double expected[GUARD_SENSORS], wide;
  int i, fault = GUARD_CLEAR;
#if GUARD_ESTIMATED > 0
  double modelled[GUARD_SENSORS], residual[GUARD_SENSORS], corrected[GUARD_ESTIMATED], u[GUARD_COMMANDS], strong = 0.0;
  int believed = 0;
  const int believing = state[AT_AWAY] <= GUARD_INNER;
  guard_entered(state + AT_COMMAND, u);
  for (i = 0; i < GUARD_COMMANDS; ++i)
    if (fabs(u[i]) > GUARD_WEAK[i]) strong = 1.0;
  guard_sum(GUARD_REST, GUARD_C, state + AT_ESTIMATE, GUARD_SENSORS, GUARD_ESTIMATED, modelled);
  if (believing)
    guard_expected(state + AT_ESTIMATE, expected);
  else
    for (i = 0; i < GUARD_SENSORS; ++i) expected[i] = last[i];
  wide = 1.0 + (believing ? GUARD_WIDER * state[AT_BAD] : state[AT_BAD]);
#else
  for (i = 0; i < GUARD_SENSORS; ++i) expected[i] = last[i];
  wide = 1.0 + state[AT_BAD];
#endif
  /* Where nothing was looked at meanwhile there is nothing to hold a measurement against. */
  if (state[AT_AWAY] > 0.0 && state[AT_BAD] > 0.0) wide = INFINITY;
  for (i = 0; i < GUARD_SENSORS; ++i) {
    const double value = measurement[i], off = fabs(value - expected[i]);
    int wrong = GUARD_CLEAR;
#if GUARD_ESTIMATED > 0
    const double before = state[AT_DOUBTED + i];
    const int stays = value == last[i];
    const double leap = before != 0.0 ? off : fmin(off, fabs(value - last[i]));
#else
    const double leap = off;
#endif
    if (!isfinite(value))
      wrong = GUARD_NOT_FINITE;
    else if (value < GUARD_SENSOR_LOWER[i] || value > GUARD_SENSOR_UPPER[i])
      wrong = GUARD_OUT_OF_RANGE;
    else if (leap > GUARD_SENSOR_JUMP[i] * wide)
      wrong = GUARD_JUMP;
#if GUARD_ESTIMATED > 0
    else if (stays && (before == 2.0 || (state[AT_SAME + i] + strong >= GUARD_HOLD &&
                                         off > GUARD_SENSOR_DOUBT[i])))
      wrong = GUARD_STUCK;
#endif
    if (fault == GUARD_CLEAR) fault = wrong;
    seen[i] = value;
#if GUARD_ESTIMATED > 0
    state[AT_SAME + i] = stays ? state[AT_SAME + i] + strong : 0.0;
    residual[i] = (isfinite(value) ? value : 0.0) - modelled[i];
    if (isfinite(value)) last[i] = value;
    if (wrong != GUARD_CLEAR) {
      state[AT_DOUBTED + i] = wrong == GUARD_STUCK || (stays && before == 2.0) ? 2.0 : 1.0;
      state[AT_MEND + i] = 0.0;
      continue;
    }
    if (state[AT_SAME + i] == 0.0) believed += 1 << i;
    state[AT_DOUBTED + i] = 0.0;
    state[AT_MEND + i] =
        before != 0.0 ? expected[i] - value : state[AT_MEND + i] * exp(-GUARD_FADE / GUARD_RAMP);
    if (fabs(state[AT_MEND + i]) <= 1e-6 * GUARD_SENSOR_JUMP[i])
      state[AT_MEND + i] = 0.0;
    else if (believing)
      seen[i] = value + state[AT_MEND + i];
#endif
  }
#if GUARD_ESTIMATED > 0
  if (believing) {
    guard_sum(state + AT_ESTIMATE, GUARD_M + believed * GUARD_ESTIMATED * GUARD_SENSORS, residual,
              GUARD_ESTIMATED, GUARD_SENSORS, corrected);
    for (i = 0; i < GUARD_ESTIMATED; ++i) state[AT_ESTIMATE + i] = corrected[i];
    guard_expected(corrected, expected);
    for (i = 0; i < GUARD_SENSORS; ++i)
      if (state[AT_DOUBTED + i] != 0.0)
        seen[i] = guard_clip(expected[i], GUARD_SENSOR_LOWER[i], GUARD_SENSOR_UPPER[i]);
  } else if (guard_finite(measurement, GUARD_SENSORS)) {
    guard_at_rest(measurement, state + AT_ESTIMATE);
    for (i = 0; i < GUARD_SENSORS; ++i) state[AT_MEND + i] = 0.0;
  }
#else
  if (guard_finite(measurement, GUARD_SENSORS) &&
      (fault == GUARD_CLEAR || state[AT_AWAY] > GUARD_INNER))
    for (i = 0; i < GUARD_SENSORS; ++i) last[i] = measurement[i];
#endif
  return fault;
}

/* Count how long the command is at its end, the error stays, and how often it turns. */
static void guard_progress(double *state, const double *command, const double *seen,
                           const double *now) {
  double error = 0.0, turned = 0.0, side = state[AT_SIDE];
  int i, ends = 0, same = 1, moved = state[AT_RAMP] < GUARD_RAMP, fresh = moved;
  if (isinf(GUARD_PATIENCE)) return;
  for (i = 0; i < GUARD_COMMANDS; ++i) {
    ends = ends || command[i] <= GUARD_COMMAND_LOWER[i] || command[i] >= GUARD_COMMAND_UPPER[i];
    same = same && command[i] == state[AT_COMMAND + i];
  }
  state[AT_RAILED] = ends && same ? state[AT_RAILED] + 1.0 : 0.0;
  for (i = 0; i < GUARD_CONTROLLED; ++i) {
    const double sensor = GUARD_REFERENCE_SENSOR[i], tolerance = GUARD_REFERENCE_TOLERANCE[i];
    double off;
    if (sensor < 0.0) continue;
    off = (now[i] - seen[(int)sensor]) / tolerance;
    if (fabs(off) > error) error = fabs(off);
    if (fabs(off) > fabs(turned)) turned = off;
    moved = moved || now[i] != state[AT_REFERENCE + i];
    fresh = fresh || fabs(now[i] - state[AT_TARGET + i]) > tolerance;
  }
  state[AT_IDLE] += 1.0;
  if (error <= 1.0 || fresh) {
    for (i = 0; i < GUARD_CONTROLLED; ++i) state[AT_TARGET + i] = now[i];
    state[AT_BEST] = error <= 1.0 ? 0.0 : error;
    state[AT_IDLE] = 0.0;
  } else if (state[AT_BEST] == 0.0 || error < state[AT_BEST] - 0.5) {
    state[AT_BEST] = error;
    state[AT_IDLE] = 0.0;
  }
  if (moved) {
    state[AT_SIDE] = state[AT_TURNS] = 0.0;
  } else if (turned * side < 0.0) {
    state[AT_TURNS] = fabs(side) > 0.25 ? state[AT_TURNS] + 1.0 : 0.0;
    state[AT_SIDE] = turned;
  } else if (fabs(turned) > fabs(side)) {
    state[AT_SIDE] = turned;
  }
}

static int guard_step_(const double *measurement, const double *reference, double *state,
                       double *command, double *report) {
  double wanted[GUARD_REFERENCES], now[GUARD_CONTROLLED], law[GUARD_LAW_STATES + 1];
  double seen[GUARD_SENSORS];
#if GUARD_ESTIMATED > 0
  double before[GUARD_ESTIMATED];
#endif
  int i, fault, found = GUARD_CLEAR, status;
  (void)report;
#if GUARD_REPORTS > 0
  for (i = 0; i < GUARD_REPORTS; ++i) report[i] = NAN;
#endif
  for (i = 0; i < GUARD_REFERENCES; ++i) {
    const int own = i % GUARD_CONTROLLED;
    const double led = state[AT_REFERENCE + own], pace = GUARD_REFERENCE_PACE[own];
    double value = reference[i];
    if (!isfinite(value)) {
      value = led;
      found = GUARD_REFERENCE;
    }
    if (value < GUARD_REFERENCE_LOWER[own]) {
      value = fmax(GUARD_REFERENCE_LOWER[own], led - pace);
      found = GUARD_REFERENCE;
    } else if (value > GUARD_REFERENCE_UPPER[own]) {
      value = fmin(GUARD_REFERENCE_UPPER[own], led + pace);
      found = GUARD_REFERENCE;
    }
    wanted[i] = value;
  }
  for (i = 0; i < GUARD_CONTROLLED; ++i) now[i] = wanted[i];
  fault = guard_sensors(state, measurement, seen);
  if (state[AT_AWAY] > 0.0) {
    state[AT_GOOD] = fault == GUARD_CLEAR ? state[AT_GOOD] + 1.0 : 0.0;
    state[AT_BAD] = 0.0;
    if (state[AT_GOOD] <= state[AT_WAIT])
      return guard_apart(state, command, fault == GUARD_CLEAR ? GUARD_RETURNING : fault);
    guard_begin(seen, state);
    for (i = 0; i < GUARD_CONTROLLED; ++i) {
      state[AT_REFERENCE + i] = now[i];
      if (GUARD_REFERENCE_SENSOR[i] < 0.0) state[AT_ORIGIN + i] = now[i];
    }
    state[AT_RAMP] = 0.0;
  } else if (fault != GUARD_CLEAR && (GUARD_ESTIMATED == 0 || state[AT_BAD] >= GUARD_BRIDGE)) {
    return guard_refuse(state, command, fault);
  }
  if (state[AT_RAMP] < GUARD_RAMP) {
    double s, share;
    state[AT_RAMP] += 1.0;
    s = state[AT_RAMP] / GUARD_RAMP;
    share = s * s * s * (10.0 + s * (6.0 * s - 15.0));
    for (i = 0; i < GUARD_REFERENCES; ++i) {
      const double origin = state[AT_ORIGIN + i % GUARD_CONTROLLED];
      wanted[i] = origin + share * (wanted[i] - origin);
    }
    found = GUARD_RETURNING;
  }
  for (i = 0; i < GUARD_LAW_STATES; ++i) law[i] = state[i];
  status = GUARD_LAW_STEP(seen, wanted, law, command, report);
  if (!guard_finite(command, GUARD_COMMANDS)) return guard_refuse(state, command, GUARD_LAW);
  guard_progress(state, command, seen, now);
  for (i = 0; i < GUARD_LAW_STATES; ++i) state[i] = law[i];
  for (i = 0; i < GUARD_CONTROLLED; ++i) state[AT_REFERENCE + i] = now[i];
  state[AT_BAD] = fault == GUARD_CLEAR ? 0.0 : state[AT_BAD] + 1.0;
  if (state[AT_RAILED] >= GUARD_PATIENCE || state[AT_IDLE] >= GUARD_PATIENCE ||
      state[AT_TURNS] >= GUARD_SWINGS) {
    fault = state[AT_RAILED] >= GUARD_PATIENCE ? GUARD_SATURATED
            : state[AT_IDLE] >= GUARD_PATIENCE ? GUARD_NO_PROGRESS
                                               : GUARD_OSCILLATION;
    guard_fall(state, GUARD_PATIENCE);
    return guard_apart(state, command, fault);
  }
#if GUARD_ESTIMATED > 0
  for (i = 0; i < GUARD_ESTIMATED; ++i) before[i] = state[AT_ESTIMATE + i];
#endif
  guard_commanded(state, command);
#if GUARD_ESTIMATED > 0
  if (guard_runs_away(before, state + AT_ESTIMATE, now)) {
    for (i = 0; i < GUARD_ESTIMATED; ++i) state[AT_ESTIMATE + i] = before[i];
    guard_fall(state, GUARD_PATIENCE);
    return guard_apart(state, command, GUARD_RUNAWAY);
  }
#endif
  if (fault != GUARD_CLEAR) return 16 * fault;
  return 16 * found + status;
}

static int guard_missed_(double *state, double *command) {
  if (state[AT_AWAY] > 0.0) {
    state[AT_GOOD] = 0.0;
    state[AT_BAD] += 1.0;
    return guard_apart(state, command, GUARD_DEADLINE);
  }
  return guard_refuse(state, command, GUARD_DEADLINE);
}
