"""Verdicts: what is written reads back, and nothing that is not a number gets in."""

from __future__ import annotations

import json
import math
import re
from dataclasses import replace

import numpy as np
import pytest

from tests.diagnosis.example_diagnosis import example_diagnosis
from tests.machines import clutch, conveyor, machine
from workbench.diagnosis.conclude import _beyond, _far, _small, conclude
from workbench.diagnosis.doubts import (
    _add_up,
    beside_larger,
    differs,
    left_out_too,
    still_off,
    too_quick,
)
from workbench.diagnosis.findings import along, computed
from workbench.diagnosis.location.locate import Location
from workbench.diagnosis.selection.held_out import explained
from workbench.diagnosis.selection.weights import Compared
from workbench.diagnosis.verdict import SCHEMA, Finding, Value, Verdict
from workbench.model import Scope
from workbench.model.trace import Equations
from workbench.physics.friction import coulomb_friction
from workbench.physics.library import library
from workbench.physics.recorded_facts import RecordedFacts
from workbench.physics.stiffness import linear_spring
from workbench.plants.arm import arm
from workbench.plants.servo_axis import servo_axis


def _verdict() -> Verdict:
    return Verdict(
        "named",
        "Missing: friction.",
        servo_axis(),
        findings=(
            Finding(
                ("axis.force",),
                "stribeck_friction",
                ("stribeck_friction", "local_friction"),
                "Missing: friction.",
                {"break_away": Value(25.0, "N", 0.5)},
                0.97,
                120.0,
                1e-9,
            ),
        ),
        fit={"refitted": {"position": 0.01}, "extended": {"position": math.inf}},
        units={"position": "m"},
        next_experiment={"sentence": "Move slowly.", "separation_sigma": math.nan},
        seconds=12.5,
    )


def test_verdict_reads_back_from_json() -> None:
    data = json.loads(_verdict().to_json())
    assert data["schema"] == SCHEMA == "workbench.verdict/2"
    assert data["verdict"] == "named" and data["seconds"] == 12.5
    (finding,) = data["findings"]
    assert finding["where"] == ["axis.force"]
    assert finding["effect"] == "stribeck_friction"
    assert finding["class"] == ["stribeck_friction", "local_friction"]
    assert finding["parameters"] == {"break_away": {"value": 25.0, "unit": "N", "std": 0.5}}
    assert finding["excess_explained"] == 0.97 and finding["p_value"] == 1e-9
    assert data["fit"]["units"] == {"position": "m"}


def test_columns_of_a_verdict_stand_apart() -> None:
    errors = dict.fromkeys(("position", "temperature_of_the_stack"), 0.5)
    units = {"position": "m", "temperature_of_the_stack": "K"}
    text = str(replace(_verdict(), fit={"refitted": errors}, units=units))
    assert re.search(r"position in mm {2,}temperature_of_the_stack in K\n", text)


def test_an_output_at_its_noise_has_no_say_in_what_was_explained() -> None:
    noise = {"voltage": 0.051, "temperature": 0.1085}
    before = {"voltage": 0.36, "temperature": 0.114}
    after = {"voltage": 0.108, "temperature": 0.12}
    found = explained({"noise_floor": noise, "refitted": before, "extended": after})
    assert found == pytest.approx(0.75, abs=0.03)
    # Two that are as far off count alike, whatever their units.
    even = {"noise_floor": noise, "refitted": {k: 7.0 * v for k, v in noise.items()}}
    even["extended"] = {"voltage": 0.051, "temperature": even["refitted"]["temperature"]}
    assert explained(even) == pytest.approx(0.5)


def test_a_parameter_that_is_a_curve_is_told_along_it() -> None:
    def equations(m: Scope) -> Equations:
        braking = m.p.mu * m.u.pressure
        return {"speed": (m.u.effort - braking) / 4e4}, {"tacho": m.x.speed}

    wagon = machine(
        equations,
        "speed m/s 10",
        "effort N upper=6e4, pressure N upper=4e5",
        "tacho m/s display_unit=km/h",
        "mu 1 0.3 0.05 0.6",
    )
    seen = library(wagon, RecordedFacts(ranges={"speed": (5.0, 25.0)}))
    (law,) = (h for h in seen if h.name == "parameter_curve_mu_over_speed")
    model = wagon.with_effect(law.at_size(0.1, {"bend": math.pi}))
    told = along(model, model.effects[-1])
    # What is never negative changes by factors, here of exp(0.1 / 0.3).
    assert told == "; mu is 0.419 at 18 km/h, 0.3 at 54 km/h, 0.215 at 90 km/h of speed"
    assert along(model, coulomb_friction("speed.rate")) == ""
    # Its middle is where the wagon stands, but for a millimetre per second.
    seen = library(wagon, RecordedFacts(ranges={"speed": (-25.0, 24.998)}))
    (law,) = (h for h in seen if h.name == "parameter_curve_mu_over_speed")
    assert " at 0 km/h, " in along(wagon.with_effect(law.at_size(0.1)), law.at_size(0.1))


