"""What the model-predictive controllers have in common, and their text as C.

The steps in ``whole_model.c`` and ``along_plan.c`` are those of the laws in Python line by line,
with sums in the same order (`workbench.arrays`); sizes and numbers are defined before
them. The solver is that of `controllers.quadratic_program`.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from controllers.c_source import CSource, table
from controllers.c_source import defined as macro
from controllers.quadratic_program.solver import most_iterations, solver_bytes, solver_source
from controllers.valve_inverse import ValveInverse
from workbench.arrays import Matrix

REPORTS = (
    "slack: largest limited output out of its limits over the horizon, in the unit of these;"
    " NaN with a fallback",
    "iterations of the solver",
    "fallback: 1 where the solver failed, else 0",
)
"""What a step of an exported MPC tells about itself, behind its openings."""


def mpc_source(
    name: str,
    step: str,
    *,
    curves: Sequence[ValveInverse],
    actuators: Sequence[str],
    size: tuple[int, int],
    factor: bool,
    defined: Mapping[str, float | int | str],
    tables: Mapping[str, Matrix],
    states: tuple[str, ...],
    generated: str = "",
    work: int,
    prepared: int,
) -> CSource:
    """Put a model-predictive controller together as C.

    Args:
        step: Name of the file beside this one that has its step.
        size: Numbers of variables and of rows of the quadratic program.
        defined: Sizes and numbers of the step, by name, in SI.
        tables: Tables of the step, by name, in SI.
        work: Numbers of static memory beside the solver's.
        prepared: Multiplications of a step without active constraints.
    """
    n, m = size
    limit = most_iterations(n, m)
    # Curves of as many points, above and below: the last one again where one has fewer.
    sides = [side for own in curves for side in own.sides]
    most = max(len(points) for points, _ in sides)
    curve = {
        key: np.array([(*points, *points[-1:] * (most - len(points))) for points in values])
        for key, values in (
            ("FRACTION", [fractions for _, fractions in sides]),
            ("VOLTAGE", [voltages for voltages, _ in sides]),
        )
    } | {"VALVE_CENTRE": np.array([own.centre for own in curves])}
    numbers = {
        "VALVE_LAST": most - 1,
        "OPENINGS": len(curves),
        "ROWS_A": m,
        **defined,
    }
    source = (
        generated
        + solver_source(n, n + m, limit=limit, factor=factor)
        + "".join(macro(key, value) for key, value in numbers.items())
        + "\n"
        + "".join(table(key, value) for key, value in (curve | dict(tables)).items())
        + "\n"
        + _text("openings.c")
        + "\n"
        + _text(step)
        + f"""
static int {name}_start(const double *measurement, double *state) {{
  return mpc_start_(measurement, state);
}}

static int {name}_step(const double *measurement, const double *reference, double *state,
{" " * (len(name) + 17)}double *command, double *report) {{
  return mpc_step_(measurement, reference, state, command, report);
}}
"""
    )
    static = solver_bytes(n, n + m, factor=factor) + 8 * work
    constants = 8 * sum(np.size(value) for value in tables.values())
    # An iteration that lets go the first of n active rows.
    iteration = (n + m) * n + 7 * n * n + 5 * n**3
    notes = (
        f"Each step solves a quadratic program with {n} variables (the moves, and one slack), {m}",
        f"constraints and {n} bounds by a dual active-set method. An opening is a command as a",
        "fraction of its full range, by the inverse of its curve.",
        "Status of the law: 0 solved, 1 given up after too many iterations, 2 constraints that",
        "contradict each other, 3 a number that is not finite.",
        f"At most {limit} iterations; {prepared} multiplications without active constraints, at",
        f"most {iteration} more per iteration. A step takes longer where constraints",
        "are met: measure it on the target with large steps of the reference.",
        f"Memory: {static} bytes static, {constants} bytes of constants. The static memory holds",
        "nothing from step to step, but two steps must not run at the same time.",
        "Fallback where the status is not 0: the unconstrained regulator, clipped to the ends of",
        "the commands.",
    )
    several = len(curves) > 1
    applied = tuple(
        f"opening{f' of {own}' if several else ''} applied, a fraction of the full one"
        for own in actuators
    )
    return CSource(source, states, notes, (*applied, *REPORTS), prepared + limit * iteration)


def _text(name: str) -> str:
    return Path(__file__).with_name(name).read_text(encoding="utf-8")
