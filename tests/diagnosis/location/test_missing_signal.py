"""When and where a signal acts, told from made-up signals and from small diagnoses."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from tests.diagnosis.axis_case import diagnosed
from tests.diagnosis.example_diagnosis import shaken
from tests.diagnosis.newcomers import oscillator
from tests.machines import machine
from tests.physics.effects.bench import offered
from workbench.arrays import Vector
from workbench.diagnosis.conclude import conclude
from workbench.diagnosis.estimation.simulated_recordings import simulated
from workbench.diagnosis.location.located_signal import _arguments, added_at_ports, missing_signals
from workbench.diagnosis.location.missing_signal import (
    LocalSignal,
    Occurrence,
    Place,
    correlation_ratio,
    occurrence,
)
from workbench.diagnosis.location.unknown_input import UnknownInput, unknown_input
from workbench.model.quantities import declared_unit
from workbench.physics.braided_muscle import series_elasticity
from workbench.plants.arm import arm

TIME = np.linspace(0.0, 20.0, 2001)
SPEED = np.sin(1.3 * TIME)
ANGLE = np.cos(0.7 * TIME)


def _told(signal: Vector, std: float = 0.01) -> Occurrence:
    half = len(TIME) // 2
    return occurrence(
        "joint.torque",
        "N m",
        [("first", TIME[:half]), ("second", TIME[half:] - TIME[half])],
        signal,
        np.full(len(TIME), std),
        [LocalSignal("angle", "rad", ANGLE), LocalSignal("speed", "rad/s", SPEED)],
    )


def test_a_declared_unit_is_told_and_a_difference_has_no_zero() -> None:
    warm = machine(
        lambda m: {"oven": m.u.oven / 1e3},
        "oven K 300",
        "oven W display_unit=kW upper=5e3",
        "oven K display_unit=degC",
    )
    level, heat = 323.15 + 10.0 * ANGLE, np.where(ANGLE > 0.0, 3e3, 0.0)
    # A state and an input may have one name.
    arguments = [
        LocalSignal("oven", unit, values, declared_unit("oven", unit, warm.quantities))
        for unit, values in (("K", level), ("W", heat + 10 * SPEED))
    ]
    told = []
    for port, unit, which in (("oven.rate", "K/s", 0), ("oven.reading", "K", 0), ("heat", "W", 1)):
        shown = declared_unit(port, unit, warm.quantities, difference=True)
        signal = np.where(ANGLE > 0.5, 2.0e3, 0.0)
        chosen = arguments[which : which + 1]
        none = np.zeros(len(TIME))
        found = occurrence(port, unit, [("run", TIME)], signal, none, chosen, shown)
        assert found.places[0].unit == chosen[0][1] and found.as_data()["unit"] == unit
        told.append((found.where.partition("most at ")[2], found.how_large))
    assert told[0][0].endswith("60 °C") and told[0][1] == "2000 K/s"
    assert told[1][1] == "2000 K"
    assert told[2][0].endswith("kW") and told[2][1] == "2 kW"


def test_what_is_nothing_beside_the_largest_value_is_told_as_zero() -> None:
    place = Place("current", "A", 0.9, ((-5.0, -4.0), (3e-10, 4e-10)), 0.3)
    found = Occurrence("cell.voltage", "V", 0.1, 0.2, (), 0.3, (place,))
    assert found.where.endswith("most at -5 to -4 and 0 A")


def test_numbers_of_one_range_have_as_many_digits() -> None:
    place = Place("rate", "A/s", 0.9, ((-1.2e5, -40471.0), (44014.0, 87409.0)), 0.3)
    found = Occurrence("i.rate", "A/s", 0.1, 30812.0, (), 0.3, (place,))
    assert found.where.endswith("most at -120000 to -40500 and 44000 to 87400 A/s")
    assert found.how_large == "30800 A/s"


def test_an_effect_that_begins_at_a_time_is_told_from_then_on() -> None:
    (span,) = _told(np.where(TIME > 16.0, 1.0, 0.0)).spans
    assert span.recording == "second"
    # A window is 0.2 s.
    assert (span.begin, span.end) == (pytest.approx(6.0, abs=0.2), pytest.approx(10.0, abs=0.2))
    assert span.share == pytest.approx(1.0, abs=0.01)


def test_a_spike_is_told_from_a_small_signal_that_is_always_there() -> None:
    found = _told(0.1 + np.where((TIME > 4.0) & (TIME < 4.4), 5.0, 0.0))
    assert found.when == "from 4 to 4.4 s of first"
    assert found.active < 0.05
    assert _told(0.1 + 0.0 * TIME).when == "throughout"


def test_the_signal_and_its_values_are_those_it_depends_on() -> None:
    found = _told(2.0 * np.where(SPEED > 0.5, SPEED, 0.0))
    place = found.places[0]
    assert place.signal == "speed" and place.dependence > 0.95
    ((low, high),) = place.ranges
    assert low == pytest.approx(1.0 / 2, abs=0.1) and high == pytest.approx(1.0, abs=1e-3)
    # People read degrees per second.
    assert "with speed (" in found.where and "°/s" in found.where
    # Of the same size at both ends, though not of the same sign.
    both = _told(np.sign(SPEED) * (np.abs(SPEED) > 0.8)).places[0]
    assert both.signal == "speed" and len(both.ranges) == 2


def test_a_constant_goes_with_nothing_however_it_is_rounded() -> None:
    speed = np.sin(np.linspace(0.0, 20.0, 1000))
    assert correlation_ratio(9.0 + 1e-12 * speed, speed) == 0.0
    assert correlation_ratio(9.0 + 1e-3 * speed, speed) > 0.98


def test_what_the_measurements_do_not_tell_is_left_out() -> None:
    unsure = occurrence(
        "joint.torque",
        "N m",
        [("run", TIME)],
        np.where(TIME < 2.0, 50.0, np.where(TIME > 10.0, 1.0, 0.0)),
        np.where(TIME < 2.0, 60.0, 0.01),
        [],
    )
    assert unsure.largest == pytest.approx(1.0, rel=0.01)
    assert unsure.spans[0].begin == pytest.approx(10.0, abs=0.5)


def test_a_finding_says_when_with_which_signal_and_where() -> None:
    verdict = diagnosed(True).verdict
    (finding,) = verdict.findings
    seen = finding.occurrence
    assert seen is not None and seen.port == "axis.force" and seen.unit == "N"
    # What exceeds the Coulomb level decays within some Stribeck speeds of 0.03 m/s.
    assert seen.places[0].signal == "speed"
    assert max(abs(end) for r in seen.places[0].ranges for end in r) < 0.1
    assert str(seen) in finding.sentence
    data = verdict.as_data()["findings"][0]["occurrence"]
    assert data["places"][0]["signal"] == "speed" and data["times"][0]["recording"] == "axis-3"
    calm = diagnosed(False).verdict
    assert calm is not None and calm.occurrence is None and not calm.findings


@pytest.mark.long
def test_unexplained_names_a_time_a_place_and_a_signal() -> None:
    found = shaken()
    assert found.verdict.kind == "unexplained"
    seen = found.verdict.findings[0].occurrence
    assert seen is not None and seen.spans and seen.places and seen.port == "axis.force"
    # It may act in any recording, not only in those held out.
    assert {span.recording for span in seen.spans} == {"axis 1", "axis 2"}


def test_without_a_located_port_the_error_of_the_predictions_tells() -> None:
    found = shaken()
    assert found.located is not None and found.validated is not None
    none = dict.fromkeys(found.located.alone, 0.0)
    nowhere = replace(found, located=replace(found.located, alone=none))
    signals, why = missing_signals(nowhere)
    assert not why and signals[0][0].port == "position"
    said = conclude(replace(nowhere, validated=replace(found.validated, missing=signals)))
    assert said.kind == "unexplained" and not said.findings
    assert said.occurrence is not None and str(said.occurrence) in said.sentence
    assert said.as_data()["occurrence"]["unit"] == "m"


def test_what_an_effect_adds_is_read_at_its_own_ports() -> None:
    """Four ports stand against three measurements: no projection of rates tells them apart."""
    base, compliance = arm(3.0), 6e-6
    extended = base.with_effect(series_elasticity(compliance=compliance))
    seen = simulated(extended, np.full(60, 5.4), sample_time=0.002)
    inside = simulated(base, np.full(60, 5.4), sample_time=0.002)
    ports = ("muscle_1.length", "muscle_2.length")
    known = unknown_input(base, inside, ("joint.torque",))
    none = np.zeros((len(known.time), 2))
    missing = replace(known, ports=ports, units=("m", "m"), signal=none, std=none)
    absent = {"series_elasticity.compliance": 0.0}
    effect = extended.effect("series_elasticity")
    added = added_at_ports(extended, effect, absent, seen, base, missing)
    # Some 300 to 1,000 N pull at each.
    assert np.all(added < -compliance * 100.0) and np.all(added > -compliance * 1500.0)


def test_what_is_added_before_a_lag_at_the_same_port_is_all_of_it() -> None:
    base = machine(
        lambda m: {"x": m.x.v, "v": m.u.drive - 4.0 * m.x.x - 0.4 * m.x.v},
        "x m, v m/s",
        "drive A -2 2",
        "x m",
    )
    lag, offset = (offered(base, f"{name}_drive_command") for name in ("drive_lag", "offset"))
    extended = base.with_effect(offset.at_size(0.3)).with_effect(lag.at_size(0.05))
    without, inputs = extended.without("offset_drive_command"), np.full(60, 0.5)
    seen = simulated(extended, inputs, sample_time=0.01)
    missing = unknown_input(
        without, simulated(without, inputs, sample_time=0.01), ("drive.command",)
    )
    absent = {f"offset_drive_command.{offset.size_parameter}": 0.0}
    effect = extended.effect("offset_drive_command")
    added = added_at_ports(extended, effect, absent, seen, without, missing)
    np.testing.assert_allclose(added, 0.3, rtol=1e-9)


def test_the_clock_of_an_event_is_no_signal_that_anything_goes_with() -> None:
    model = oscillator().with_effect(offered(oscillator(), "offset_jump_mass_force").at_size(1.0))
    along = np.column_stack([SPEED, ANGLE, TIME])
    none = 0.0 * TIME[:, None]
    part = UnknownInput("run", ("mass.force",), ("N",), TIME, none, none, along, none)
    names = [q.name for q in _arguments(model, [part])]
    assert names == ["position", "speed", "drive", "rate of position", "rate of speed"]
