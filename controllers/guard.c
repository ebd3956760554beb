/* The guard around a law, as in guard.py, operation by operation. Limits and sizes stand before. */
#include <math.h>

enum {
  AT_MEASUREMENT = GUARD_LAW_STATES,
  AT_COMMAND = AT_MEASUREMENT + GUARD_SENSORS,
  AT_REFERENCE = AT_COMMAND + GUARD_COMMANDS,
  AT_STILL = AT_REFERENCE + GUARD_CONTROLLED,
  AT_SAME = AT_STILL + GUARD_SENSORS,
  AT_PACE = AT_SAME + GUARD_SENSORS,
  AT_PLACE = AT_PACE + GUARD_SENSORS,
  AT_ORIGIN = AT_PLACE + GUARD_SENSORS,
  AT_TARGET = AT_ORIGIN + GUARD_CONTROLLED,
  AT_BEST = AT_TARGET + GUARD_CONTROLLED,
  AT_IDLE,
  AT_RAILED,
  AT_BAD,
  AT_GOOD,
  AT_WAIT,
  AT_RAMP
};

static double guard_followed(const double *measurement) {
  int i;
  for (i = 0; i < GUARD_CONTROLLED; ++i)
    if (GUARD_REFERENCE_SENSOR[i] >= 0.0) return measurement[(int)GUARD_REFERENCE_SENSOR[i]];
  return 0.0;
}

static double guard_tolerance(void) {
  int i;
  for (i = 0; i < GUARD_CONTROLLED; ++i)
    if (GUARD_REFERENCE_SENSOR[i] >= 0.0) return GUARD_REFERENCE_TOLERANCE[i];
  return INFINITY;
}

static int guard_begin(const double *measurement, double *state) {
  double seen[GUARD_SENSORS], at[GUARD_CONTROLLED];
  int i, finite = 1, status;
  for (i = 0; i < GUARD_SENSORS; ++i) finite = finite && isfinite(measurement[i]);
  for (i = 0; i < GUARD_SENSORS; ++i) seen[i] = finite ? measurement[i] : 0.0;
  for (i = 0; i < GUARD_CONTROLLED; ++i)
    at[i] = GUARD_REFERENCE_SENSOR[i] >= 0.0 ? seen[(int)GUARD_REFERENCE_SENSOR[i]] : 0.0;
  status = GUARD_LAW_START(seen, state);
  for (i = 0; i < GUARD_SENSORS; ++i) {
    state[AT_MEASUREMENT + i] = seen[i];
    state[AT_STILL + i] = state[AT_SAME + i] = state[AT_PACE + i] = 0.0;
    state[AT_PLACE + i] = guard_followed(seen);
  }
  for (i = 0; i < GUARD_COMMANDS; ++i) state[AT_COMMAND + i] = GUARD_COMMAND_SAFE[i];
  for (i = 0; i < GUARD_CONTROLLED; ++i)
    state[AT_REFERENCE + i] = state[AT_ORIGIN + i] = state[AT_TARGET + i] = at[i];
  for (i = AT_BEST; i <= AT_GOOD; ++i) state[i] = 0.0;
  state[AT_WAIT] = finite ? 0.0 : GUARD_SETTLE;
  state[AT_RAMP] = GUARD_RAMP;
  return finite ? status : 16 * GUARD_NOT_FINITE;
}

static int guard_start(const double *measurement, double *state) {
  return guard_begin(measurement, state);
}

static int guard_make_safe(double *state, double *command, double wait, int fault) {
  int i;
  for (i = 0; i < GUARD_COMMANDS; ++i)
    state[AT_COMMAND + i] = command[i] = GUARD_COMMAND_SAFE[i];
  state[AT_BEST] = state[AT_IDLE] = state[AT_RAILED] = state[AT_BAD] = state[AT_GOOD] = 0.0;
  state[AT_WAIT] = wait;
  return 16 * fault;
}

