"""The scheduled MPC as C: tables over the angle, interpolated and factored at every step.

Planner, observer and what the state becomes are generated from their own text with CasADi symbols.
"""

from __future__ import annotations

import casadi as ca
import numpy as np
import numpy.typing as npt

from controllers.arithmetic import SYMBOLS
from controllers.mpc.along_plan import Front, ScheduledMPC
from controllers.mpc.c_text import HELPERS, REPORTS, Parts, notes, per_iteration, table, valve_curve
from controllers.quadratic_program.compiled import solver_bytes, solver_source
from controllers.quadratic_program.solver import most_iterations


def scheduled_mpc_parts(mpc: ScheduledMPC, name: str) -> Parts:
    """Write a scheduled MPC as C.

    Args:
        mpc: The controller.
        name: Prefix of the functions.

    Returns:
        Source and what the header says.

    Example:
        >>> scheduled_mpc_parts.__name__
        'scheduled_mpc_parts'
    """
    first, schedule = mpc.predictions[0], mpc.tracking.schedule
    n, m = first.size
    n_u, limited = n - 1, (m - n + 1) // 2
    limit, count = most_iterations(n, m), len(mpc.predictions)
    names = mpc.state_names
    size = len(names)
    room = mpc.pressure_limits[1] - mpc.pressure_limits[0]
    tables: dict[str, npt.NDArray[np.float64]] = {
        key: np.array([getattr(p, field) for p in mpc.predictions])
        for key, field in (
            ("HESSIAN", "H"),
            ("CONSTRAINT", "A"),
            ("G_ESTIMATE", "g_estimate"),
            ("ROWS_ESTIMATE", "rows_estimate"),
            ("GAIN", "gain"),
        )
    }
    tables |= {"G_BEFORE": first.g_before}
    tables |= {"LOWER": np.concatenate([first.lower_a, first.lower_x])}
    tables |= {"UPPER": np.concatenate([first.upper_a, first.upper_x])}
    kernels = _kernels(mpc, name)
    generator = ca.CodeGenerator(f"{name}.c", {"with_header": False})
    for kernel in kernels:
        generator.add(kernel)
    front = kernels[1]
    args, results, integers, reals = (
        max(1, *(getattr(kernel, f"sz_{what}")() for kernel in kernels))
        for what in ("arg", "res", "iw", "w")
    )
    tail = size - int(front.numel_out(2))
    step = f"""
static double H[QP_N * QP_N], A[{m} * QP_N], G_Z[QP_N * 4], ROWS_Z[{m} * 4], K[4];
static double inverse[QP_N * QP_N], rows[QP_ROWS * QP_N], sizes[QP_ROWS];
static double gradient[QP_N], free_rows[{m}], lower[QP_ROWS], upper[QP_ROWS], x[QP_N];
static double z[4], course[3], following[{size - tail}], next[{size}];
static const double *arg[{args}];
static double *res[{results}], w[{reals}];
static long long int iw[{integers}];

/* Write table[place] + share (table[place + 1] - table[place]). */
static void between(const double *table, int place, double share, int count, double *out) {{
  const double *low = table + place * count, *high = low + count;
  int i;
  for (i = 0; i < count; ++i) out[i] = low[i] + share * (high[i] - low[i]);
}}

int {name}_start(const double *measurement, double *state) {{
  arg[0] = measurement;
  res[0] = state;
  return {name}_start_kernel(arg, res, iw, w, 0);
}}

int {name}_step(const double *measurement, const double *reference, double *state,
{" " * (len(name) + 10)}double *command, double *report) {{
  const double before = state[{names.index("deviation")}], reach = UPPER[0];
  double steps, share, forward, move[1], opening;
  int i, place = 0, iterations = 0, status;
  if (!all_finite(measurement, {len(mpc.sensors)}) || !all_finite(reference, 1))
    return shut(0.0, command, report);
  arg[0] = state;
  arg[1] = measurement;
  arg[2] = reference;
  res[0] = z;
  res[1] = course;
  res[2] = following;
  {name}_front_kernel(arg, res, iw, w, 0);
  steps = (measurement[0] - {schedule.first_angle!r}) / {schedule.spacing!r};
  while (place < {count - 2} && steps >= place + 1) ++place;
  share = clipped(steps - place, 0.0, 1.0);
  forward = clipped(course[1], -1.0, 1.0);
  between(HESSIAN, place, share, QP_N * QP_N, H);
  between(CONSTRAINT, place, share, {m} * QP_N, A);
  between(G_ESTIMATE, place, share, QP_N * 4, G_Z);
  between(ROWS_ESTIMATE, place, share, {m} * 4, ROWS_Z);
  between(GAIN, place, share, 4, K);
  product(G_Z, z, QP_N, 4, gradient);
  for (i = 0; i < QP_N; ++i) gradient[i] += G_BEFORE[i] * before;
  product(ROWS_Z, z, {m}, 4, free_rows);
  for (i = 0; i < QP_ROWS; ++i) {{
    lower[i] = LOWER[i];
    upper[i] = UPPER[i];
  }}
  for (i = 0; i < {limited}; ++i) {{
    lower[{n_u} + i] = (course[0] - {room!r}) / {first.slack_scale!r};
    upper[{n_u + limited} + i] = (course[0] + {room!r}) / {first.slack_scale!r};
  }}
  for (i = 0; i < {m}; ++i) {{
    lower[i] -= free_rows[i];
    upper[i] -= free_rows[i];
  }}
  lower[0] += before;
  upper[0] += before;
  for (i = {m}; i < {m + n_u}; ++i) {{
    lower[i] -= forward;
    upper[i] -= forward;
  }}
  if (before + reach < lower[{m}]) lower[{m}] = before + reach;
  if (before - reach > upper[{m}]) upper[{m}] = before - reach;
  status = qp_factor(H, A, inverse, rows, sizes);
  if (status == QP_SUCCESS)
    status = qp_solve(inverse, rows, sizes, gradient, lower, upper, x, &iterations);
  if (status == QP_SUCCESS) {{
    move[0] = x[0];
  }} else {{
    product(K, z, 1, 4, move);
    move[0] = -move[0];
  }}
  opening = clipped(forward + move[0], -1.0, 1.0);
  arg[0] = state;
  arg[1] = z;
  arg[2] = course;
  arg[3] = following;
  arg[4] = &opening;
  res[0] = next;
  {name}_after_kernel(arg, res, iw, w, 0);
  for (i = 0; i < {size}; ++i) state[i] = next[i];
  command[0] = voltage_for(opening);
  report[0] = opening;
  report[1] = status == QP_SUCCESS ? x[QP_N - 1] * {first.slack_scale!r} : NAN;
  report[2] = iterations;
  report[3] = status == QP_SUCCESS ? 0.0 : 1.0;
  return status;
}}
"""
    source = (
        _generated(generator.dump())
        + solver_source(n, n + m, limit=limit)
        + HELPERS
        + valve_curve(mpc.valve)
        + "".join(table(key, value) for key, value in tables.items())
        + step
    )
    work = solver_bytes(n, n + m) + 8 * (
        (2 * n * n + m * n + (n + m) * (n + 3) + 5 * m + 6 * n + 4)
        + (7 + 2 * size - tail + args + results + integers + reals)
    )
    constants = 8 * sum(np.size(value) for value in tables.values())
    prepared = (
        sum(kernel.n_instructions() for kernel in kernels[1:])
        + n**3
        + 2 * m * n * n
        + 2 * (n + m) * n
        + (m + n) * (n + 8)
    )
    return Parts(
        source,
        names,
        (
            *notes(n, m, limit, work, constants, prepared),
            "Fallback where the status is not 0: the unconstrained regulator, clipped to the",
            "opening's limits. Where a reading or the reference is no number, the valve is shut",
            "and the state stays as it was.",
        ),
        REPORTS,
        prepared + limit * per_iteration(n, m),
    )


