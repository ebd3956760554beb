"""The pneumatic muscle as a component: static force, gas volume, gas energy."""

from __future__ import annotations

from dataclasses import dataclass, replace

import casadi as ca

from workbench.model import About, Effect, Input, Model, Output, Parameter, Scope, State
from workbench.model.regularisation import Expression
from workbench.model.trace import Equations, Named
from workbench.physics.force_laws import CONTRACTIONS, ForceLaw, PaperLaw, Petrovic, slack
from workbench.physics.gas import chamber_rates, port_enthalpy_flow
from workbench.physics.muscle_volume import BraidedCylinder
from workbench.plants.arm.laws import VOLUME_PORTS, heat_exchange
from workbench.plants.arm.servovalve import PARAMETERS as VALVE_PARAMETERS

PARAMETERS = (
    # Name, unit, scale (0 for that of the value), meaning, value, bounds, source.
    Parameter("force_gain", "1", 0.0, "measured over nominal muscle force", 1.0, 0.85, 1.15,
              "nominal", fitted=True),
    Parameter("volume_gain", "1", 0.0, "actual over computed muscle volume", 1.0, 0.9, 1.25,
              "nominal", fixed=True),
    Parameter("dead_volume", "m3", 0.0, "volume of fittings and line", 15e-6, 5e-6, 30e-6,
              "estimate", fitted=True),
)  # fmt: skip

PORTS = {
    # Name without the muscle's number: unit, role, scale, meaning.
    "muscle.length": ("m", "muscle_length", 0.01, "length of the fibre"),
    "muscle.volume": ("m3", "muscle_volume", 1e-5, "volume inside the braid"),
    "muscle.tension": ("N", "muscle_tension", 100.0, "tension before the muscle goes slack"),
    "muscle.force": ("N", "muscle_force", 100.0, "pulling force on the lever"),
    "chamber.flow": ("kg/s", "gas_flow", 1e-3, "mass flow into the muscle"),
    "chamber.volume_rate": ("m3/s", "volume_rate", 1e-4, "rate of the gas volume"),
    "chamber.heat": ("W", "gas_heat", 10.0, "heat flow into the gas"),
}
"""Ports of a muscle."""

AMBIENT = tuple(q for q in VALVE_PARAMETERS if q.name.startswith("ambient"))


def muscle_states(suffix: str = "") -> tuple[State, State]:
    """Return the states of the gas of a muscle; `suffix` ends their names, such as ``"_1"``."""
    return (
        State(f"pressure{suffix}", "Pa", 1e5, "absolute pressure", 4.01325e5, 5e4, 1.2e6),
        State(f"temperature{suffix}", "K", 10.0, "gas temperature", 293.15, 150.0, 500.0, 2.0),
    )


def pressure_sensor(suffix: str = "", of: str = "") -> Output:
    """Return the gauge pressure sensor of a muscle; `suffix` ends its name."""
    text = f"gauge pressure sensor{of}, 12 bit on 10 bar"
    return Output(
        f"pressure{suffix}", "Pa", 1e5, text, 10e5 / 4096, 600.0, 0.0, 10e5, display_unit="bar"
    )


@dataclass(frozen=True)
class MuscleLaws:
    """Which laws a muscle follows, and whether the sign of the gas work is the printed one."""

    force: ForceLaw = PaperLaw()
    volume: BraidedCylinder = BraidedCylinder()
    printed_work_sign: bool = False


def muscle(
    m: Scope,
    suffix: str,
    *,
    fibre_length: Expression,
    coordinate: ca.SX,
    coordinate_speed: Expression,
    flow: Expression,
    laws: MuscleLaws,
) -> tuple[Expression, Expression, dict[str, Expression]]:
    """Write down the equations of one muscle.

    Args:
        m: Scope with the names of `muscle_states`, `PARAMETERS` and the ambient.
        fibre_length: Fibre length s, in m, as an expression in ``coordinate``.
        coordinate: Symbol of the state or input that the length depends on, in its SI unit (rad
            for the arm's angle, m for a length).
        coordinate_speed: Its rate, in that unit per second.
        flow: Mass flow from the valve, in kg/s.

    Returns:
        Pulling force, in N; pressure above ambient, in Pa; and the rates of the pressure, in Pa/s,
        and the temperature, in K/s, by name of the state.

    Source:
        The paper's Figure 3, lines [1] to [15], with the corrections of its misprints.
    """
    p = m.p
    pressure, temperature = m.x[f"pressure{suffix}"], m.x[f"temperature{suffix}"]
    ambient_pressure, ambient = p.ambient_pressure, p.ambient_temperature
    gauge = pressure - ambient_pressure

    def port(
        name: str, value: Expression, signals: Named | None = None, disturbance: float = 0.0
    ) -> Expression:
        unit, role, scale, meaning = PORTS[name]
        return m.port(
            name.replace(".", f"{suffix}."),
            value,
            unit=unit,
            role=role,
            scale=scale,
            description=meaning,
            signals=signals,
            disturbance=disturbance,
        )

    fibre_length = port("muscle.length", fibre_length)
    contraction = m.publish(
        f"muscle{suffix}.contraction",
        laws.volume.nominal_length - fibre_length,
        unit="m",
        lower=CONTRACTIONS[0],
        upper=CONTRACTIONS[1],
    )
    contraction_speed = ca.jtimes(contraction, coordinate, coordinate_speed)
    arriving = {
        "pressure": pressure,
        "gauge_pressure": gauge,
        "temperature": temperature,
        "ambient_pressure": ambient_pressure,
        "ambient_temperature": ambient,
    }
    flow = port("chamber.flow", flow, arriving, disturbance=3e-5)
    cylinder = laws.volume.cylinder_volume(fibre_length)
    braid = port("muscle.volume", cylinder, {"fibre_length": fibre_length})
    volume = m.publish(f"chamber{suffix}.volume", p.volume_gain * braid + p.dead_volume, unit="m3")
    local = {
        "contraction": contraction,
        "contraction_speed": contraction_speed,
        "gauge_pressure": gauge,
    }
    tension = port("muscle.tension", laws.force.tension(contraction, gauge, form=m.form), local)
    pull = p.force_gain * slack(tension)
    pulling = {"tension": pull, "contraction_speed": contraction_speed}
    force = port("muscle.force", pull, local | pulling)
    widening = ca.jtimes(volume, coordinate, coordinate_speed)
    volume_rate = port("chamber.volume_rate", widening, pulling | {"volume": volume})
    enthalpy_flow = port_enthalpy_flow(flow, ambient, temperature, form=m.form)
    of_gas = {
        "temperature": temperature,
        "wall_temperature": ambient,
        "gauge_pressure": gauge,
        "pressure": pressure,
        "enthalpy_flow": enthalpy_flow,
        "mass_flow": flow,
        "volume_rate": volume_rate,
    }
    heat = port("chamber.heat", 0.0, of_gas)
    rates = chamber_rates(
        pressure,
        temperature,
        volume,
        volume_rate,
        flow,
        enthalpy_flow,
        heat,
        printed_work_sign=laws.printed_work_sign,
    )
    names = (q.name for q in muscle_states(suffix))
    return force, gauge, dict(zip(names, rates, strict=True))


