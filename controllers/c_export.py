"""A controller as C code: one source file without dependencies, and a header that explains it.

It is written as two functions, one that starts and one that steps, inside the guard of
`controllers.guard`. There is no allocation and no loop without end. A law in closed form has no
memory beyond the state that the caller owns, and its step takes the same time always; a
model-predictive controller brings its own solver with it (`controllers.quadratic_program`), whose
iterations are bounded, and reports slack and status.

The compiler must not fuse multiplications and additions (``-ffp-contract=off``) if the numbers
shall be those of the simulation to the last digits.

Source: code generation of Andersson et al., CasADi: a software framework for nonlinear optimization
and optimal control, Math. Programming Computation 11, 2019; solver: Goldfarb and Idnani,
Mathematical Programming 27, 1983.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from controllers.c_source import CSource
from controllers.guard import Fault, Guarded
from controllers.protocol import Controller, check_controller
from workbench.errors import WorkbenchError
from workbench.files import write_whole


@dataclass(frozen=True)
class ExportedC:
    """The files of an exported controller.

    Args:
        operations: Number of elementary operations of a step, at most (dimensionless).
    """

    source: Path
    header: Path
    states: int
    operations: int

    def __str__(self) -> str:
        return (
            f"{self.source} and {self.header.name}: {self.states} states, at most"
            f" {self.operations} operations per step"
        )


def export_c(
    controller: Controller,
    folder: str | Path,
    *,
    name: str = "controller",
    units: Mapping[str, str] | None = None,
) -> ExportedC:
    """Write a controller as C source and header, inside its guard.

    A controller that can be written says how: its method ``c_source(name)`` returns a `CSource`.
    One without a guard gets that of `Guard`, which needs no limits: no number that is not finite
    reaches the law or the command.

    Args:
        units: SI units of sensors, controlled outputs and commands by name, for the header.
    """
    if not re.fullmatch(r"[a-z][a-z0-9_]*", name):
        raise WorkbenchError(
            f"name of the exported controller is {name!r}; give small letters, digits and"
            " underscores, beginning with a letter, such as 'pid'"
        )
    check_controller(controller)
    guarded = controller if isinstance(controller, Guarded) else Guarded(controller)
    if not hasattr(guarded.controller, "c_source"):
        reason = getattr(guarded.controller, "not_in_c", "it was not written for symbols")
        raise WorkbenchError(
            f"controller {controller.name!r} cannot be written as C without dependencies: {reason};"
            " export one of the PID, sliding-mode, state-feedback or linear MPC family"
        )
    found = guarded.c_source(name)
    target = Path(folder)
    header = write_whole(target / f"{name}.h", _header(controller, name, found, units or {}))
    source = write_whole(target / f"{name}.c", f'#include "{name}.h"\n\n{found.source}')
    return ExportedC(source, header, len(found.states), found.operations)


def _header(controller: Controller, name: str, found: CSource, units: Mapping[str, str]) -> str:
    states, notes, reports = found.states, found.notes, found.reports
    guard = f"{name.upper()}_H"
    indent = " " * (len(name) + 10)
    references = len(controller.controlled) * (1 + controller.preview)

    def listed(title: str, entries: tuple[str, ...]) -> list[str]:
        return [f" * {title}:"] + [
            f" *   [{i}] {entry}" + (f", {units[entry]}" if entry in units else "")
            for i, entry in enumerate(entries)
        ]

    asked = tuple(
        f"{output}" + (f" in {k} samples" if k else " now") + f", {units.get(output, 'SI')}"
        for k in range(min(2, 1 + controller.preview))
        for output in controller.controlled
    )
    if controller.preview > 1:
        asked = (*asked, f"and so on up to {controller.preview} samples ahead")
    lines = [
        "/*",
        f" * {controller.name}: sampled control law, one step every {controller.sample_time:g} s.",
        " *",
        f" * All numbers are in SI units. Call {name}_start once with the first measurements, then",
        f" * {name}_step every sample: it reads the measurement and the reference, writes the",
        " * command and replaces the state. The command is to be held until the next sample.",
        f" * Where the deadline of a sample has passed without a command, {name}_missed gives one",
        " * in its place. All return a status, 0 where all is well.",
        " * Compile with -ffp-contract=off, never with -ffast-math, to get the numbers of the",
        " * simulation.",
        " *",
        *(f" * {line}" for line in notes),
        " *",
        " * Status: what the guard found times 16, plus the status of the law. The guard's:",
        *(f" *   {fault:>2} {fault.word}: {fault.meaning}" for fault in Fault),
        " *",
        *listed("measurement", controller.sensors),
        *listed("reference", asked),
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
        f"int {name}_missed(double *state, double *command);",
        "",
        "#ifdef __cplusplus",
        "}",
        "#endif",
        "",
        f"#endif /* {guard} */",
        "",
    ]
    return "\n".join(lines)
