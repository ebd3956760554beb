"""A controller as C code: one source file without dependencies, and a header that explains it.

A law in closed form is traced once with CasADi symbols from the same text that runs on floats, and
written as two functions, one that starts and one that steps. There is no allocation and no loop
without end. A law in closed form has no memory beyond the state that the caller owns, and its step
takes the same time always; a model-predictive controller brings its own solver with it
(`quadratic_program_c`), whose iterations are bounded, and reports slack and status.

The compiler must not fuse multiplications and additions (``-ffp-contract=off``) if the numbers
shall be those of the simulation to the last digits.

Source: code generation of Andersson et al., CasADi: a software framework for nonlinear optimization
and optimal control, Math. Programming Computation 11, 2019; solver: Goldfarb and Idnani,
Mathematical Programming 27, 1983.
"""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import casadi as ca

from controllers.arithmetic import SYMBOLS
from controllers.mpc.along_plan import ScheduledMPC
from controllers.mpc.along_plan_c import scheduled_mpc_parts
from controllers.mpc.whole_model import LinearMPC
from controllers.mpc.whole_model_c import linear_mpc_parts
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

    Example:
        >>> list(ExportedC.__dataclass_fields__)[0]
        'source'
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


def export_c(controller: Controller, folder: str | Path, *, name: str = "controller") -> ExportedC:
    """Write a controller as C source and header.

    Args:
        controller: A controller whose law is written for symbols, or a linear MPC.
        folder: Where to write ``NAME.c`` and ``NAME.h``.
        name: Name of the files and prefix of the functions, a C identifier.

    Returns:
        The files.

    Raises:
        WorkbenchError: If the name is no C identifier, the controller needs a library at each
            step, or a file cannot be written.

    Example:
        >>> import tempfile
        >>> from controllers.pid import CascadePID
        >>> with tempfile.TemporaryDirectory() as place:
        ...     export_c(CascadePID(6e5, 2e6, 1e5, inner=2e-6), place, name="pid").states
        6
    """
    if not re.fullmatch(r"[a-z][a-z0-9_]*", name):
        raise WorkbenchError(
            f"name of the exported controller is {name!r}; give small letters, digits and"
            " underscores, beginning with a letter, such as 'pid'"
        )
    target = Path(folder)
    if isinstance(controller, LinearMPC | ScheduledMPC):
        parts = (
            linear_mpc_parts(controller, name)
            if isinstance(controller, LinearMPC)
            else scheduled_mpc_parts(controller, name)
        )
        states, operations = len(parts.states), parts.operations
        header = _header(controller, name, parts.states, notes=parts.notes, reports=parts.reports)
        text = f'#include "{name}.h"\n\n{parts.source}'
    else:
        labels, text, operations = _traced(controller, name)
        states, header = len(labels), _header(controller, name, labels, notes=_STATELESS)
    written = write_whole(target / f"{name}.h", header)
    return ExportedC(write_whole(target / f"{name}.c", text), written, states, operations)


def _traced(controller: Controller, name: str) -> tuple[tuple[str, ...], str, int]:
    """Return the state's names, the source and the operations of a law in closed form."""
    law: Callable[..., Any] | None = getattr(controller, "law", None)
    if law is None:
        raise WorkbenchError(
            f"controller {controller.name!r} cannot be written as C without dependencies:"
            f" {_reason(controller)}; export one of the PID, sliding-mode, state-feedback or linear"
            " MPC family"
        )
    m = ca.SX.sym("measurement", len(controller.sensors))
    r = ca.SX.sym("reference", len(controller.follows) * (1 + controller.preview))
    readings = tuple(ca.vertsplit(m))
    try:
        begin = controller.initial_state(readings, SYMBOLS)  # type: ignore[call-arg]
    except TypeError:
        begin = controller.initial_state(readings)
    kind = type(begin)
    z = ca.SX.sym("state", len(begin))
    entries = ca.vertsplit(z)
    packed = kind(*entries) if hasattr(kind, "_fields") else tuple(entries)
    command, following, _ = law(packed, readings, tuple(ca.vertsplit(r)), SYMBOLS)
    start = ca.Function(f"{name}_start_kernel", [m], [ca.densify(ca.vcat(begin))])
    step = ca.Function(
        f"{name}_step_kernel",
        [z, m, r],
        [ca.densify(ca.vcat(command)), ca.densify(ca.vcat(following))],
    )
    generator = ca.CodeGenerator(f"{name}.c", {"with_header": False})
    generator.add(start)
    generator.add(step)
    names = getattr(controller, "state_names", None) or getattr(kind, "_fields", None)
    labels = tuple(names) if names else tuple(f"state_{i}" for i in range(len(begin)))
    source = generator.dump() + _wrappers(name, start, step, len(begin))
    return labels, source, int(step.n_instructions())


_STATELESS = ("Status: always 0. There is no other memory than the state, which the caller owns.",)


def _reason(controller: Controller) -> str:
    """Say why a controller has no law that can be traced."""
    if hasattr(controller, "shots"):
        return (
            "its prediction is a nonlinear model whose stages and derivatives are integrated by"
            " CasADi at each step"
        )
    return "it was not written for symbols"


def _header(
    controller: Controller,
    name: str,
    states: tuple[str, ...],
    *,
    notes: tuple[str, ...],
    reports: tuple[str, ...] = (),
) -> str:
    guard = f"{name.upper()}_H"
    indent = " " * (len(name) + 10)
    references = len(controller.follows) * (1 + controller.preview)

    def listed(title: str, entries: tuple[str, ...]) -> list[str]:
        return [f" * {title}:"] + [
            f" *   [{i}] {entry}" + (f", {UNITS[entry]}" if entry in UNITS else "")
            for i, entry in enumerate(entries)
        ]

    wanted = tuple(
        f"wanted {output}" + (f" in {k} samples" if k else " now") + f", {UNITS.get(output, 'SI')}"
        for k in range(min(2, 1 + controller.preview))
        for output in controller.follows
    )
    if controller.preview > 1:
        wanted = (*wanted, f"and so on up to {controller.preview} samples ahead")
    lines = [
        "/*",
        f" * {controller.name}: sampled control law, one step every {controller.sample_time:g} s.",
        " *",
        f" * All numbers are in SI units. Call {name}_start once with the first readings, then",
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
#include "{name}.h"

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
