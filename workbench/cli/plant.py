"""The plant that the options of a verb describe."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Annotated, cast

import typer

from workbench.errors import WorkbenchError, check_choice
from workbench.model import Model
from workbench.model.units import quantity, to_si

Load = Annotated[
    str, typer.Option(help="Mass of the plates on the arm, 0 to 8 kg.", metavar="MASS")
]
Plane = Annotated[
    str, typer.Option(help="Plane of the motion: horizontal (no weight) or vertical.")
]
Supply = Annotated[
    str, typer.Option(help="Supply pressure, gauge, 2 to 10 bar.", metavar="PRESSURE")
]
Parameters = Annotated[
    list[str] | None,
    typer.Option(
        "--parameter",
        "-p",
        help="Change a parameter, such as valve_conductance=2.7e-8 or supply_pressure=5.5bar; "
        "may be given several times.",
        metavar="NAME=VALUE",
    ),
]
Without = Annotated[
    list[str] | None,
    typer.Option(
        help="Leave out an effect, such as bearing_friction; may be given several times.",
        metavar="EFFECT",
    ),
]
Hysteresis = Annotated[
    bool,
    typer.Option(
        "--hysteresis", help="Add hysteresis to both muscles: 10 N and 7 N per bar, half width."
    ),
]


def plant_from_options(
    load: str,
    plane: str,
    supply: str,
    *,
    parameters: Sequence[str] = (),
    without: Sequence[str] = (),
    hysteresis: bool = False,
) -> Model:
    """Build the arm that the options of a verb describe.

    Args:
        load: Mass of the plates, such as ``3`` or ``3kg``.
        plane: Plane of the motion.
        supply: Supply pressure, gauge, such as ``6bar``.
        parameters: Changed parameters as ``NAME=VALUE``, the value with or without its unit.
        without: Effects to leave out.
        hysteresis: Whether both muscles have hysteresis.

    Returns:
        The arm.

    Raises:
        WorkbenchError: If a value is unknown, outside its range or in a wrong unit.

    Example:
        >>> plant_from_options("3kg", "horizontal", "6", parameters=["dead_volume=12cm3"]).name
        'arm'
    """
    from workbench.plants.arm import arm
    from workbench.plants.arm.inertia import Plane as PlaneName

    model = arm(
        quantity("load", load, "kg"),
        plane=cast(PlaneName, plane),
        supply_bar=quantity("supply pressure", supply, "bar"),
    )
    if hysteresis:
        from workbench.physics.hysteresis import bouc_wen_hysteresis

        model = model.with_effect(bouc_wen_hysteresis())
    model = model.without(*without)
    return model.with_parameters(dict(_parameter(model, text) for text in parameters))


def _parameter(model: Model, text: str) -> tuple[str, float]:
    name, sign, value = text.partition("=")
    name = name.strip()
    if not sign:
        raise WorkbenchError(f"parameter {text!r} has no value; write it as NAME=VALUE")
    known = {q.name: q for q in model.parameters}
    check_choice("parameter", name, known)
    unit = known[name].unit
    return name, to_si(quantity(f"parameter {name}", value, unit), unit)
