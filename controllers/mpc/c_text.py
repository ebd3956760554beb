"""What the model-predictive controllers have in common as C.

The text of a step is that of `LinearMPC.step` and `ScheduledMPC.step` line by line, with sums in
the same order (`controllers.mpc.fixed_order`), and the solver is that of `quadratic_program_c`.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from controllers.valve_inverse import ValveInverse

REPORTS = (
    "opening applied, a fraction of the full one",
    "slack: largest pressure out of its limits over the horizon, Pa; NaN with a fallback",
    "iterations of the solver",
    "fallback: 1 where the solver failed, else 0",
)
"""What a step of an exported MPC tells about itself."""


class Parts(NamedTuple):
    """What `export_c` needs of a controller that is written by hand.

    Args:
        source: C source, without the header's inclusion.
        states: Names of the entries of the state.
        notes: Lines for the header.
        reports: Entries of the report.
        operations: Most multiplications of a step (dimensionless).
    """

    source: str
    states: tuple[str, ...]
    notes: tuple[str, ...]
    reports: tuple[str, ...]
    operations: int


def per_iteration(n: int, m: int) -> int:
    """Return the multiplications of an iteration that lets go the first of n active rows.

    Args:
        n: Number of variables.
        m: Number of constraints.

    Example:
        >>> per_iteration(12, 91)
        10884
    """
    return (n + m) * n + 7 * n * n + 5 * n**3


def notes(n: int, m: int, limit: int, work: int, constants: int, prepared: int) -> tuple[str, ...]:
    """Return what the header says about solver, status, effort and memory.

    Args:
        n: Number of variables.
        m: Number of constraints.
        limit: Most iterations.
        work: Static memory, in bytes.
        constants: Constants, in bytes.
        prepared: Multiplications of a step without active constraints.

    Returns:
        Lines of text.

    Example:
        >>> notes(12, 91, 163, 9003, 28736, 3189)[0]
        'Each step solves a quadratic program with 12 variables (the moves of the opening and'
    """
    return (
        f"Each step solves a quadratic program with {n} variables (the moves of the opening and",
        f"one slack), {m} constraints and {n} bounds by a dual active-set method.",
        "Status: 0 solved, 1 given up after too many iterations, 2 constraints that contradict",
        "each other, 3 a number that is not finite.",
        f"At most {limit} iterations; {prepared} multiplications without active constraints, at",
        f"most {per_iteration(n, m)} more per iteration. A step takes longer where constraints",
        "are met: measure it on the target with large steps of the reference.",
        f"Memory: {work} bytes static, {constants} bytes of constants. The static memory holds",
        "nothing from step to step, but two steps must not run at the same time.",
    )


def table(name: str, values: npt.NDArray[np.float64]) -> str:
    """Write numbers as a constant array, by rows, each with the digits that restore it.

    Args:
        name: Name of the array.
        values: The numbers, in any units.

    Example:
        >>> print(table("HALF", np.array([0.5])).strip())
        static const double HALF[1] = {
          0.5
        };
    """
    words = [
        repr(v) if np.isfinite(v) else ("INFINITY" if v > 0 else "-INFINITY")
        for v in np.ravel(values).tolist()
    ]
    lines, line = [], "  "
    for word in words:
        if len(line) + len(word) > 98:
            lines.append(line.rstrip())
            line = "  "
        line += word + ", "
    lines.append(line.rstrip(" ,"))
    return f"\nstatic const double {name}[{len(words)}] = {{\n" + "\n".join(lines) + "\n};\n"


def valve_curve(valve: ValveInverse) -> str:
    """Write the inverse valve curve, and what happens where a reading is no number.

    Args:
        valve: The curve.

    Returns:
        C source with ``voltage_for``, ``all_finite`` and ``shut``.

    Example:
        >>> "voltage_for(double opening)" in valve_curve(ValveInverse())
        True
    """
    last = len(valve.fractions) - 1
    return (
        table("FRACTION", np.array(valve.fractions))
        + table("VOLTAGE", np.array(valve.voltages))
        + f"""
/* The voltage that gives an opening, by straight lines between the points of the valve's curve. */
static double voltage_for(double opening) {{
  const double size = opening < 0.0 ? -opening : opening;
  double distance = VOLTAGE[{last}];
  int i = 1;
  if (size < FRACTION[{last}]) {{
    while (FRACTION[i] <= size) ++i;
    distance = VOLTAGE[i - 1] + (size - FRACTION[i - 1]) * (VOLTAGE[i] - VOLTAGE[i - 1]) /
                                    (FRACTION[i] - FRACTION[i - 1]);
  }}
  return {valve.centre!r} + (opening < 0.0 ? -distance : distance);
}}

static int all_finite(const double *values, int count) {{
  int i;
  for (i = 0; i < count; ++i)
    if (!isfinite(values[i])) return 0;
  return 1;
}}

/* What is done and reported where a reading or the reference is no number. */
static int shut(double opening, double *command, double *report) {{
  command[0] = voltage_for(opening);
  report[0] = opening;
  report[1] = NAN;
  report[2] = 0.0;
  report[3] = 1.0;
  return QP_NOT_FINITE;
}}
"""
    )


HELPERS = """
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
"""
"""Products in the order of `controllers.mpc.fixed_order`, and limits."""
