"""Every entry of the library: absent at zero size, visible to derivatives there, well described."""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import replace
from functools import cache

import casadi as ca
import numpy as np
import pytest

from workbench.evaluation.machines.plants import tanks
from workbench.model import Model
from workbench.physics.gas import isothermal_gas
from workbench.physics.hypothesis import Hypothesis
from workbench.physics.library import LAWS, every_name, library, look_alikes
from workbench.physics.muscle_volume import flattened_ends
from workbench.physics.recorded_facts import RecordedFacts
from workbench.plants.arm import arm
from workbench.plants.arm.laws import constant_volume
from workbench.plants.cascaded_tanks import cascaded_tanks
from workbench.plants.servo_axis import servo_axis


def bare_arm() -> Model:
    """The arm without the effects that its nominal plant has."""
    return arm(3.0, force_law="petrovic").without(
        "bearing_friction", "damper", "heat_exchange", "centre_leakage", "end_flattening"
    )


PLANTS: dict[str, Callable[[], Model]] = {
    "arm": lambda: arm(3.0),
    "vertical": lambda: arm(3.0, plane="vertical"),
    "bare": bare_arm,
    "constant": lambda: arm(3.0).with_effect(constant_volume()),
    "isothermal": lambda: arm(3.0).with_effect(
        isothermal_gas(("chamber_1.heat", "chamber_2.heat"))
    ),
    "servo": servo_axis,
    "tanks": lambda: cascaded_tanks().without("overflow"),
}

# An effect shows only where something moves, so there are several states: in motion, at the lower
# stop and on the load cell, and near the upper end at high pressure.
STATES: dict[str, list[dict[str, float]]] = {
    "arm": [
        {"angle": 0.6, "speed": 0.7, "spool": 0.6, "spool_speed": 30.0, "pressure_1": 5e5,
         "pressure_2": 3e5, "temperature_1": 285.0, "temperature_2": 300.0},
        {"angle": -0.004, "speed": -0.2, "spool": -0.8, "spool_speed": -20.0, "pressure_1": 3e5,
         "pressure_2": 6e5, "temperature_1": 290.0, "temperature_2": 280.0},
        {"angle": 0.95, "speed": 0.05, "spool": 0.2, "spool_speed": 5.0, "pressure_1": 6.5e5,
         "pressure_2": 1.6e5, "temperature_1": 295.0, "temperature_2": 290.0},
    ],
    "servo": [{"position": 0.19, "speed": 0.2}, {"position": -0.0062, "speed": -0.01}],
    "tanks": [{"upper_level": 8.0, "lower_level": 4.02}, {"upper_level": 3.0, "lower_level": 9.51}],
}  # fmt: skip
# One input for each of these states.
INPUTS = {"arm": [[5.9]] * 3, "servo": [[150.0]] * 2, "tanks": [[4.0], [0.5]]}


def states_of(plant: str) -> list[dict[str, float]]:
    return STATES[plant if plant in STATES else "arm"]


def inputs_of(plant: str) -> list[list[float]]:
    return INPUTS[plant if plant in INPUTS else "arm"]


@cache
def built(plant: str) -> Model:
    return PLANTS[plant]()


@cache
def offered(plant: str) -> tuple[Hypothesis, ...]:
    model = built(plant)
    return library(model, RecordedFacts(episode=(10.0 * model.horizon, 20.0 * model.horizon)))


@pytest.mark.parametrize(
    "plant", [pytest.param(p, marks=pytest.mark.long) if p == "arm" else p for p in PLANTS]
)
def test_entries_are_well_behaved(plant: str) -> None:
    of_the_arm = {entry.name for entry in offered("arm")}
    for entry in offered(plant):
        # The other arms differ from the first in a few entries only.
        if plant in STATES or entry.name not in of_the_arm:
            _is_described(entry)
            _changes_nothing_at_zero_size_and_has_derivatives_at_every_size(plant, entry)


