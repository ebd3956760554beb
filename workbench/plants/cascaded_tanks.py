"""Cascaded tanks: a pump fills an upper tank, which drains into a lower one, which drains out.

M. Schoukens, P. Mattsson, T. Wigren, J.-P. Noel, Cascaded tanks benchmark combining soft and hard
nonlinearities, 2016 Workshop on Nonlinear System Identification Benchmarks, Brussels.
"""

from __future__ import annotations

from workbench.model import About, Effect, Input, Model, Output, Parameter, PortView, Scope, State
from workbench.model.regularisation import Expression, sqrt
from workbench.model.trace import Equations
from workbench.plants.plant import Plant

FULL = 10.0
"""Level at which flows are stated, and near which the tanks overflow, in V of the sensor."""


def _equations(m: Scope) -> Equations:
    levels = {"upper_level": m.x.upper_level, "lower_level": m.x.lower_level}

    def flow(
        name: str, value: Expression, what: str = "", disturbance: float = 0.0, **more: Expression
    ) -> Expression:
        return m.port(
            name,
            value,
            unit="V/s",
            scale=0.1,
            signals=levels | more,
            description=what,
            disturbance=disturbance,
        )

    def outflow(tank: str) -> Expression:
        rate, bend = m.p[f"{tank}_drain"], m.p[f"{tank}_bend"]
        share = m.form.ramp(levels[f"{tank}_level"], 0.01) / FULL
        value = rate * ((1 - bend) * sqrt(share) + bend * share)
        return flow(f"{tank}.outflow", value, f"level that the {tank} tank loses", 0.01)

    inflow = flow(
        "upper.inflow", m.p.pump_gain * m.u.pump, "level that the pump adds to the upper tank", 0.01
    )
    drained = outflow("upper")
    spilled = flow("upper.overflow", 0.0 * inflow)
    gained = flow(
        "lower.inflow",
        m.p.ratio * drained,
        "level that the lower tank gains",
        0.005,
        spilled=spilled,
    )
    left = outflow("lower")
    level = m.port("level.reading", FULL - m.form.ramp(FULL - m.x.lower_level, 0.01), unit="V")
    return (
        {"upper_level": inflow - drained - spilled, "lower_level": gained - left},
        {"level": level},
    )


def overflow() -> Effect:
    """Build the overflow of both tanks; part of the upper one's falls into the lower tank.

    Above its rim a tank spills ``weir (level - rim)``; ``caught`` of what the upper tank spills
    reaches the lower one.
    """

    def transform(at: PortView) -> Expression:
        s = at.signals
        if at.port == "upper.overflow":
            return at.value + at.p.weir * at.form.ramp(s.upper_level - at.p.rim, 0.01)
        if at.port == "lower.inflow":
            return at.value + at.p.caught * s.spilled
        return at.value + at.p.weir * at.form.ramp(s.lower_level - FULL, 0.01)

    return Effect(
        "overflow",
        ("upper.overflow", "lower.inflow", "lower.outflow"),
        transform,
        parameters=(
            Parameter("rim", "V", 1.0, "level at which the upper tank spills", 15.0, 5.0, 30.0,
                      fitted=True),
            Parameter("caught", "1", 0.5, "share of the spill that the lower tank catches", 0.5,
                      0.0, 1.5, fitted=True),
            Parameter("weir", "1/s", 0.2, "rate at which a level above the rim falls", 0.2, 0.01,
                      1.0, fitted=True),
        ),
        about=About("spill = weir (level - rim)", "linear weir"),
    )  # fmt: skip


def cascaded_tanks() -> Model:
    """Build the cascaded tanks, with overflow.

    ``x1' = a u - q1 - spill``, ``x2' = r q1 - q2 + caught spill``; outflows q follow Torricelli,
    ``q = drain ((1 - bend) sqrt(x / 10) + bend x / 10)`` with a part that is proportional to the
    level, for what pipe and sensor add. Levels are in V of the sensor of the lower tank, the only
    one that is read; the level of the upper tank at the start is unknown.

    Returns:
        Model with the input ``pump`` (V), the output ``level`` (V) and a port at every flow.
    """
    return Model(
        "cascaded tanks",
        _equations,
        states=(
            State("upper_level", "V", 5.0, "level of the upper tank", 7.0, 0.0, start_rms=8.0),
            State("lower_level", "V", 5.0, "level of the lower tank", 5.0, 0.0, start_rms=3.0),
        ),
        inputs=(Input("pump", "V", 3.0, nominal=3.0, lower=0.0, upper=20.0),),
        outputs=(Output("level", "V", 5.0, noise_rms=0.03, upper=FULL),),
        parameters=(
            Parameter("pump_gain", "1/s", 0.0, "level rate of the upper tank over pump voltage",
                      0.04, 0.005, 0.2, fitted=True),
            *(Parameter(f"{tank}_drain", "V/s", 0.0, f"outflow of the {tank} tank at 10 V",
                        0.15, 0.02, 0.6, fitted=True) for tank in ("upper", "lower")),
            *(Parameter(f"{tank}_bend", "1", 0.1,
                        f"part of the {tank} outflow that is proportional to the level",
                        0.0, -0.9, 0.9, fitted=True) for tank in ("upper", "lower")),
            Parameter("ratio", "1", 0.0, "area of the upper tank over that of the lower one",
                      1.0, 0.5, 2.0),
        ),
        description="a pump, two tanks under each other, free outflow",
    ).with_effect(overflow())  # fmt: skip


CASCADED_TANKS = Plant(
    "tanks", cascaded_tanks, "a pump and two tanks under each other", step=(5.0, 7.0)
)
