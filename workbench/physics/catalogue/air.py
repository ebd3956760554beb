"""Entries for air: leaks, lines, silencers, supply and the heat of the gas."""

from __future__ import annotations

from collections.abc import Iterator

from workbench.model import Model
from workbench.physics.heat_exchange import heat_exchange
from workbench.physics.hypothesis import Hypothesis
from workbench.physics.isothermal import gas_energy_balance, isothermal_gas
from workbench.physics.leakage import chamber_leakage, cross_leakage
from workbench.physics.line import line, silencer
from workbench.physics.polytropic import extra_heat_exchange, polytropic_exchange
from workbench.physics.shared import shared
from workbench.physics.supply import regulator_droop, reservoir_droop, supply_droop

_GAS_SIGNALS = {"pressure", "temperature", "ambient_pressure", "ambient_temperature"}


def entries(model: Model) -> Iterator[Hypothesis]:
    """Yield what chambers, lines and supply of air may lack.

    Args:
        model: The model; chambers are the ports ``chamber*.flow`` and ``chamber*.heat``.

    Example:
        >>> from workbench.plants.arm import arm
        >>> [entry.name for entry in entries(arm())][:3]
        ['chamber_leakage_1', 'chamber_leakage_2', 'cross_leakage']
    """
    ports = {q.name: q for q in model.ports}
    chambers = tuple(
        name
        for name, q in ports.items()
        if name.endswith(".flow") and set(q.signals) >= _GAS_SIGNALS
    )
    for name in chambers:
        number = name.split(".")[0].rpartition("_")[2]
        yield Hypothesis(
            chamber_leakage(name, conductance=0.0, name=f"chamber_leakage_{number}"),
            "conductance",
            5e-11,
            5e-12,
            law="chamber_leakage",
        )
    if len(chambers) == 2:
        yield Hypothesis(
            cross_leakage((chambers[0], chambers[1]), conductance=0.0),
            "conductance",
            5e-11,
            5e-12,
        )
    yield from _lines(ports.keys())
    if "supply.pressure" in ports and "supply.flow" in model.exact.signal_names:
        yield Hypothesis(
            supply_droop(share=0.0),
            "share",
            1.0,
            0.5,
            shapes=({"conductance": 1e-8}, {"conductance": 3e-9}),
        )
        yield Hypothesis(
            reservoir_droop(share=0.0),
            "share",
            1.0,
            0.5,
            shapes=({"gain": 5e-9}, {"gain": 3e-8}),
        )
        yield Hypothesis(
            regulator_droop(resistance=0.0),
            "resistance",
            1e7,
            5e5,
            shapes=({"time_constant": 0.05}, {"time_constant": 0.5}),
        )
    yield from _heat(model)


def _lines(names: object) -> Iterator[Hypothesis]:
    ports = set(names)  # type: ignore[call-overload]
    numbers = (1, 2)
    tubes = [i for i in numbers if {f"line_{i}.pressure", f"chamber_{i}.flow"} <= ports]
    exhausts = [i for i in numbers if f"exhaust_{i}.pressure" in ports]
    conductances = ({"conductance": 1.5e-8}, {"conductance": 4e-8})
    backs = ({"conductance": 1e-8}, {"conductance": 6e-8})
    for i in tubes:
        effect = line(i, share=0.0)
        yield Hypothesis(
            effect, "share", 1.0, 0.5, law="line", shapes=conductances, stiff=True, far=True
        )
    if len(tubes) == 2:
        both = shared(tuple(line(i, share=0.0) for i in numbers), name="lines")
        yield Hypothesis(
            both, "share", 1.0, 0.5, law="line", shapes=conductances, stiff=True, far=True
        )
    for i in exhausts:
        effect = silencer(i, share=0.0)
        yield Hypothesis(effect, "share", 1.0, 0.5, law="silencer", shapes=backs, stiff=True)
    if len(exhausts) == 2:
        both = shared(tuple(silencer(i, share=0.0) for i in numbers), name="silencers")
        yield Hypothesis(both, "share", 1.0, 0.5, law="silencer", shapes=backs, stiff=True)


def _heat(model: Model) -> Iterator[Hypothesis]:
    heats = tuple(
        q.name
        for q in model.ports
        if q.name.endswith(".heat") and {"temperature", "wall_temperature"} <= set(q.signals)
    )
    if not heats:
        return
    constant = isothermal_gas().about.equation
    if any(effect.about.equation == constant for effect in model.effects):
        # Heat flow that follows from constant temperature has no more or less of it.
        yield Hypothesis(gas_energy_balance(heats, share=0.0), "share", 1.0, 0.5)
        return
    attached = [e for e in model.effects if e.about.equation == heat_exchange().about.equation]
    if attached:
        nominal = attached[0].parameters[0].value
        yield Hypothesis(
            extra_heat_exchange(heats, coefficient=0.0, lower=-nominal),
            "coefficient",
            200.0,
            50.0,
        )
    else:
        yield Hypothesis(heat_exchange(heats, coefficient=0.0), "coefficient", 150.0, 20.0)
    signals = {"pressure", "enthalpy_flow", "volume_rate"}
    if all(signals <= set(q.signals) for q in model.ports if q.name in heats):
        yield Hypothesis(
            polytropic_exchange(heats, departure=0.0), "departure", 0.2, 0.03, far=True
        )
