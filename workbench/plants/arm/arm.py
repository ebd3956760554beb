"""The antagonistic arm: one servovalve or one valve per muscle, two muscles, one joint, sensors.

A single 5/3 valve fills one muscle while it vents the other: it commands the difference of the
pressures, and their mean drifts with the leaks. With two, each muscle has a valve of the same type
of its own, used as a 3/2 valve with its second outlet plugged: a positive spool fills the muscle, a
negative one vents it; angle and stiffness are then controlled together.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Literal

from workbench.model import Effect, Model, Output, Scope
from workbench.model.regularisation import Expression
from workbench.model.trace import Equations
from workbench.physics.force_laws import ForceLaw, PaperLaw, Petrovic, Sarosi, TonduLopez
from workbench.physics.hysteresis import muscle_hysteresis
from workbench.physics.leakage import centre_leakage
from workbench.physics.muscle_volume import BraidedCylinder
from workbench.physics.supply import line, silencer
from workbench.plants.arm.geometry import ArmGeometry
from workbench.plants.arm.joint import (
    MAXIMUM_LOAD,
    ArmBody,
    Plane,
    damper_and_bearing,
    gravity,
    joint,
)
from workbench.plants.arm.joint import PARAMETERS as JOINT_PARAMETERS
from workbench.plants.arm.joint import STATES as JOINT_STATES
from workbench.plants.arm.laws import heat_exchange, printed_volume
from workbench.plants.arm.muscle import PARAMETERS as MUSCLE_PARAMETERS
from workbench.plants.arm.muscle import (
    MuscleLaws,
    muscle,
    muscle_laws,
    muscle_states,
    pressure_sensor,
)
from workbench.plants.arm.opening import ONE_VALVE, TWO_VALVES
from workbench.plants.arm.servovalve import (
    COMMAND,
    LINEAR,
    MPYE,
    Edges,
    ValveCurve,
    metered_flows,
    one_valve,
    spool_position,
)
from workbench.plants.arm.servovalve import PARAMETERS as VALVE_PARAMETERS
from workbench.plants.arm.servovalve import STATES as VALVE_STATES
from workbench.plants.plant import Option, Plant

Variant = Literal["corrected", "as_printed"]
FORCE_LAWS: dict[str, ForceLaw] = {
    "paper": PaperLaw(),
    "petrovic": Petrovic(),
    "tondu_lopez": TonduLopez(),
    "tondu_lopez_k": TonduLopez.constant_k(),
    "tondu_lopez_kp": TonduLopez.pressure_dependent_k(),
    "sarosi": Sarosi(),
}
"""Equations (4), (3), (1), (2) with constant and with pressure-dependent k, and Sarosi's law."""

# Name, default, unit, help, bounds.
LOAD = Option("load", 3.0, "kg", "mass of the plates on the arm", 0.0, MAXIMUM_LOAD,
              keyword="load_kg", measured=True)  # fmt: skip
PLANE = Option("plane", "horizontal", help="plane of the motion; horizontal knows no weight",
               choices=("horizontal", "vertical"), measured=True)  # fmt: skip
SUPPLY = Option("supply", 6.0, "bar", "supply pressure, gauge", 2.0, 10.0, keyword="supply_bar",
                label="supply pressure", measured=True)  # fmt: skip
VARIANT = Option("variant", "corrected", choices=("corrected", "as_printed"),
                 help="as_printed undoes every correction of the paper's equations")  # fmt: skip
FORCE_LAW = Option(
    "force_law", "paper", help="static force of the muscles", choices=tuple(FORCE_LAWS)
)
VALVE_CURVE = Option(
    "valve_curve", "mpye", help="opening over spool voltage", choices=("mpye", "linear")
)
SILENCERS = Option("silencers", False, help="the exhausts blow through silencers")
LINE_VOLUMES = Option(
    "line_volumes", False, help="the tubes to the muscles have volume and resistance"
)

COUNTS_PER_TURN = 180_000

OUTPUTS = (
    Output("angle", "rad", 1.0, "encoder, 180000 counts per turn", 2 * math.pi / COUNTS_PER_TURN,
           display_unit="deg"),
    pressure_sensor("_1", " of muscle 1"),
    pressure_sensor("_2", " of muscle 2"),
    Output("load_cell", "N", 100.0, "load cell on the lower stop", 0.5, 0.5, 0.0, 5000.0),
)  # fmt: skip


