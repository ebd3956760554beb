"""A term without a name as a Python file: a law of the user's own, ready for ``--effects``."""

from __future__ import annotations

import json
import math

from workbench.diagnosis.nonparametric.result import (
    EFFECT_NAME,
    Argument,
    Likeness,
    NonparametricTerm,
)
from workbench.diagnosis.nonparametric.shapes import SHAPES, Shape, level_unit
from workbench.errors import WorkbenchError

NAME = "found"
"""Name of the law in the file."""


def law_file(term: NonparametricTerm, plant: str) -> str:
    """Write an accepted term as a module with the law `NAME`, for ``--effects module:found``.

    The law stands for the shape of the library that is likelier than the curve, with its own
    parameters; else for the curve, with an amount that is 1 as it was found. At size zero it is
    absent. It acts at the ports at which it was found.

    Raises:
        WorkbenchError: If the term was not accepted.
    """
    if not term.accepted or not term.curves:
        raise WorkbenchError(
            f"the term without a name was not accepted ({term.reason}); there is no law to write"
        )
    alike = term.likeness
    shape = next((s for s in SHAPES if alike is not None and s.name == alike.law), None)
    body = _curve(term) if shape is None or alike is None else _shape(term, shape, alike)
    hull = " and ".join(
        f"{a.name} from {a.hull[0]:.4g} to {a.hull[1]:.4g} {a.unit}" for a in term.arguments
    )
    likely = "".join(
        f"\n    {k.law or 'the curve itself':<32} {k.gain:.1f}, less its penalty {k.penalised:.1f}"
        for k in term.likenesses
    )
    compared = (
        "\n\nLog likelihood that it gains, beside shapes of the library in its place:\n" + likely
        if likely
        else ""
    )
    return f'''"""What {plant} lacks at {", ".join(term.ports)}, as recordings showed it.

Empirical: valid for {hull}.{compared}
"""

{body}'''


def _where(term: NonparametricTerm) -> str:
    ports = ", ".join(json.dumps(port) for port in term.ports)
    return f"""PORTS = ({ports},)


def where(survey):
    if set(PORTS) <= {{place.name for place in survey.places}}:
        yield "", tuple((survey.place(port),) for port in PORTS)
"""


def _shape(term: NonparametricTerm, shape: Shape, alike: Likeness) -> str:
    argument = term.arguments[0]
    value = abs(alike.values["size"])
    formula = f"size (g(x) - level), g = {shape.formula.replace('at.p.', '').replace('ca.', '')}"
    inner = "".join(
        _own(name, unit, alike.values[name], argument)
        for name, unit in {
            "level": level_unit(shape, argument),
            **shape.units(argument.unit),
        }.items()
    )
    imported = "import casadi as ca\n\n" if "ca." in shape.formula else ""
    changed = _changed(term, f"at.p.size * ({shape.formula} - at.p.level)")
    over = argument.name.replace("_", " ")
    return f"""{imported}from workbench.physics.law import Law, shape, size

{_where(term)}

def parameters(at):
    # As found: size {alike.values["size"]:.6g}.
    return (
        size(
            "size",
            {json.dumps(shape.unit(term.unit, argument.unit))},
            typical={value:.6g},
            largest={20 * value:.6g},
            text="size of what is missing",
            signed=True,
        ),{inner}
    )


def transform(at):
    x = at.signals.{argument.name}
    return {changed}


{_law(term, f"{formula}, x the {over}")}"""


def _changed(term: NonparametricTerm, added: str) -> str:
    return f"at.value * (1 + {added})" if term.relative else f"at.value + {added}"


def _law(term: NonparametricTerm, formula: str, more: str = "") -> str:
    return f'''{NAME} = Law(
    "{NAME}",
    "{formula}",
    where,
    parameters,
    transform,{more}
    source="recordings of {", ".join(term.ports)}",
)
'''


def _own(name: str, unit: str, value: float, argument: Argument) -> str:
    low, high = argument.hull
    span = high - low
    ends = {
        "width": (0.05 * abs(value), 20 * abs(value)),
        "centre": (low - span, high + span),
        "frequency": (0.05 * abs(value), 20 * abs(value)),
        "phase": (-7.0, 7.0),
    }.get(name, (-20 * abs(value) - 1.0, 20 * abs(value) + 1.0))
    words = f"{name} of the shape"
    return f"""
        shape(
            {json.dumps(name)},
            {json.dumps(unit)},
            {value:.6g},
            {json.dumps(words)},
            around=None,
            between=({ends[0]:.6g}, {ends[1]:.6g}),
            scale={abs(value) or 1.0:.6g},
        ),"""


def _curve(term: NonparametricTerm) -> str:
    parts, sums, arguments = [], [], []
    fit = term.fit.refit
    for argument, curve in term.curves.items():
        ordinates = [fit.estimate(f"{EFFECT_NAME}.{short}").value for short in curve.names]
        given = [json.dumps(argument), json.dumps(curve.unit), _numbers(curve.knots)]
        given += [f"mean={_numbers(curve.mean)}"] if curve.mean else []
        lines = "".join(f"    {value},\n" for value in given)
        parts.append(
            f"{argument.upper()} = Curve(\n{lines})\n"
            f"{argument.upper()}_ORDINATES = {_numbers(ordinates)}\n"
        )
        sums.append(
            f"{argument.upper()}.value(at.signals.{argument}, {argument.upper()}_ORDINATES)"
        )
        arguments.append(argument.replace("_", " "))
    memory = ""
    states = ""
    imported = (
        "from workbench.physics.nonparametric_term import Curve\n"
        "from workbench.physics.law import Law, size\n"
    )
    if term.law is not None and term.law.loop is not None:
        rate = term.law.loop[0]
        half, distance = (fit.estimate(f"{EFFECT_NAME}.{n}").value for n in ("loop", "distance"))
        sums.append(f"{half:.6g} * at.x.memory")
        memory = f"""

def rates(e):
    v = e.here.signals.{rate}
    return {{"memory": (v - maximum(v, -v) * e.x.memory) / {distance:.6g}}}
"""
        states = """
    states=lambda at: (State("memory", "1", 1.0, "where the loop is", start_rms=0.5),),
    rates=rates,"""
        imported = (
            "from workbench.model import State\n"
            "from workbench.model.regularisation import maximum\n" + imported
        )
        arguments.append("history")
    total = "\n        + ".join(sums)
    formula = f"amount times a curve over {', '.join(arguments)}"
    return f"""{imported}
{_where(term)}

{"".join(parts)}

def parameters(at):
    # As found: amount 1.
    return (
        size("amount", "1", typical=1.0, largest=20.0, text="how much of it is there"),
    )


def transform(at):
    added = (
        {total}
    )
    return {_changed(term, "at.p.amount * added")}
{memory}

{_law(term, formula, states)}"""


def _numbers(values: object) -> str:
    listed = [float(v) for v in values]  # type: ignore[attr-defined]
    if not all(map(math.isfinite, listed)):
        raise WorkbenchError(f"a curve has the numbers {listed}; they must be finite")
    return f"({', '.join(f'{v:.10g}' for v in listed)})"
