"""The arm with one valve per muscle, on which angle and stiffness are controlled together.

A single 5/3 valve fills one muscle while it vents the other: it commands the difference of the
pressures, and their mean drifts with the leaks. Here each muscle has a valve of the same type of
its own, used as a 3/2 valve with its second outlet plugged: a positive spool fills the muscle, a
negative one vents it.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

from workbench.model import Model, Output, Scope
from workbench.model.regularisation import Expression
from workbench.model.trace import Equations
from workbench.physics.valve_curve import ValveCurve
from workbench.plants.arm.arm import (
    ARM,
    LINE_VOLUMES,
    LOAD,
    PLANE,
    SILENCERS,
    SUPPLY,
    ArmEquations,
    arm,
)
from workbench.plants.arm.joint import Plane
from workbench.plants.arm.opening import TWO_VALVES
from workbench.plants.arm.servovalve import (
    COMMAND,
    STATES,
    ValveFlows,
    metered_flows,
    spool_position,
)
from workbench.plants.plant import Plant

MEAN_PRESSURE = Output(
    "mean_pressure", "Pa", 1e5, "mean of the two gauge pressure sensors, which sets the stiffness",
    noise_rms=600.0 / 2**0.5, display_unit="bar",
)  # fmt: skip


def two_valves(
    m: Scope,
    *,
    pressures: tuple[Expression, Expression],
    temperatures: tuple[Expression, Expression],
    curve: ValveCurve,
) -> ValveFlows:
    """Write down the equations of one valve per muscle.

    Args:
        m: Scope with the inputs ``valve_1`` and ``valve_2``, the states ``spool_1``,
            ``spool_speed_1``, ``spool_2``, ``spool_speed_2`` and the valve's parameters, which are
            those of both valves.
        pressures: Absolute pressures in the lines to muscle 1 and 2, in Pa.
        temperatures: Temperatures of the gas in the lines, in K.

    Source:
        Manufacturer's flow curve and bandwidth.
    """
    spools = [spool_position(m, f"_{number}") for number in (1, 2)]
    (first, _), (second, _) = spools
    flows = metered_flows(
        m,
        edges=((first, first), (second, second)),
        pressures=pressures,
        temperatures=temperatures,
        curve=curve,
    )
    return ValveFlows(*flows, {name: rate for _, rates in spools for name, rate in rates.items()})


@dataclass(frozen=True)
class _Plant:
    """The arm's equations with the mean pressure as one more measurement."""

    equations: ArmEquations

    def __call__(self, m: Scope) -> Equations:
        """Write down the equations."""
        rates, outputs = self.equations(m)
        mean = 0.5 * (outputs["pressure_1"] + outputs["pressure_2"])
        return rates, {**outputs, MEAN_PRESSURE.name: mean}


def two_valve_arm(
    load_kg: float = 0.0,
    *,
    plane: Plane = "horizontal",
    supply_bar: float = 6.0,
    silencers: bool = False,
    line_volumes: bool = False,
) -> Model:
    """Build the arm with one valve per muscle.

    Everything but the valves is that of `arm`, and so are its arguments and the names of ports and
    effects.

    Returns:
        Model with the inputs ``valve_1`` and ``valve_2`` (V; above the centre fills) and the
        outputs of `arm` and ``mean_pressure`` (Pa, gauge).
    """
    base = arm(
        load_kg, plane=plane, supply_bar=supply_bar, silencers=silencers, line_volumes=line_volumes
    )
    assert isinstance(base.equations, ArmEquations)
    spools = tuple(replace(q, name=f"{q.name}_{i}") for i in (1, 2) for q in STATES)
    commands = tuple(
        replace(
            COMMAND,
            name=f"{COMMAND.name}_{i}",
            description=f"voltage of valve {i}; above the centre fills muscle {i}",
        )
        for i in (1, 2)
    )
    return replace(
        base,
        name="two-valve arm",
        equations=_Plant(replace(base.equations, valves=two_valves)),
        states=(*spools, *base.states[len(STATES) :]),
        inputs=commands,
        outputs=(*base.outputs, MEAN_PRESSURE),
        traits=TWO_VALVES,
        description=f"{base.description}, one valve per muscle",
    )


TWO_VALVE_ARM = Plant(
    "two-valve-arm",
    two_valve_arm,
    "the arm with one valve per muscle: angle and stiffness",
    options=(LOAD, PLANE, SUPPLY, SILENCERS, LINE_VOLUMES),
    controlled=("angle", "mean_pressure"),
    design_point={**ARM.design_point, "mean_pressure": 3e5},
    effects=ARM.effects,
    step=ARM.step,
)