def test_a_curve_over_a_slip_is_told_with_both_its_ends() -> None:
    rubbing = clutch("m 0.04 -0.2 0.2")
    seen = library(rubbing, RecordedFacts(ranges={"1 engine - car": (0.0, 200.0)}))
    law = next(h for h in seen if h.name == "parameter_curve_radius_over_engine_car")
    model = rubbing.with_effect(law.at_size(-0.01))
    told = along(model, model.effects[-1])
    assert told.endswith("30 mm at 200 rad/s of engine - car")


def test_a_curve_of_a_parameter_is_told_in_the_unit_of_that() -> None:
    pool = machine(
        lambda m: ({"c": m.p.dosed * m.u.valve}, {"chlorine": m.x.c}),
        "c mg/l 1",
        "valve 1 upper=1",
        "chlorine mg/l",
        "dosed mg/l/h 0.3 0 2",
        time="h",
    )
    seen = library(pool, RecordedFacts(ranges={"c": (0.0, 8e-3)}))
    law = next(h for h in seen if h.name == "parameter_curve_dosed_over_c")
    model = pool.with_effect(law.at_size(-0.2e-3 / 3600.0, {"added": 1.0}))
    told = along(model, model.effects[-1])
    assert told.startswith("; dosed is 0.5 mg/l/h at 0 mg/l, 0.3 mg/l/h at 4 mg/l, 0.1 mg/l/h at")
    assert model.read_in(f"{law.name}.amount") == "mg/l/h"


@pytest.mark.parametrize("written", ["L/min", "m3/s"])
def test_what_combines_units_is_read_in_those_of_the_author(written: str) -> None:
    def equations(m: Scope) -> Equations:
        flow = m.port("valve.flow", m.u.pump - m.p.leak * m.x.line, unit=written)
        return {"line": flow / m.p.store}, {"gauge": m.x.line}

    own = written == "L/min"
    # In units of its own, or in those of the SI with a unit for the reader.
    hose = machine(
        equations,
        "line bar 1" if own else "line Pa 1e5",
        "pump L/min upper=20" if own else "pump m3/s upper=4e-4 display_unit=L/min",
        "gauge bar" if own else "gauge Pa display_unit=bar",
        "leak L/(min bar) 2 0 9, store L/bar 0.5"
        if own
        else "leak m3/(s Pa) 3e-10 0 9e-10, store m3/Pa 5e-9",
        time="min" if own else "",
    )
    laws = {h.name: hose.with_effect(h.at_size(h.typical_size)) for h in library(hose)}
    wanted = {
        ("linear_outflow_valve", "conductance"): "L/(min bar)",
        ("quadratic_outflow_valve", "coefficient"): "L/(min bar2)",
        ("sensor_cross_talk_gauge_pump", "gain"): "bar min/L",
        ("offset_valve_flow", "amount"): "L/min",
    }
    read = {(law, q): laws[law].read_in(f"{law}.{q}") for law, q in wanted}
    assert read == wanted
    # The author wrote this one himself.
    jump = "parameter_jump_leak"
    assert laws[jump].read_in(f"{jump}.amount") == ("L/(min bar)" if own else "")


def test_levels_of_temperature_are_told_on_the_scale_of_the_thermometer() -> None:
    kettle = machine(
        lambda m: ({"T": m.p.gain * m.u.power}, {"probe": m.x.T}),
        "T K 293.15",
        "power W upper=2000",
        "probe K display_unit=degC",
        "gain K/J 2e-4 0 2e-3",
    )
    ranges = dict.fromkeys(("T", "probe.reading"), (290.0, 370.0))
    seen = library(kettle, RecordedFacts(ranges=ranges))
    for name, parameter in (("heat_loss", "ambient"), ("sensor_clipping", "limit")):
        law = next(h for h in seen if h.name.startswith(name))
        model = kettle.with_effect(law.at_size(0.005, {parameter: 333.15}))
        read = model.read_in(f"{law.name}.{parameter}")
        told = Value(333.15, "K", 0.5, read).read
        assert (round(told[0], 9), *told[1:]) == (60.0, 0.5, "°C")