/* Hold the last command, or give the safe one. */
static int guard_refuse(double *state, const double *measurement, double *command, int fault) {
  const double bad = state[AT_BAD] + 1.0;
  int i, finite = 1;
  if (state[AT_WAIT] == 0.0 && fault != GUARD_STUCK && bad <= GUARD_HOLD) {
    state[AT_BAD] = bad;
    state[AT_RAILED] = state[AT_IDLE] = 0.0;
    for (i = 0; i < GUARD_COMMANDS; ++i) command[i] = state[AT_COMMAND + i];
    return 16 * fault;
  }
  for (i = 0; i < GUARD_SENSORS; ++i) finite = finite && isfinite(measurement[i]);
  for (i = 0; finite && i < GUARD_SENSORS; ++i) state[AT_MEASUREMENT + i] = measurement[i];
  return guard_make_safe(state, command, state[AT_WAIT] == 0.0 ? GUARD_SETTLE : state[AT_WAIT],
                         fault);
}

/* Count what does not change, and tell what is wrong with the measurements. */
static int guard_sensors(double *state, const double *measurement, double error) {
  const double far = 1.0 + state[AT_BAD], followed = guard_followed(measurement);
  double effort = 0.0;
  int i, fault = GUARD_CLEAR;
  for (i = 0; i < GUARD_SENSORS; ++i) {
    if (!isfinite(measurement[i])) return GUARD_NOT_FINITE;
    if (measurement[i] < GUARD_SENSOR_LOWER[i] || measurement[i] > GUARD_SENSOR_UPPER[i])
      return GUARD_OUT_OF_RANGE;
    if (fabs(measurement[i] - state[AT_MEASUREMENT + i]) > GUARD_SENSOR_JUMP[i] * far)
      return GUARD_JUMP;
  }
  if (isinf(GUARD_STUCK_AFTER)) return GUARD_CLEAR;
  for (i = 0; i < GUARD_COMMANDS; ++i) {
    const double share =
        (fabs(state[AT_COMMAND + i] - GUARD_COMMAND_SAFE[i]) / GUARD_COMMAND_REACH[i] -
         GUARD_WEAK) /
        (1.0 - GUARD_WEAK);
    if (share > effort) effort = share < 1.0 ? share : 1.0;
  }
  for (i = 0; i < GUARD_SENSORS; ++i) {
    const double moved = fabs(followed - state[AT_PLACE + i]) / guard_tolerance();
    const double change = fabs(measurement[i] - state[AT_MEASUREMENT + i]);
    const int inside =
        GUARD_SENSOR_LOWER[i] < measurement[i] && measurement[i] < GUARD_SENSOR_UPPER[i];
    if (change > 0.0) {
      state[AT_STILL + i] = state[AT_SAME + i] = 0.0;
      state[AT_PLACE + i] = followed;
      state[AT_PACE + i] = change;
      continue;
    }
    state[AT_SAME + i] = inside ? state[AT_SAME + i] + 1.0 : 0.0;
    if (GUARD_SENSOR_WATCHED[i] != 0.0 && inside && (error > 1.0 || moved > 1.0))
      state[AT_STILL + i] += effort;
    else
      state[AT_STILL + i] = 0.0;
    if (state[AT_STILL + i] >= GUARD_STUCK_AFTER ||
        (state[AT_PACE + i] >= GUARD_SENSOR_MOTION[i] && state[AT_SAME + i] >= GUARD_HOLD))
      fault = GUARD_STUCK;
  }
  return fault;
}

/* Count how long the command has been at its end, and the error without progress. */
static void guard_progress(double *state, const double *command, const double *now, double error) {
  int i, ends = 0, same = 1, fresh = state[AT_RAMP] < GUARD_RAMP;
  if (isinf(GUARD_PATIENCE)) return;
  for (i = 0; i < GUARD_COMMANDS; ++i) {
    ends = ends || command[i] <= GUARD_COMMAND_LOWER[i] || command[i] >= GUARD_COMMAND_UPPER[i];
    same = same && command[i] == state[AT_COMMAND + i];
  }
  state[AT_RAILED] = ends && same ? state[AT_RAILED] + 1.0 : 0.0;
  for (i = 0; i < GUARD_CONTROLLED; ++i)
    fresh = fresh || (GUARD_REFERENCE_SENSOR[i] >= 0.0 &&
                      fabs(now[i] - state[AT_TARGET + i]) > GUARD_REFERENCE_TOLERANCE[i]);
  if (error <= 1.0 || fresh) {
    for (i = 0; i < GUARD_CONTROLLED; ++i) state[AT_TARGET + i] = now[i];
    state[AT_BEST] = error <= 1.0 ? 0.0 : error;
    state[AT_IDLE] = 0.0;
  } else if (state[AT_BEST] == 0.0 || error < state[AT_BEST] - 0.5) {
    state[AT_BEST] = error;
    state[AT_IDLE] = 0.0;
  } else {
    state[AT_IDLE] += 1.0;
  }
}