def _kernels(mpc: ScheduledMPC, name: str) -> tuple[ca.Function, ca.Function, ca.Function]:
    """Trace the start, the front end (errors; bias, opening, plan; its state) and the end."""
    m, r = ca.SX.sym("measurement", len(mpc.sensors)), ca.SX.sym("reference", 1)
    readings = tuple(ca.vertsplit(m))
    rest = len(mpc.state_names) - len(mpc.tracking.start(readings, SYMBOLS))
    begin = ca.vcat([*mpc.tracking.start(readings, SYMBOLS), *(0.0,) * rest])
    state, opening = ca.SX.sym("state", begin.numel()), ca.SX.sym("opening")
    front, following = mpc.front(tuple(ca.vertsplit(state)), readings, r, SYMBOLS)
    outputs = [
        ca.vcat(front.errors),
        ca.vertcat(front.bias, front.opening, front.plan),
        ca.vcat(following),
    ]
    z, course, next_front = (ca.SX.sym("given", output.numel()) for output in outputs)
    after = mpc.after(
        tuple(ca.vertsplit(state)),
        Front(tuple(ca.vertsplit(z)), *ca.vertsplit(course)),
        tuple(ca.vertsplit(next_front)),
        opening,
        SYMBOLS,
    )
    return (
        ca.Function(f"{name}_start_kernel", [m], [ca.densify(begin)]),
        ca.Function(f"{name}_front_kernel", [state, m, r], [ca.densify(y) for y in outputs]),
        ca.Function(
            f"{name}_after_kernel",
            [state, z, course, next_front, opening],
            [ca.densify(ca.vcat(after))],
        ),
    )


def _generated(source: str) -> str:
    """Mark generated code, whose functions ignore some of their arguments, for the compiler."""
    return (
        '#ifdef __GNUC__\n#pragma GCC diagnostic push\n#pragma GCC diagnostic ignored "-Wextra"\n'
        '#pragma GCC diagnostic ignored "-Wunused-parameter"\n#endif\n'
        f"{source}"
        "#ifdef __GNUC__\n#pragma GCC diagnostic pop\n#endif\n\n"
    )