@dataclass(frozen=True)
class ArmEquations:
    """The fixed choices of an arm, kept together so that its equations can be pickled."""

    laws: MuscleLaws
    geometry: ArmGeometry
    body: ArmBody
    curve: ValveCurve
    spools: Callable[[Scope], tuple[Edges, dict[str, Expression]]] = one_valve

    def __call__(self, m: Scope) -> Equations:
        x = m.x
        edges, spools = self.spools(m)
        flows = metered_flows(
            m,
            edges=edges,
            pressures=(x.pressure_1, x.pressure_2),
            temperatures=(x.temperature_1, x.temperature_2),
            curve=self.curve,
        )
        lengths = self.geometry.fibre_lengths(x.angle)
        muscles = [
            muscle(
                m,
                f"_{i}",
                fibre_length=lengths[i - 1],
                coordinate=x.angle,
                coordinate_speed=x.speed,
                flow=flow,
                laws=self.laws,
            )
            for i, flow in enumerate(flows, 1)
        ]
        (force_1, gauge_1, gas_1), (force_2, gauge_2, gas_2) = muscles
        motion, load_cell = joint(
            m, forces=(force_1, force_2), geometry=self.geometry, body=self.body
        )
        outputs = {
            q.name: m.port(
                f"{q.name}.reading",
                value,
                unit=q.unit,
                scale=q.scale,
                description="what the sensor reads, before noise and conversion",
                signals={"speed": x.speed} if q.name == "angle" else {},
            )
            for q, value in zip(OUTPUTS, (x.angle, gauge_1, gauge_2, load_cell), strict=True)
        }
        return {**spools, **gas_1, **gas_2, **motion}, outputs


def arm(
    load_kg: float = 0.0,
    *,
    plane: Plane = "horizontal",
    supply_bar: float = 6.0,
    variant: Variant = "corrected",
    force_law: str = "paper",
    valve_curve: Literal["mpye", "linear"] = "mpye",
    silencers: bool = False,
    line_volumes: bool = False,
) -> Model:
    """Build the antagonistic arm of the paper.

    The term phi(q), the flattened ends, heat exchange, leakage, damper, bearing friction, gravity,
    silencers and lines are effects: ``without("bearing_friction")`` takes one away.

    Args:
        load_kg: Mass of the plates, 0 to 8 kg.
        plane: Plane of the motion, ``"horizontal"`` (no weight) or ``"vertical"``.
        supply_bar: Supply pressure, 2 to 10 bar gauge.
        variant: ``"corrected"``, or ``"as_printed"`` with every misprint of the paper's equations
            undone, for the record.
        force_law: ``"paper"`` is equation (4), ``"petrovic"`` (3), ``"tondu_lopez"`` (1),
            ``"tondu_lopez_k"`` and ``"tondu_lopez_kp"`` (2) with constant and pressure-dependent
            k, ``"sarosi"`` Sarosi's law.
        valve_curve: ``"mpye"``, the manufacturer's soft-overlap curve, or ``"linear"``.
        silencers: Whether the exhausts blow through silencers.
        line_volumes: Whether the tubes between valve and muscles have volume and resistance.

    Returns:
        Model with the input ``valve`` (V) and the outputs ``angle`` (rad), ``pressure_1``,
        ``pressure_2`` (Pa, gauge) and ``load_cell`` (N).

    Example:
        >>> plant = arm(load_kg=3)
        >>> plant.read(plant.initial_state(), [5.0]).round(3).tolist()
        [0.524, 300000.0, 300000.0, 0.0]
    """
    load, supply = LOAD.check(load_kg), SUPPLY.check(supply_bar)
    for option, word in (
        (PLANE, plane),
        (VARIANT, variant),
        (FORCE_LAW, force_law),
        (VALVE_CURVE, valve_curve),
    ):
        option.check(word)
    return _built(load, plane, supply, variant, force_law, valve_curve, silencers, line_volumes)


