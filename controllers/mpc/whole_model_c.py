"""The linear MPC as C: the tables of its problem, factored in advance, and one step."""

from __future__ import annotations

import numpy as np

from controllers.mpc.c_text import HELPERS, REPORTS, Parts, notes, per_iteration, table, valve_curve
from controllers.mpc.whole_model import LinearMPC
from controllers.quadratic_program.compiled import solver_bytes, solver_source
from controllers.quadratic_program.solver import most_iterations


def linear_mpc_parts(mpc: LinearMPC, name: str) -> Parts:
    """Write a linear MPC as C.

    Args:
        mpc: The controller.
        name: Prefix of the functions.

    Returns:
        Source and what the header says.

    Example:
        >>> linear_mpc_parts.__name__
        'linear_mpc_parts'
    """
    p, observer = mpc.prediction, mpc.observer
    n, m = p.size
    n_z, sensors, n_w = len(observer.F), len(mpc.sensors), observer.disturbances
    N, n_x = p.samples, n_z - n_w
    limit = most_iterations(n, m)
    tables = {
        "F": observer.F,
        "G": observer.G[:, 0],
        "C": observer.C,
        "M": observer.M,
        "REST": observer.rest,
        "START": mpc.start,
        "G_ESTIMATE": p.g_estimate,
        "G_REFERENCE": p.g_reference,
        "G_BEFORE": p.g_before,
        "ROWS_ESTIMATE": p.rows_estimate,
        "LOWER": np.concatenate([p.lower_a, p.lower_x]),
        "UPPER": np.concatenate([p.upper_a, p.upper_x]),
        "TARGET": p.target,
        "GAIN": p.gain,
        "INVERSE": p.factors.inverse,
        "ROWS": p.factors.rows,
        "SIZES": p.factors.sizes,
    }
    if mpc.preview:
        stride = p.preview_index[0]
        want = f"""  for (i = 0; i < {N}; ++i)
    wanted[i] = reference[{stride} * (i + 1)] - REST[0];
  lags[0] = lags[1] = lags[2] = reference[0];
"""
    else:
        tables["PATH"] = mpc.path
        fresh = mpc.reference_speed * mpc.sample_time
        want = f"""  lags[0] = reference[0];
  lags[1] = state[{n_z + 1}] + {fresh!r} * (reference[0] - state[{n_z + 1}]);
  lags[2] = state[{n_z + 2}] + {fresh!r} * (lags[1] - state[{n_z + 2}]);
  product(PATH, lags, {N}, 3, wanted);
  for (i = 0; i < {N}; ++i) wanted[i] -= REST[0];
"""
    step = f"""
int {name}_start(const double *measurement, double *state) {{
  double deviation[{sensors}];
  int i;
  for (i = 0; i < {sensors}; ++i) deviation[i] = measurement[i] - REST[i];
  product(START, deviation, {n_z}, {sensors}, state);
  state[{n_z}] = {mpc.rest_opening!r};
  state[{n_z + 1}] = state[{n_z + 2}] = measurement[0];
  return 0;
}}

/* The unconstrained regulator us - K (x - xs). */
static double regulator(const double *estimate, double reference) {{
  double cause[{n_w + 1}], at_rest[{n_x + 1}], error[{n_x}], move[1];
  int i;
  for (i = 0; i < {n_w}; ++i) cause[i] = estimate[{n_x} + i];
  cause[{n_w}] = reference;
  product(TARGET, cause, {n_x + 1}, {n_w + 1}, at_rest);
  for (i = 0; i < {n_x}; ++i) error[i] = estimate[i] - at_rest[i];
  product(GAIN, error, 1, {n_x}, move);
  return at_rest[{n_x}] - move[0];
}}

int {name}_step(const double *measurement, const double *reference, double *state,
{" " * (len(name) + 10)}double *command, double *report) {{
  static double estimate[{n_z}], part[{n_z}], residual[{sensors}], wanted[{N}], lags[3];
  static double gradient[QP_N], other[QP_N], free_rows[{m}], lower[QP_ROWS], upper[QP_ROWS];
  static double x[QP_N];
  const double before = state[{n_z}] - {mpc.rest_opening!r};
  double move, opening;
  int i, iterations, status;
  if (!all_finite(measurement, {sensors}) || !all_finite(reference, {1 + mpc.preview})) {{
    state[{n_z}] = {mpc.rest_opening!r};
    return shut({mpc.rest_opening!r}, command, report);
  }}
  product(C, state, {sensors}, {n_z}, residual);
  for (i = 0; i < {sensors}; ++i) residual[i] = measurement[i] - REST[i] - residual[i];
  product(M, residual, {n_z}, {sensors}, part);
  for (i = 0; i < {n_z}; ++i) estimate[i] = state[i] + part[i];
{want}  product(G_ESTIMATE, estimate, QP_N, {n_z}, gradient);
  product(G_REFERENCE, wanted, QP_N, {N}, other);
  for (i = 0; i < QP_N; ++i) gradient[i] = gradient[i] + other[i] + G_BEFORE[i] * before;
  product(ROWS_ESTIMATE, estimate, {m}, {n_z}, free_rows);
  for (i = 0; i < QP_ROWS; ++i) {{
    const double free_row = i < {m} ? free_rows[i] : 0.0;
    lower[i] = LOWER[i] - free_row;
    upper[i] = UPPER[i] - free_row;
  }}
  lower[0] += before;
  upper[0] += before;
  status = qp_solve(INVERSE, ROWS, SIZES, gradient, lower, upper, x, &iterations);
  move = status == QP_SUCCESS ? x[0] : regulator(estimate, wanted[{N - 1}]);
  move = clipped(move, {float(p.lower_x[0])!r}, {float(p.upper_x[0])!r});
  opening = clipped(move + {mpc.rest_opening!r}, -1.0, 1.0);
  product(F, estimate, {n_z}, {n_z}, state);
  for (i = 0; i < {n_z}; ++i) state[i] += G[i] * (opening - {mpc.rest_opening!r});
  state[{n_z + 1}] = lags[1];
  state[{n_z + 2}] = lags[2];
  state[{n_z}] = opening;
  command[0] = voltage_for(opening);
  report[0] = opening;
  report[1] = status == QP_SUCCESS ? x[QP_N - 1] * {p.slack_scale!r} : NAN;
  report[2] = iterations;
  report[3] = status == QP_SUCCESS ? 0.0 : 1.0;
  return status;
}}
"""
    source = (
        solver_source(n, n + m, limit=limit, factor=False)
        + HELPERS
        + valve_curve(mpc.valve)
        + "".join(table(key, value) for key, value in tables.items())
        + step
    )
    work = solver_bytes(n, n + m, factor=False) + 8 * (
        2 * n_z + sensors + N + 3 + 3 * n + m + 2 * (n + m)
    )
    constants = 8 * sum(np.size(value) for value in tables.values())
    prepared = n_z * (3 * sensors + n_z) + N * 3 + n * (n_z + N) + m * n_z + (n + m) * n
    names = (*(f"state_or_disturbance_{i}" for i in range(n_z)), "opening", "lag_1", "lag_2")
    return Parts(
        source,
        names,
        (
            *notes(n, m, limit, work, constants, prepared),
            "Fallback where the status is not 0: the unconstrained regulator, clipped to the",
            "opening's limits. Where a reading or the reference is no number, the valve is shut",
            "and the estimate stays as it was.",
        ),
        REPORTS,
        prepared + limit * per_iteration(n, m),
    )
