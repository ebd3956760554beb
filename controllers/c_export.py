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

import math
import re
from collections.abc import Mapping
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any

import numpy as np

from controllers.c_source import CSource, defined, table
from controllers.guard import COUNTS, FADE, TIMES, WIDER, Fault, Guarded
from controllers.named_state import names
from controllers.protocol import Controller, check_controller
from workbench.errors import WorkbenchError
from workbench.files import write_whole
from workbench.model import Model
from workbench.model.quantities import told_units


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


_WORD_OF_C = re.compile(
    "auto|break|case|char|const|continue|default|do|double|else|enum|extern|float|for|"
    "goto|if|inline|int|long|main|register|restrict|return|short|signed|sizeof|static|"
    "struct|switch|typedef|union|unsigned|void|volatile|while"
)


def export_c(
    controller: Controller,
    folder: str | Path,
    *,
    name: str = "controller",
    units: Mapping[str, str] | Model | None = None,
) -> ExportedC:
    """Write a controller as C source and header, inside its guard.

    A controller that can be written says how: its method ``c_source(name)`` returns a `CSource`.
    One without a guard gets that of `Guard`, which needs no limits: no number that is not finite
    reaches the law or the command.

    Args:
        units: The plant, or units of sensors, controlled outputs and commands by name, for the
            header; by default those that the guard was given.
    """
    if not re.fullmatch(r"[a-z][a-z0-9_]*", name) or _WORD_OF_C.fullmatch(name):
        raise WorkbenchError(
            f"name of the exported controller is {name!r}; give small letters, digits and"
            " underscores, beginning with a letter, such as 'pid', and no word of C"
        )
    check_controller(controller)
    guarded = controller if isinstance(controller, Guarded) else Guarded(controller)
    if not hasattr(guarded.controller, "c_source"):
        reason = getattr(guarded.controller, "not_in_c", "it was not written for symbols")
        raise WorkbenchError(
            f"controller {controller.name!r} cannot be written as C without dependencies: {reason};"
            " export one of the PID, sliding-mode, state-feedback or linear MPC family"
        )
    found = _guarded_source(guarded, name)
    target = Path(folder)
    told = (
        told_units((*units.outputs, *units.inputs))
        if isinstance(units, Model)
        else units or guarded.units
    )
    header = write_whole(target / f"{name}.h", _header(controller, name, found, told))
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
        " * All numbers are in the units below, those of the SI where none is said.",
        f" * Call {name}_start once with the first measurements, then",
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


def _guarded_source(guarded: Guarded, name: str) -> CSource:
    """Write a law in its guard as C."""
    inner, guard, own = f"{name}_law", guarded.guard, guarded.guard.estimator
    found: CSource = guarded.controller.c_source(inner)  # type: ignore[attr-defined]
    n, y = 0 if own is None else len(own.F), len(guarded.sensors)
    references = len(guarded.controlled) * (1 + guarded.preview)
    sizes = {
        "SENSORS": y,
        "CONTROLLED": len(guarded.controlled),
        "REFERENCES": references,
        "COMMANDS": len(guarded.actuators),
        "REPORTS": len(found.reports),
        "LAW_STATES": len(found.states),
        "ESTIMATED": n,
        "CURVE": 0 if own is None else np.size(own.curve_entered) // len(guarded.actuators),
        "HAS_INNER": int(own is not None and len(own.K) > 0),
        "WIDER": WIDER,
        "FADE": FADE,
        **{name.upper(): getattr(guard, name) for name in (*TIMES, *COUNTS)},
        **{fault.name: int(fault) for fault in Fault},
    }
    kinds: Any = {"SENSOR": guard.sensors, "REFERENCE": guard.references, "COMMAND": guard.commands}
    tables: dict[str, Any] = {
        f"{prefix}_{field.upper()}": column
        for prefix, limits in kinds.items()
        for field, column in zip(limits[0]._fields, zip(*limits, strict=True), strict=True)
    }
    if own is None:
        # Limits that only an estimator looks at.
        for field in ("DOUBT", "LEAST", "MOST"):
            del tables[f"SENSOR_{field}"]
        del tables["REFERENCE_BRAKE"], tables["REFERENCE_LAG"]
    else:
        unused = () if len(own.K) else ("K", "K_reference", "rest_followed")
        tables |= {
            field.name.upper(): getattr(own, field.name)
            for field in fields(own)
            if np.size(getattr(own, field.name)) and field.name not in unused
        }
    report, parameter = ("report", ", double *report") if found.reports else ("0", "")
    last = ", report" if found.reports else ""
    macros = {f"GUARD_{key}": "INFINITY" if v == math.inf else v for key, v in sizes.items()} | {
        "GUARD_LAW_START(measurement, state)": f"{inner}_start(measurement, state)",
        "GUARD_LAW_STEP(measurement, reference, state, command, report)": (
            f"{inner}_step(measurement, reference, state, command{last})"
        ),
    }
    text = (
        found.source
        + "".join(map(defined, macros, macros.values()))
        + "\n"
        + "".join(table(f"GUARD_{key}", values) for key, values in tables.items())
        + "\n"
        + Path(__file__).with_name("guard.c").read_text(encoding="utf-8")
        + f"""
int {name}_start(const double *measurement, double *state) {{
  return guard_start_(measurement, state);
}}

int {name}_step(const double *measurement, const double *reference, double *state,
{" " * (len(name) + 10)}double *command{parameter}) {{
  return guard_step_(measurement, reference, state, command, {report});
}}

int {name}_missed(double *state, double *command) {{
  return guard_missed_(state, command);
}}
"""
    )
    safe = ", ".join(f"{value:g}" for value in guarded.safe)
    endless = "any time" if guard.patience == math.inf else f"{guard.patience:g} samples"
    bridge = f"{guard.bridge if own is not None else 0:g}"
    rest = f"{guard.inner if sizes['HAS_INNER'] else 0:g}"
    notes = (
        *found.notes,
        f"Guard: the law acts on estimates for at most {bridge} samples, and a command is held",
        f"for {guard.hold:g}; then the inner law brings the plant to rest for {rest}, then the"
        " safe",
        f"command is given: {safe}. The law returns after {guard.settle:g} plausible samples,"
        " its reference",
        f"along a quintic of {guard.ramp:g} more. A command at its end, or an error that stays:"
        f" {endless}.",
    )
    operations = found.operations + 40 * (y + references) + 2 * n * (n + 4 * y + 4)
    states = names(guarded.initial_state((0.0,) * y))
    return CSource(text, states, notes, found.reports, int(operations))
