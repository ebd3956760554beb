"""What tests of machines share: quantities in a word, a machine at rest, a step with a law."""

from __future__ import annotations

import re
from dataclasses import replace
from typing import Any

import casadi as ca

from workbench.linearisation import LinearModel, linearise
from workbench.model import Input, Model, Output, Parameter, Scope, State
from workbench.operating_point import operating_point
from workbench.verification import metrics, step_scenario, verify

_QUANTITY = re.compile(r"(\w+) (\S+(?: [A-Za-z][^ =]*)*)((?: \S+)*)")


def _told(kind: Any, text: str, *numbers: str) -> tuple[Any, ...]:
    """Return quantities, each told as ``name unit`` and its numbers, further ones ``name=1``."""
    found = []
    for each in filter(None, text.split(", ")):
        name, unit, rest = _QUANTITY.fullmatch(each).groups()  # type: ignore[union-attr]
        words = rest.split()
        named = dict(word.split("=") for word in words if "=" in word)
        named |= zip(numbers, (word for word in words if "=" not in word), strict=False)
        given = {key: v if key == "display_unit" else float(v) for key, v in named.items()}
        fitted = {"fitted": True} if kind is Parameter and "upper" in named else {}
        found.append(kind(name, unit, **given, **fitted))
    return tuple(found)


def machine(
    equations: Any,
    states: str,
    inputs: str,
    outputs: str,
    parameters: str = "",
    name: str = "machine",
    *,
    time: str = "",
) -> Model:
    """Return the model of a machine whose quantities are told as text.

    ``"speed m/s 2, angle rad"`` are two states, the first of which starts at 2. Behind an input
    stand its ends and what is usual, behind an output the rms of its noise, behind a parameter its
    value and, where a fit may change it, its bounds; whatever else is told by name, ``scale=10``.
    """

    return Model(
        name,
        equations,
        states=_told(State, states, "initial"),
        inputs=_told(Input, inputs, "lower", "upper", "nominal"),
        outputs=_told(Output, outputs, "noise_rms"),
        parameters=_told(Parameter, parameters, "value", "lower", "upper"),
        time=time,
    )


def clutch(radius: str, *, pressed: bool = True) -> Model:
    """An engine that drives a car through what rubs, pressed by a force or by its slip alone.

    Args:
        radius: Unit, value and bounds of the radius at which it rubs.
    """

    def equations(m: Scope) -> dict[str, Any]:
        slip = m.x.engine - m.x.car
        passed = m.p.radius * m.u.force * ca.tanh(slip / 2.0) if pressed else m.p.radius * slip
        return {"engine": (m.u.torque - passed) / 0.2, "car": passed / 2.0}

    return machine(
        equations,
        "engine rad/s 100, car rad/s 10",
        "torque N m 0 200, force N 0 3000",
        "engine rad/s, car rad/s",
        f"radius {radius}",
    )


def at_rest(model: Model, **at: float) -> LinearModel:
    """Return the linear model of a machine at rest, where some outputs or inputs have values."""
    return linearise(operating_point(model, at), verdict=False)


def stepped(
    law: Any, plant: Any, output: str, begin: float, end: float, late: int = 0, **told: Any
) -> dict[str, float]:
    """Return the metrics of a step, in SI, some samples late; see `step_scenario`."""
    step = step_scenario(output, begin, end, sample_time=law.sample_time, **told)
    step = replace(step, late_samples=late)
    return {name: found.value for name, found in metrics(verify(law, plant, step)).items()}


def conveyor() -> Model:
    """A belt that a drum drives by grip: what the parameter multiplies is a sum of two speeds."""

    def equations(m: Scope) -> dict[str, Any]:
        grip = m.p.grip * (0.5 * m.x.drum - m.x.belt)
        return {"drum": m.u.drive - grip, "belt": 0.1 * grip}

    return machine(
        equations, "drum rad/s, belt m/s", "drive rad/s2", "belt m/s", "grip 1/s 10 1 100"
    )