def test_a_curve_is_told_along_the_scale_of_the_thermometer_that_reads_its_state() -> None:
    def equations(m: Scope) -> Equations:
        braking = m.p.mu * m.u.push
        return {"w": -braking, "T": braking - m.x.T + 295.0}, {"tacho": m.x.w, "disc": m.x.T}

    brake = machine(
        equations,
        "w rad/s, T K 295",
        "push N upper=100",
        "tacho rad/s display_unit=rpm, disc K display_unit=degC",
        "mu 1 0.3 -0.6 0.6",
    )
    seen = library(brake, RecordedFacts(ranges={"T": (273.15, 473.15)}))
    law = next(h for h in seen if h.name == "parameter_curve_mu_over_T")
    model = brake.with_effect(law.at_size(-0.1))
    assert along(model, model.effects[-1]) == "; mu is 0.4 at 0°C, 0.3 at 100°C, 0.2 at 200°C of T"


def test_a_curve_over_several_signals_is_told_along_what_a_parameter_multiplies() -> None:
    plain = conveyor()
    seen = library(plain, RecordedFacts(ranges={"argument of grip": (-0.05, 0.05)}))
    law = next(h for h in seen if h.name == "parameter_curve_grip_over_argument")
    model = plain.with_effect(law.at_size(2.0, {"bend": 0.0}))
    told = along(model, model.effects[-1])
    assert "10 1/s at 0 m/s, 12.2 1/s at 0.05 m/s of what grip multiplies" in told


def test_a_name_is_doubted_where_most_is_missing_still() -> None:
    given = example_diagnosis()
    assert given.validated is not None and given.before is not None
    left = replace(given.before, alone={k: 0.6 * v for k, v in given.before.alone.items()})
    found = replace(given, validated=replace(given.validated, location=left))
    assert [f.belief for f in conclude(given).findings] == ["sure"]
    (finding,) = conclude(found).findings
    assert finding.belief == "likely"
    assert finding.doubts[-1].startswith("beside it 60 % of what was missing is still missing")


@pytest.mark.parametrize(("left", "noise", "noise_scale", "belief"), [
    (0.3, 1e-5, 3.0, "likely"),
    # Little is left, or equations that leave nothing out drift off with the noise.
    (0.1, 1e-5, 3.0, "sure"),
    (0.3, 1e-5, 0.003, "sure"),
    # Most is there without it: such equations are trusted by what they cannot show.
    (0.6, 1e-5, 0.003, "likely"),
    # Near the noise, what is left counts by how far it is beyond it.
    (0.3, 1.1e-3, 3.0, "likely"),
    (0.3, 2.5e-3, 3.0, "sure"),
])  # fmt: skip
def test_a_name_is_doubted_where_equations_leave_something_out_and_run_off(
    left: float, noise: float, noise_scale: float, belief: str
) -> None:
    given = example_diagnosis()
    extended = replace(given.extended, noise_scale=noise_scale)
    found = replace(given, validated=replace(given.validated, extended=extended))
    fit = {
        "noise_floor": {"position": noise},
        "refitted": {"position": 1e-2},
        "extended": {"position": left * 1e-2},
    }
    doubts = still_off(found, fit)
    assert bool(doubts) == (belief == "likely")
    told = f"{100 * (1.0 - explained(fit)):.0f} % of the mean square"
    assert all(text.startswith(told) for text in doubts)


