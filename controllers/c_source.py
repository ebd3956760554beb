"""Controllers as C text: tables of numbers, and laws in closed form traced from their own text.

A law in closed form is traced once with CasADi symbols from the same text that runs on floats.

Source: code generation of Andersson et al., CasADi: a software framework for nonlinear optimization
and optimal control, Math. Programming Computation 11, 2019.
"""

from __future__ import annotations

import textwrap
from typing import Any, NamedTuple

import casadi as ca
import numpy as np
import numpy.typing as npt

from controllers.arithmetic import SYMBOLS
from controllers.named_state import flat, names, restored


class CSource(NamedTuple):
    """A controller written as C, without the header.

    Args:
        source: C source with ``NAME_start`` and ``NAME_step``, static, for the guard to call.
        reports: Entries of the report; without any the step has no such argument.
        operations: Most elementary operations of a step (dimensionless).
    """

    source: str
    states: tuple[str, ...]
    notes: tuple[str, ...]
    reports: tuple[str, ...]
    operations: int


class Traced(NamedTuple):
    """A law in closed form on CasADi symbols, in SI.

    Args:
        measurement: What is measured, in SI.
        reference: References, in SI.
        entries: Entries of the state, in SI.
        begin: State in which it starts, by the measurement.
        command: Commands, in SI.
        following: Entries of the next state, in SI.
        told: What is told about the step, by name.
    """

    measurement: ca.SX
    reference: ca.SX
    entries: ca.SX
    begin: Any
    command: ca.SX
    following: ca.SX
    told: dict[str, Any]


def traced(controller: Any) -> Traced:
    """Trace a law once with symbols, from its own text."""
    m = ca.SX.sym("measurement", len(controller.sensors))
    r = ca.SX.sym("reference", len(controller.controlled) * (1 + controller.preview))
    measured = tuple(ca.vertsplit(m))
    begin = controller.initial_state(measured, SYMBOLS)
    z = ca.SX.sym("state", len(flat(begin)))
    state = restored(begin, ca.vertsplit(z))
    command, after, told = controller.law(state, measured, tuple(ca.vertsplit(r)), SYMBOLS)
    asked, following = (ca.densify(ca.vcat(numbers)) for numbers in (command, flat(after)))
    return Traced(m, r, z, begin, asked, following, told)


def closed_form(controller: Any, name: str) -> CSource:
    """Write a law in closed form as C: traced once with symbols, from its own text."""
    m, r, z, begin, command, following, _ = traced(controller)
    start = ca.Function(f"{name}_start_kernel", [m], [ca.densify(ca.vcat(flat(begin)))])
    step = ca.Function(f"{name}_step_kernel", [z, m, r], [command, following])
    source = generated(name, start, step) + _wrappers(name, start, step, z.numel())
    return CSource(source, names(begin), _STATELESS, (), int(step.n_instructions()))


def generated(name: str, *functions: ca.Function) -> str:
    """Return what CasADi writes for some functions, which ignore some of their arguments."""
    generator = ca.CodeGenerator(f"{name}.c", {"with_header": False})
    for function in functions:
        generator.add(function)
    return (
        '#ifdef __GNUC__\n#pragma GCC diagnostic push\n#pragma GCC diagnostic ignored "-Wextra"\n'
        '#pragma GCC diagnostic ignored "-Wunused-parameter"\n#endif\n'
        f"{generator.dump()}"
        "#ifdef __GNUC__\n#pragma GCC diagnostic pop\n#endif\n\n"
    )


def table(name: str, values: npt.ArrayLike) -> str:
    """Write numbers, in SI, as a constant array by rows, each with the digits that restore it."""
    words = [
        repr(v) if np.isfinite(v) else ("INFINITY" if v > 0 else "-INFINITY")
        for v in np.ravel(np.asarray(values, dtype=float)).tolist()
    ]
    lines = textwrap.fill(
        ", ".join(words), 99, initial_indent="  ", subsequent_indent="  ", break_on_hyphens=False
    )
    return f"\nstatic const double {name}[{len(words)}] = {{\n{lines}\n}};\n"


def defined(name: str, value: float | int | str) -> str:
    """Write a number, in SI, or a word as a macro."""
    # In brackets: a negative number may stand after a minus.
    text = value if isinstance(value, str) else f"({value!r})" if value < 0 else repr(value)
    return f"\n#define {name} {text}"


_STATELESS = (
    "Status of the law: always 0. There is no other memory than the state, the caller's own.",
)


def _wrappers(name: str, start: ca.Function, step: ca.Function, states: int) -> str:
    return f"""
static int {name}_start(const double *measurement, double *state) {{
  double first[{max(states, 1)}];
  const double *arg[{max(start.sz_arg(), 1)}] = {{measurement}};
  double *res[{max(start.sz_res(), 1)}] = {{first}};
  long long int iw[{max(start.sz_iw(), 1)}];
  double w[{max(start.sz_w(), 1)}];
  int i, status = {name}_start_kernel(arg, res, iw, w, 0);
  for (i = 0; i < {states}; ++i) state[i] = first[i];
  return status;
}}

static int {name}_step(const double *measurement, const double *reference, double *state,
{" " * (len(name) + 17)}double *command) {{
  double next[{max(states, 1)}];
  const double *arg[{max(step.sz_arg(), 3)}] = {{state, measurement, reference}};
  double *res[{max(step.sz_res(), 2)}] = {{command, next}};
  long long int iw[{max(step.sz_iw(), 1)}];
  double w[{max(step.sz_w(), 1)}];
  int i, status = {name}_step_kernel(arg, res, iw, w, 0);
  for (i = 0; i < {states}; ++i) state[i] = next[i];
  return status;
}}
"""