static int guard_step(const double *measurement, const double *reference, double *state,
                      double *command, double *report) {
  double wanted[GUARD_REFERENCES], now[GUARD_CONTROLLED], law[GUARD_LAW_STATES + 1], error = 0.0;
  int i, fault, found = GUARD_CLEAR, finite = 1, status;
  (void)report;
#if GUARD_REPORTS > 0
  for (i = 0; i < GUARD_REPORTS; ++i) report[i] = NAN;
#endif
  for (i = 0; i < GUARD_REFERENCES; ++i) {
    const int own = i % GUARD_CONTROLLED;
    double value = reference[i];
    if (!isfinite(value)) {
      value = state[AT_REFERENCE + own];
      found = GUARD_REFERENCE;
    }
    if (value < GUARD_REFERENCE_LOWER[own]) {
      value = GUARD_REFERENCE_LOWER[own];
      found = GUARD_REFERENCE;
    } else if (value > GUARD_REFERENCE_UPPER[own]) {
      value = GUARD_REFERENCE_UPPER[own];
      found = GUARD_REFERENCE;
    }
    wanted[i] = value;
  }
  for (i = 0; i < GUARD_CONTROLLED; ++i) now[i] = wanted[i];
  for (i = 0; i < GUARD_CONTROLLED; ++i) {
    const double sensor = GUARD_REFERENCE_SENSOR[i];
    if (sensor >= 0.0) {
      const double off = fabs(now[i] - measurement[(int)sensor]) / GUARD_REFERENCE_TOLERANCE[i];
      if (off > error) error = off;
    }
  }
  fault = guard_sensors(state, measurement, error);
  if (fault != GUARD_CLEAR) return guard_refuse(state, measurement, command, fault);
  if (state[AT_WAIT] > 0.0) {
    const double good = state[AT_GOOD] + 1.0;
    if (good <= state[AT_WAIT]) {
      state[AT_GOOD] = good;
      for (i = 0; i < GUARD_SENSORS; ++i) state[AT_MEASUREMENT + i] = measurement[i];
      for (i = 0; i < GUARD_COMMANDS; ++i) command[i] = GUARD_COMMAND_SAFE[i];
      return 16 * GUARD_RETURNING;
    }
    guard_begin(measurement, state);
    for (i = 0; i < GUARD_CONTROLLED; ++i) state[AT_REFERENCE + i] = now[i];
    state[AT_RAMP] = 0.0;
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
  status = GUARD_LAW_STEP(measurement, wanted, law, command, report);
  for (i = 0; i < GUARD_COMMANDS; ++i) finite = finite && isfinite(command[i]);
  if (!finite) return guard_refuse(state, measurement, command, GUARD_LAW);
  for (i = 0; i < GUARD_LAW_STATES; ++i) state[i] = law[i];
  guard_progress(state, command, now, error);
  for (i = 0; i < GUARD_SENSORS; ++i) state[AT_MEASUREMENT + i] = measurement[i];
  for (i = 0; i < GUARD_COMMANDS; ++i) state[AT_COMMAND + i] = command[i];
  for (i = 0; i < GUARD_CONTROLLED; ++i) state[AT_REFERENCE + i] = now[i];
  state[AT_BAD] = state[AT_GOOD] = 0.0;
  if (state[AT_RAILED] >= GUARD_PATIENCE || state[AT_IDLE] >= GUARD_PATIENCE)
    return guard_make_safe(state, command, GUARD_PATIENCE,
                           state[AT_RAILED] >= GUARD_PATIENCE ? GUARD_SATURATED
                                                              : GUARD_NO_PROGRESS);
  return 16 * found + status;
}