def _changes_nothing_at_zero_size_and_has_derivatives_at_every_size(
    plant: str, entry: Hypothesis
) -> None:
    base = built(plant)
    model = base.with_effect(entry.effect)
    n, outputs = len(base.states), len(base.outputs)
    scale = np.array([q.scale for q in (*base.states, *base.outputs)], dtype=float)
    size = f"{entry.name}.{entry.size_parameter}"
    index = [q.name for q in model.parameters].index(size)
    sized = model.with_parameters({size: entry.typical_size}).values
    excited = []
    for given, u in zip(states_of(plant), inputs_of(plant), strict=True):
        x = model.initial_state(given, u=u)
        own = np.array([q.scale for q in model.states])[n:]
        x[n:] += 0.1 * own * (1.0 + 0.3 * np.arange(len(own)))
        excited.append((x, u))
    rest = model.initial_state(u=base.nominal_input), base.nominal_input
    for form in ("exact", "regularised"):
        trace = model.form(form)
        everything = ca.vertcat(trace.rates, trace.outputs)
        found = trace.function(
            "found", everything, *(ca.jacobian(everything, by) for by in (trace.x, trace.p))
        )
        strongest = fastest = 0.0
        for x, u in excited:
            value, _, by_p = (np.asarray(block) for block in found(x, u, model.values))
            value, slope = (
                np.concatenate([part[:n], part[-outputs:]]) for part in (value, by_p[:, index])
            )
            without = np.concatenate(
                [base.rates(x[:n], u, form=form), base.read(x[:n], u, form=form)]
            )
            # Differences of rounding only: forces of 1000 N are added and taken away again.
            np.testing.assert_allclose(
                value.ravel()[:n] / scale[:n], without[:n] / scale[:n], rtol=1e-9, atol=1e-9
            )
            np.testing.assert_allclose(value.ravel()[n:], without[n:], rtol=1e-12, atol=1e-12)
            strongest = max(strongest, float(np.max(np.abs(slope) / scale)) * entry.typical_size)
        assert strongest > 1e-4, f"{entry.name}: no derivative at zero size in any state"
        for values in (model.values, sized):
            for x, u in (rest, *excited):
                _, by_x, by_p = (np.asarray(block) for block in found(x, u, values))
                assert np.all(np.isfinite(by_x))
                assert np.all(np.isfinite(by_p))
                if values is sized and x is not rest[0] and len(x) > n:
                    own = np.linalg.eigvals(by_x[n : len(x), n:])
                    fastest = max(fastest, float(np.max(np.abs(own))))
    # Of the regularised equations, the last of both forms.
    assert (fastest > 1500.0) <= entry.stiff, f"{entry.name}: rate {fastest:.0f} 1/s"


def _is_described(entry: Hypothesis) -> None:
    about = entry.effect.about
    assert about.equation
    assert about.source
    assert about.look_alikes
    assert about.separated_by
    assert entry.size.value == 0.0
    assert 0.0 < entry.typical_size <= entry.largest_size
    assert 0.2 * entry.typical_size <= entry.size.scale <= 5.0 * entry.typical_size
    for q in entry.effect.parameters:
        assert q.description or q.source, q.name
    for shape in entry.shapes:
        entry.at_size(entry.typical_size, shape)
    assert entry.replaces == (entry.size_parameter == "share" and not entry.size.fitted)


@pytest.mark.parametrize("plant", PLANTS)
def test_names_are_unique_and_look_alikes_exist(plant: str) -> None:
    entries = offered(plant)
    names = [entry.name for entry in entries]
    assert len(set(names)) == len(names)
    everywhere = {n for own in PLANTS for e in offered(own) for n in (e.name, e.law)}
    everywhere |= {law.name for law in LAWS.members().values()}
    nominal = {"spool_bandwidth"}
    for entry in entries:
        unknown = set(entry.effect.about.look_alikes) - everywhere - nominal
        assert not unknown, f"{entry.name} names {unknown}"


def test_what_is_attached_is_not_offered_again() -> None:
    names = {entry.name for entry in offered("arm")}
    assert names.isdisjoint(
        {"coulomb_friction", "viscous_friction", "heat_exchange", "centre_leakage", "phi_term"}
    )
    assert "flattened_ends" not in names
    assert {"coulomb_friction", "viscous_friction", "heat_exchange", "centre_leakage"} <= {
        entry.name for entry in offered("bare")
    }
    assert {"phi_term", "flattened_ends"} <= {entry.name for entry in offered("bare")}
    assert "braid_volume" in {entry.name for entry in offered("constant")}


def test_a_store_runs_over_into_the_next() -> None:
    entries = {entry.name: entry for entry in offered("tanks")}
    assert entries["overflow_upper"].ports == ("upper.inflow", "lower.inflow")
    assert entries["overflow_lower"].ports == ("lower.inflow",)
    assert not any(entry.law == "overflow" for entry in library(cascaded_tanks()))


def test_size_one_of_a_share_is_the_law() -> None:
    """The offered flattening at share 1 is the effect of the nominal plant."""
    nominal = arm(3.0)
    rebuilt = nominal.without("end_flattening").with_effect(flattened_ends(share=1.0))
    x, u = nominal.initial_state({"angle": 0.9}), [5.9]
    np.testing.assert_allclose(rebuilt.rates(x, u), nominal.rates(x, u), rtol=1e-12)