def test_runs_that_drift_off_are_told_whatever_a_filter_makes_of_the_equations(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    given = example_diagnosis()
    assert given.extended.noise_scale < 0.1
    fit = {"noise_floor": {"position": 1e-5}, "extended": {"position": 2e-3}}
    assert left_out_too(given, fit) == ""
    monkeypatch.setattr("workbench.diagnosis.doubts.over_floor", lambda *given: {"position": 150.0})
    assert "the held-out error of position is 200 times the noise." in left_out_too(given, fit)
    gained = given.rounds[0]
    idle = gained._replace(candidates=tuple(replace(c, gain=0.7) for c in gained.candidates))
    for later, told in ((gained, "; the best candidate for it, coulomb"), (idle, ", and no law")):
        state = replace(given.selected, rounds=(gained, later))
        assert f"times the noise{told}" in left_out_too(replace(given, selected=state), fit)


def test_errors_say_of_which_parameters_they_are() -> None:
    lines = str(_verdict()).splitlines()
    (head,) = (k for k, text in enumerate(lines) if "with parameters that run closest" in text)
    assert "position in" in lines[head + 1]


def test_numbers_that_are_not_finite_become_null() -> None:
    text = _verdict().to_json()
    assert "NaN" not in text and "Infinity" not in text
    data = json.loads(text)
    assert data["fit"]["held_out"]["extended"]["position"] is None
    assert data["next_experiment"]["separation_sigma"] is None


def test_a_parameter_is_printed_in_the_declared_unit_and_kept_in_si() -> None:
    size = Value(2.0e-5, "m3/s", 5e-9, "l/min")
    found = replace(_verdict().findings[0], parameters={"half_width": size})
    verdict = replace(_verdict(), findings=(found,))
    (line,) = (text for text in str(verdict).splitlines() if "half_width" in text)
    assert line.split()[1:] == ["1.2", "+-", "0.0003", "l/min"]
    kept = verdict.as_data()["findings"][0]["parameters"]["half_width"]
    assert kept == {"value": 2.0e-5, "unit": "m3/s", "std": 5e-9}


def test_a_printed_verdict_holds_its_numbers() -> None:
    text = str(_verdict())
    assert text.startswith("named: Missing: friction.")
    assert "break_away" in text and "25" in text and "Move slowly." in text


def test_a_model_that_runs_away_is_said_to() -> None:
    fit = {"nominal": {"position": 2e56}, "noise_floor": {"position": 1e-3}}
    lines = str(replace(_verdict(), fit=fit)).splitlines()
    assert [line.split() for line in lines if line.split()[0] in fit] == [
        ["nominal", "runs", "away"],
        ["noise_floor", "1"],  # mm
    ]


def test_what_has_a_weight_instead_of_a_finding_cannot_be_told_from_it() -> None:
    given = example_diagnosis()
    name = "coulomb_friction"
    assert [f.alike for f in given.verdict.findings] == [(name,)]

    def said(*others: tuple[tuple[str, ...], float]) -> tuple[tuple[str, ...], float, str]:
        sets = [Compared(e, (np.full(20, c / 40),) * 2) for e, c in (((name,), 0.0), *others)]
        selected = replace(given.selected, compared=tuple(sets), penalty=20.0)
        verdict = conclude(replace(given, selected=selected))
        (finding,) = verdict.findings
        told.append(finding.sentence)
        return finding.alike, finding.weight, verdict.kind

    told: list[str] = []
    alike, weight, kind = said((("linear_spring",), 1.0), ((), 100.0))
    assert (alike, kind) == ((name, "linear_spring"), "named_class")
    assert weight == pytest.approx(1.0)
    # Each of them has its experiment.
    for law in (coulomb_friction, linear_spring):
        assert law.separated_by.partition(":")[0] in told[0]
    # What is hardly as likely, or has another effect beside it, is not meant.
    assert said((("linear_spring",), 5.0))[::2] == ((name,), "named")
    alike, weight, _ = said((("linear_spring", "creep"), -20.0))
    assert alike == (name,) and weight == pytest.approx(0.5)


@pytest.mark.parametrize(("one", "other", "found"), [
    ("joint.torque", "lower_stop.torque", True),
    ("joint.torque", "muscle_1.tension", False),
    ("chamber_1.flow", "chamber_2.flow", False),
    ("angle.reading", "angle.reading", True),
])  # fmt: skip
def test_signals_add_up_where_they_enter_one_rate_in_one_unit(
    one: str, other: str, found: bool
) -> None:
    given = example_diagnosis()
    assert given.validated is not None
    signal = given.validated.occurrence()
    assert signal is not None
    model = arm()
    units = {port.name: port.unit for port in model.ports}
    assert _add_up(model, *(replace(signal, port=p, unit=units[p]) for p in (one, other))) == found


@pytest.mark.parametrize(("share", "elsewhere", "doubted"), [
    (0.05, False, True),
    (0.2, False, False),
    (0.05, True, False),
])  # fmt: skip
def test_what_may_be_the_rest_of_a_larger_finding_is_doubted(
    share: float, elsewhere: bool, doubted: bool
) -> None:
    given = example_diagnosis()
    (signal,) = given.validated.missing[0]
    port = "elsewhere" if elsewhere else signal.occurrence.port
    small = replace(signal.occurrence, largest=share * signal.occurrence.largest, port=port)
    missing = ((signal,), (replace(signal, occurrence=small),))
    found = replace(
        given,
        validated=replace(given.validated, missing=missing),
        selected=replace(given.selected, accepted=2 * given.selected.accepted),
    )
    assert beside_larger(found, 0) == ()
    said = " ".join(beside_larger(found, 1))
    assert said.startswith("it is 5 % of coulomb friction at") if doubted else said == ""


@pytest.mark.parametrize(("samples", "std", "doubted"), [
    (0.5, 0.01, True),
    (2.0, 1.0, True),
    (2.0, 0.1, False),
    (1e4, 1e4, False),
])  # fmt: skip
def test_a_memory_that_may_be_shorter_than_a_sample_is_doubted(
    samples: float, std: float, doubted: bool
) -> None:
    given = example_diagnosis()
    sample = given.prepared.fitting[0].sample_time
    own = {
        "time_constant": Value(samples * sample, "s", std * sample),
        "time": Value(0.0, "s", 0.0),
    }
    said = " ".join(too_quick(given, own))
    assert said.startswith("its time constant may be shorter than a sample, ") == doubted
    assert bool(said) == doubted


def test_what_is_small_and_clearly_there_is_told() -> None:
    given = example_diagnosis()
    for gain, told in ((40.0, False), (750.0, True)):
        location = Location({"axis": gain})
        said = _small(replace(given, located=location))
        assert bool(said) == said.startswith(" Something small acts at axis.force") == told


def test_what_differs_by_recording_is_doubted_where_more_is_left_out() -> None:
    axis = servo_axis()
    entries = {e.law: e for e in library(axis)}
    differing = entries["offset_by_recording"].effect
    assert differs(differing, " Something else is still left out.") != ()
    assert differs(differing, "") == ()
    assert differs(entries["constant_force"].effect, " Something else is still left out.") == ()


def test_a_size_is_read_in_the_unit_of_its_sentence() -> None:
    value, _, unit = Value(24.4, "rad/s2", 0.1).read
    assert (round(value), unit) == (1398, "°/s²")
    value, std, unit = Value(0.0077, "s", 3.5e-5).read
    assert (round(value, 9), round(std, 9), unit) == (7.7, 0.035, "ms")


def test_it_is_said_where_held_out_recordings_go_further_than_fitted_ones() -> None:
    found = example_diagnosis()
    (seen,) = found.prepared.judging
    near = replace(found.prepared, judging=found.prepared.fitting)
    assert _beyond(replace(found, prepared=near), "likely") == ""
    for factor in (-4.0, 4.0):
        far = factor * np.abs(seen.outputs) / np.max(np.abs(seen.outputs))
        prepared = replace(found.prepared, judging=(replace(seen, outputs=far),))
        said = _beyond(replace(found, prepared=prepared), "unexplained")
        assert f"position goes to {1e3 * factor:.0f} mm, where it was fitted to" in said
        assert _beyond(replace(found, prepared=prepared), "named") == ""
    # A command that goes a little further may meet the end of what a drive can do.
    fitted = found.prepared.fitting[0]
    for factor, told in ((1.02, False), (1.5, True)):
        judging = (replace(fitted, inputs=factor * fitted.inputs),)
        said = _beyond(replace(found, prepared=replace(near, judging=judging)), "likely")
        assert ("force goes to" in said) is told, said


@pytest.mark.parametrize(
    ("times", "said"), [(1.1, ""), (40.0, "is 40 times what noise"), (math.inf, "runs away")]
)
def test_a_run_that_is_nowhere_is_told_without_a_number(times: float, said: str) -> None:
    found = example_diagnosis()
    assert found.scored is not None
    off = replace(found, scored=replace(found.scored, over_floor={"position": times}))
    assert (said in _far(off)) if said else not _far(off)
    assert "inf" not in _far(off)


@pytest.mark.parametrize(
    ("law", "said"),
    [
        ("sensor_bend_light_reading", "what light does"),
        ("sensor_fade_light_reading", "what light does"),
        # An offset is no curve, a lag no formula, and what leaks out and breathes in would differ.
        ("sensor_offset_light_reading", ""),
        ("sensor_lag_light_reading", ""),
        ("sensor_drift_light_reading", ""),
        ("sensor_bend_outside_reading", ""),
    ],
)
def test_a_curve_of_what_reads_an_input_may_be_what_that_does(law: str, said: str) -> None:
    def equations(m: Scope) -> Equations:
        grown = m.p.growth * m.u.light * m.x.air
        return {
            "air": m.u.dose - grown - m.p.vent * (m.x.air - m.u.outside),
            "soil": 0.1 * (m.u.outside - m.x.soil),
        }

    house = machine(
        equations,
        "air kg/m3 1, soil kg/m3 1",
        "dose kg/m3/s 0 5, light W/m2 0 800 commanded=0, outside kg/m3 0 2 commanded=0",
        "air kg/m3, soil kg/m3",
        "growth m2/J 1e-3 0 0.1, vent 1/s 0.1 0 2",
    )
    ranges = {"light": (0.0, 600.0), "outside": (0.5, 1.0)}
    entries = {h.name: h for h in library(house, RecordedFacts(ranges=ranges))}
    assert computed(entries[law], house) == said