def muscle_laws(
    force_law: ForceLaw, volume: BraidedCylinder, *, printed_work_sign: bool = False
) -> tuple[MuscleLaws, tuple[Effect, ...]]:
    """Split the laws of a muscle into the base and the effects that can be left out.

    The term phi(q) of the paper's force law becomes the effect ``force_correction``, the flattening
    of the ends ``end_flattening``, each on the ports of both muscles.
    """
    effects = [end_flattening(volume)]
    base = force_law
    if isinstance(force_law, PaperLaw) and force_law.reference_pressure == 0.0:
        base = Petrovic(force_law.gain_bar_mm)
        effects.insert(0, force_correction(force_law))
    return MuscleLaws(base, volume, printed_work_sign), tuple(effects)


def force_correction(paper: PaperLaw) -> Effect:
    """Build the pressure-independent term of the paper's force law, ``T = T + phi(q)``."""
    return Effect(
        "force_correction",
        ("muscle_1.tension", "muscle_2.tension"),
        lambda at: at.value + at.p.gain * paper.phi(at.signals.contraction, form=at.form),
        parameters=(
            Parameter("gain", "1", 0.0, "share of phi(q)", 1.0, 0.0, 2.0, "paper, equation (4)"),
        ),
        about=About("T + phi(q)", "equation (4) and line [1] of the paper's Figure 3"),
    )


def end_flattening(geometry: BraidedCylinder) -> Effect:
    """Build what flattened ends of height h take off the cylinder, ``V = V - (2 pi / 3) h^3``."""
    return Effect(
        "end_flattening",
        VOLUME_PORTS,
        lambda at: at.value + geometry.end_flattening(at.signals.fibre_length, form=at.form),
        about=About("V + dV_ends(s)", "lines [8] to [10] of the paper's Figure 3"),
    )


def pneumatic_muscle(force_law: ForceLaw | None = None) -> Model:
    """Build one muscle alone, with prescribed length and mass flow.

    Its static force follows the paper's equation (4) by default.

    Returns:
        Model with the inputs ``fibre_length`` (m), ``fibre_speed`` (m/s) and ``flow`` (kg/s), and
        the outputs ``force`` (N) and ``pressure`` (Pa, gauge).
    """
    laws, effects = muscle_laws(force_law or PaperLaw(), BraidedCylinder())

    def equations(m: Scope) -> Equations:
        force, gauge, rates = muscle(
            m,
            "",
            fibre_length=m.u.fibre_length,
            coordinate=m.u.fibre_length,
            coordinate_speed=m.u.fibre_speed,
            flow=m.u.flow,
            laws=laws,
        )
        return rates, {"force": force, "pressure": gauge}

    return Model(
        "pneumatic muscle",
        equations,
        states=muscle_states(),
        inputs=(
            Input("fibre_length", "m", 0.01, nominal=0.2, lower=0.165, upper=0.201),
            Input("fibre_speed", "m/s", 0.1),
            Input("flow", "kg/s", 1e-3),
        ),
        outputs=(
            Output("force", "N", 100.0, "load cell", resolution=0.5, noise_rms=0.5),
            pressure_sensor(),
        ),
        parameters=(*PARAMETERS, *AMBIENT),
        description="DMSP-20-200N",
    ).with_effect(
        *(replace(effect, ports=(effect.ports[0].replace("_1", ""),)) for effect in effects),
        heat_exchange(("chamber.heat",)),
    )