def test_outputs_limit_the_sensors() -> None:
    entries = library(arm(), RecordedFacts(outputs=("angle", "pressure_1", "pressure_2")))
    assert not any("load_cell" in port for entry in entries for port in entry.ports)
    assert next(e for e in entries if e.name == "clock_shift").ports == (
        "angle.reading",
        "pressure_1.reading",
        "pressure_2.reading",
    )


def test_look_alikes_are_mutual() -> None:
    entries = offered("arm")
    for entry in entries:
        for other in look_alikes(entry, entries):
            assert entry in look_alikes(other, entries)


def test_sensor_entries_act_on_measurements_only() -> None:
    for entry in offered("arm"):
        assert (entry.group == "sensor") == all(p.endswith(".reading") for p in entry.ports)


def test_entry_refuses_an_unknown_size() -> None:
    entry = offered("servo")[0]
    with pytest.raises(Exception, match="size"):
        replace(entry, size_parameter="size")


def test_each_store_keeps_its_own_brim_beside_that_of_another() -> None:
    model = tanks()
    over = {h.name: h for h in library(model) if h.law == "overflow"}
    assert set(over) == {"overflow_upper", "overflow_lower"}
    for name in over:
        left = {h.name for h in library(model.with_effect(over[name].at_size(1.0)))}
        assert left & set(over) == set(over) - {name}
    # What both sensors of a kind do is not offered again for one of them.
    both = next(h for h in library(arm(3)) if h.name == "sensor_gain_pressures")
    assert "sensor_gain_pressure_2" not in {
        h.name for h in library(arm(3).with_effect(both.at_size(0.0)))
    }


def test_more_of_what_the_model_has_is_offered_where_its_parameters_are_at_an_end() -> None:
    assert "coulomb_friction" not in {h.name for h in library(arm(3))}
    more = {h.name: h for h in library(arm(3), more_of=("bearing_friction",))}
    assert more["coulomb_friction"].ports == ("joint.torque",)
    assert set(more) - {h.name for h in library(arm(3))} == {"coulomb_friction"}


@pytest.mark.parametrize("plant", ["servo", "tanks"])
def test_one_name_is_found_as_among_all(plant: str) -> None:
    everything = every_name(built(plant))
    # Each fourth: laws stand side by side under names for each of their places.
    for name, hypothesis in list(everything.items())[::4]:
        alone = every_name(built(plant), named=name)
        assert len(alone) < 0.5 * len(everything)
        described = (re.sub(r" at 0x\w+", "", repr(h)) for h in (alone[name], hypothesis))
        assert len(set(described)) == 1


def test_an_event_that_was_found_may_come_again() -> None:
    axis = built("servo")
    jump = next(h for h in library(axis) if h.name == "offset_jump_axis_force")
    first = axis.with_effect(jump.at_size(0.1))
    assert not [h for h in library(first) if h.name.endswith("_again")]
    (second,) = (h for h in library(first, found=[jump.name]) if h.name.endswith("_again"))
    assert second.name == f"{jump.name}_again"
    both = first.with_effect(second.at_size(0.1))
    third = [h for h in library(both, found=[jump.name, second.name]) if h.comes_once]
    assert f"{second.name}_again" in {h.name for h in third}
    assert every_name(axis, named=second.name)[second.name].ports == jump.ports


def test_events_that_look_alike_are_told_by_what_they_do_and_not_by_their_repetition() -> None:
    events = [law for law in LAWS.members().values() if law.moment == "time" and not law.period]
    told = {law.name: law.separated_by.partition(":")[0] for law in events}
    assert all(text.startswith("the event again") for text in told.values()), told
    # Of what is added and what multiplies one experiment decides, and another where it is read.
    assert told["offset_jump"] == told["gain_jump"] == told["parameter_jump"]
    assert len({told[n] for n in ("offset_jump", "sensor_jump", "friction_jump")}) == 3
    own = LAWS.get("coulomb_friction").separated_by.partition(":")[0]
    assert own in told["friction_jump"] and own in told["friction_pulse"]


def test_friction_differs_by_direction_only_where_there_is_any() -> None:
    plain = servo_axis().without("coulomb_friction")
    laws = [{h.law for h in library(model)} for model in (plain, servo_axis())]
    assert ["direction_dependent_friction" in each for each in laws] == [False, True]
