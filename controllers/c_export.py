"""A controller as C code: one source file without dependencies, and a header that explains it.

A law in closed form is traced once with CasADi symbols from the same text that runs on floats, and
written as two functions, one that starts and one that steps. There is no allocation and no loop
without end. A law in closed form has no memory beyond the state that the caller owns, and its step
takes the same time always; a model-predictive controller brings its own solver with it
(`controllers.quadratic_program`), whose iterations are bounded, and reports slack and status.

The compiler must not fuse multiplications and additions (``-ffp-contract=off``) if the numbers
shall be those of the simulation to the last digits.

Source: code generation of Andersson et al., CasADi: a software framework for nonlinear optimization
and optimal control, Math. Programming Computation 11, 2019; solver: Goldfarb and Idnani,
Mathematical Programming 27, 1983.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import casadi as ca

from controllers.arithmetic import SYMBOLS
from controllers.named_state import flat, names, restored
from controllers.protocol import Controller
from workbench.errors import WorkbenchError
from workbench.files import write_whole

UNITS = {"angle": "rad", "pressure_1": "Pa, gauge", "pressure_2": "Pa, gauge", "valve": "V"}
"""Units of known signals, for the header."""


@dataclass(frozen=True)
class ExportedC:
    """The files of an exported controller.

    Args:
        source: C source file.
        header: Header that documents the interface.
        states: Number of states (dimensionless).
        operations: Number of elementary operations of a step, at most (dimensionless).
    """

    source: Path
    header: Path
    states: int
    operations: int

    def __str__(self) -> str:
        """Return one line."""
        return (
            f"{self.source} and {self.header.name}: {self.states} states, at most"
            f" {self.operations} operations per step"
        )


class CSource(NamedTuple):
    """A controller written as C, without the header.

    Args:
        source: C source with ``NAME_start`` and ``NAME_step``, without the header's inclusion.
        states: Names of the entries of the state.
        notes: Lines for the header.
        reports: Entries of the report; without any the step has no such argument.
        operations: Most elementary operations of a step (dimensionless).
    """

    source: str
    states: tuple[str, ...]
    notes: tuple[str, ...]
    reports: tuple[str, ...]
    operations: int


def export_c(controller: Controller, folder: str | Path, *, name: str = "controller") -> ExportedC:
    """Write a controller as C source and header.

    A controller that can be written says how: its method ``c_source(name)`` returns a `CSource`.

    Raises:
        WorkbenchError: If the name is no C identifier, the controller needs a library at each
            step, or a file cannot be written.

    Example:
        >>> import tempfile
        >>> from controllers.pid import cascade_pid
        >>> with tempfile.TemporaryDirectory() as place:
        ...     export_c(cascade_pid(6e5, 2e6, 1e5, inner=2e-6), place, name="pid").states
        7
    """
    if not re.fullmatch(r"[a-z][a-z0-9_]*", name):
        raise WorkbenchError(
            f"name of the exported controller is {name!r}; give small letters, digits and"
            " underscores, beginning with a letter, such as 'pid'"
        )
    write = getattr(controller, "c_source", None)
    if write is None:
        reason = getattr(controller, "not_in_c", "it was not written for symbols")
        raise WorkbenchError(
            f"controller {controller.name!r} cannot be written as C without dependencies: {reason};"
            " export one of the PID, sliding-mode, state-feedback or linear MPC family"
        )
    found: CSource = write(name)
    target = Path(folder)
    header = write_whole(target / f"{name}.h", _header(controller, name, found))
    source = write_whole(target / f"{name}.c", f'#include "{name}.h"\n\n{found.source}')
    return ExportedC(source, header, len(found.states), found.operations)


def closed_form(controller: Any, name: str) -> CSource:
    """Write a law in closed form as C: traced once with symbols, from its own text."""
    m = ca.SX.sym("measurement", len(controller.sensors))
    r = ca.SX.sym("reference", len(controller.controlled) * (1 + controller.preview))
    measured = tuple(ca.vertsplit(m))
    begin = controller.initial_state(measured, SYMBOLS)
    entries = flat(begin)
    z = ca.SX.sym("state", len(entries))
    state = restored(begin, ca.vertsplit(z))
    command, following, _ = controller.law(state, measured, tuple(ca.vertsplit(r)), SYMBOLS)
    start = ca.Function(f"{name}_start_kernel", [m], [ca.densify(ca.vcat(entries))])
    step = ca.Function(
        f"{name}_step_kernel",
        [z, m, r],
        [ca.densify(ca.vcat(command)), ca.densify(ca.vcat(flat(following)))],
    )
    source = generated(name, start, step) + _wrappers(name, start, step, len(entries))
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


_STATELESS = ("Status: always 0. There is no other memory than the state, which the caller owns.",)


def _header(controller: Controller, name: str, found: CSource) -> str:
    states, notes, reports = found.states, found.notes, found.reports
    guard = f"{name.upper()}_H"
    indent = " " * (len(name) + 10)
    references = len(controller.controlled) * (1 + controller.preview)

    def listed(title: str, entries: tuple[str, ...]) -> list[str]:
        return [f" * {title}:"] + [
            f" *   [{i}] {entry}" + (f", {UNITS[entry]}" if entry in UNITS else "")
            for i, entry in enumerate(entries)
        ]

    wanted = tuple(
        f"wanted {output}" + (f" in {k} samples" if k else " now") + f", {UNITS.get(output, 'SI')}"
        for k in range(min(2, 1 + controller.preview))
        for output in controller.controlled
    )
    if controller.preview > 1:
        wanted = (*wanted, f"and so on up to {controller.preview} samples ahead")
    lines = [
        "/*",
        f" * {controller.name}: sampled control law, one step every {controller.sample_time:g} s.",
        " *",
        f" * All numbers are in SI units. Call {name}_start once with the first measurements, then",
        f" * {name}_step every sample: it reads the measurement and the reference, writes the",
        " * command and replaces the state. The command is to be held until the next sample.",
        f" * {name}_start returns 0, {name}_step a status.",
        " * Compile with -ffp-contract=off, never with -ffast-math, to get the numbers of the",
        " * simulation.",
        " *",
        *(f" * {line}" for line in notes),
        " *",
        *listed("measurement", controller.sensors),
        *listed("reference", wanted),
        *listed("command", controller.actuators),
        *listed("state", states),
        *(listed("report", reports) if reports else ()),
        " */",
        f"#ifndef {guard}",
        f"#define {guard}",
        "",
        "#ifdef __cplusplus",
        'extern "C" {',
        "#endif",
        "",
        f"#define {name.upper()}_MEASUREMENTS {len(controller.sensors)}",
        f"#define {name.upper()}_REFERENCES {references}",
        f"#define {name.upper()}_COMMANDS {len(controller.actuators)}",
        f"#define {name.upper()}_STATES {len(states)}",
        *([f"#define {name.upper()}_REPORTS {len(reports)}"] if reports else ()),
        f"#define {name.upper()}_SAMPLE_TIME {controller.sample_time!r} /* s */",
        "",
        f"int {name}_start(const double *measurement, double *state);",
        f"int {name}_step(const double *measurement, const double *reference, double *state,",
        f"{indent}double *command{', double *report' if reports else ''});",
        "",
        "#ifdef __cplusplus",
        "}",
        "#endif",
        "",
        f"#endif /* {guard} */",
        "",
    ]
    return "\n".join(lines)


def _wrappers(name: str, start: ca.Function, step: ca.Function, states: int) -> str:
    return f"""
int {name}_start(const double *measurement, double *state) {{
  const double *arg[{max(start.sz_arg(), 1)}] = {{measurement}};
  double *res[{max(start.sz_res(), 1)}] = {{state}};
  long long int iw[{max(start.sz_iw(), 1)}];
  double w[{max(start.sz_w(), 1)}];
  return {name}_start_kernel(arg, res, iw, w, 0);
}}

int {name}_step(const double *measurement, const double *reference, double *state,
{" " * (len(name) + 10)}double *command) {{
  double next[{states}];
  const double *arg[{max(step.sz_arg(), 3)}] = {{state, measurement, reference}};
  double *res[{max(step.sz_res(), 2)}] = {{command, next}};
  long long int iw[{max(step.sz_iw(), 1)}];
  double w[{max(step.sz_w(), 1)}];
  int i, status = {name}_step_kernel(arg, res, iw, w, 0);
  for (i = 0; i < {states}; ++i) state[i] = next[i];
  return status;
}}
"""