@lru_cache(maxsize=16)
def _built(
    load: float,
    plane: Plane,
    supply: float,
    variant: Variant,
    force_law: str,
    valve_curve: str,
    silencers: bool,
    line_volumes: bool,
) -> Model:
    """Build the arm of checked options; its equations are written down once per process."""
    printed = variant == "as_printed"
    law = PaperLaw.variant(variant) if force_law == "paper" else FORCE_LAWS[force_law]
    laws, law_effects = muscle_laws(
        law, BraidedCylinder(printing=variant), printed_work_sign=printed
    )
    effects: list[Effect] = [
        *law_effects,
        heat_exchange(coefficient=200.0 if printed else 150.0, lower=40.0, upper=250.0),
        centre_leakage(),
    ]
    if plane == "vertical":
        effects.append(gravity())
    effects += damper_and_bearing()
    if line_volumes:
        effects += [
            line([(f"line_{i}.pressure", f"chamber_{i}.flow")], name=f"line_{i}") for i in (1, 2)
        ]
    if silencers:
        effects += [silencer(f"exhaust_{i}.pressure", name=f"silencer_{i}") for i in (1, 2)]
    parameters = (*JOINT_PARAMETERS, *MUSCLE_PARAMETERS, *VALVE_PARAMETERS)
    values = {"load": load, "supply_pressure": supply * 1e5}
    return Model(
        "arm",
        ArmEquations(
            laws,
            ArmGeometry(printing=variant),
            ArmBody(),
            MPYE if valve_curve == "mpye" else LINEAR,
        ),
        states=(
            *VALVE_STATES,
            *muscle_states("_1"),
            *muscle_states("_2"),
            *JOINT_STATES,
        ),
        inputs=(COMMAND,),
        outputs=OUTPUTS,
        parameters=tuple(
            replace(q, value=values[q.name]) if q.name in values else q for q in parameters
        ),
        description=f"antagonistic pneumatic-muscle arm, {load:g} kg, {plane} plane, {variant}",
        traits=ONE_VALVE,
    ).with_effect(*effects)


ARM = Plant(
    "arm",
    arm,
    "antagonistic pneumatic-muscle arm with one servovalve",
    options=(LOAD, PLANE, SUPPLY, VARIANT, FORCE_LAW, VALVE_CURVE, SILENCERS, LINE_VOLUMES),
    controlled=("angle",),
    design_point={"angle": math.radians(30.0)},
    design_map={
        "angle": tuple(math.radians(1.0 + 58.0 * i / 12) for i in range(13)),
        "mean_pressure": (2.8e5, 3.6e5),
    },
    effects={"hysteresis": muscle_hysteresis, "printed_volume": printed_volume},
    tolerated={"load": (-2.0, 2.0), "supply_pressure": (-1.5e5, 1.0e5)},
    step=(math.radians(15.0), math.radians(45.0)),
    # Half a second at 500 Hz, over which temperatures show.
    start_samples=251,
    tolerant="tolerant",
    requirements=(
        ("settling_time", 0.8, "s"),
        ("overshoot", 10.0, "%"),
        ("steady_error", 0.3, "deg"),
        ("oscillation", 0.1, "deg"),
        ("stop_impacts", 0.0, ""),
    ),
)


MEAN_PRESSURE = Output(
    "mean_pressure", "Pa", 1e5, "mean of the two gauge pressure sensors, which sets the stiffness",
    noise_rms=600.0 / 2**0.5, display_unit="bar",
)  # fmt: skip


def two_valves(m: Scope) -> tuple[Edges, dict[str, Expression]]:
    """Write down the spools of one valve per muscle, which are both of the valve's parameters.

    Args:
        m: Scope with the inputs ``valve_1`` and ``valve_2`` and the states ``spool_1``,
            ``spool_speed_1``, ``spool_2``, ``spool_speed_2``.

    Returns:
        Edges, in V, and the rates of the states by name, in SI per second.
    """
    (first, rates_1), (second, rates_2) = (spool_position(m, f"_{number}") for number in (1, 2))
    return ((first, first), (second, second)), rates_1 | rates_2


@dataclass(frozen=True)
class _Plant:
    """The arm's equations with the mean pressure as one more measurement."""

    equations: ArmEquations

    def __call__(self, m: Scope) -> Equations:
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
    spools = tuple(replace(q, name=f"{q.name}_{i}") for i in (1, 2) for q in VALVE_STATES)
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
        equations=_Plant(replace(base.equations, spools=two_valves)),
        states=(*spools, *base.states[len(VALVE_STATES) :]),
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
