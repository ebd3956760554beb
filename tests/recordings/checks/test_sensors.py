"""Frozen, clipped, constant and wrongly scaled sensors are found; sound ones are not."""

import math
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import casadi as ca
import numpy as np
import pytest

from tests.diagnosis.machine_data import recording as recording_of
from tests.machines import machine
from tests.recordings.example import example_recording, recorded, with_values
from workbench.evaluation.foreign.foreign_case import plan
from workbench.model import Input, Model, Output, State
from workbench.plants.arm.arm import arm
from workbench.plants.servo_axis import servo_axis
from workbench.recordings import Recording, check_recording, read_recording
from workbench.recordings.checks.expected import Expected, expectations, response_signs
from workbench.recordings.checks.signs import check_signs
from workbench.recordings.checks.stuck import not_ready
from workbench.recordings.checks.units import check_units
from workbench.recordings.recording import ColumnMapping, MappedColumn, Vector

TRIAL = example_recording(seconds=6.0)
SIGNS = {
    ("valve", "pressure_1"): 1,
    ("valve", "pressure_2"): -1,
    ("pressure_1", "angle"): 1,
    ("pressure_2", "angle"): -1,
}


def test_signs_follow_from_the_model() -> None:
    assert response_signs(arm()) == SIGNS
    assert response_signs(servo_axis()) == {("force", "position"): 1}


def trial_with(name: str, change: Callable[[Vector], Any]) -> Recording:
    """Return the sound trial with one signal changed."""
    return with_values(TRIAL, name, change(TRIAL[name]))


def turned(closed: bool) -> Recording:
    """Return a trial whose angle has the wrong sign."""
    trial = example_recording(seconds=8.0, closed_loop=closed)
    return with_values(trial, "angle", -trial["angle"])


# Dry friction stops a motion within a sample and lets it go on from where it stood.
STICKING = 0.4 * np.floor(TRIAL.time) + np.interp(TRIAL.time % 1.0, [0.0, 0.4], [0.0, 0.4])
STILL = trial_with("angle", lambda q: 1e-3 * np.random.default_rng(0).normal(size=len(q)))
FIXED = {name: trial_with(name, lambda v: 0 * v + v[0]) for name in ("angle", "pressure_1")}
DEGREES = trial_with("angle", lambda q: np.rad2deg(q) + 40)
FROM_VACUUM = dict.fromkeys(("pressure_1", "pressure_2"), (100000.0, 700000.0))
FINDINGS: list[tuple[Recording, dict[str, Any], str, str, str]] = [
    # what is recorded, what is known, a check, its result or "doubt", words of its note
    (TRIAL, {}, "signs", "not checked", ""),
    (TRIAL, {"signs": SIGNS}, "signs", "pass", ""),
    (turned(closed=False), {"signs": SIGNS}, "signs", "unfit", "angle is probably reversed"),
    (turned(closed=True), {"signs": SIGNS}, "signs", "unfit", "angle is probably reversed"),
    (trial_with("pressure_1", lambda p: np.append(p[:1500], 0 * p[1500:] + p[1500])), {},
     "stuck samples", "unfit", ""),
    (trial_with("angle", lambda q: 3.5e-5 * np.round(STICKING / 3.5e-5)), {},
     "stuck samples", "pass", ""),
    (trial_with("pressure_2", lambda p: np.maximum(p, np.median(p))), {},
     "clipping", "pass", "wider range"),
    (trial_with("valve", lambda v: 0 * v + 5), {}, "constant signals", "pass", "valve is 5 V thr"),
    (trial_with("valve", lambda v: 0 * v + 5), {}, "loop", "not checked", ""),
    (trial_with("valve", lambda v: 0 * v + 5), {}, "delay", "not checked", ""),
    *((fixed, {}, "constant signals", "unfit", name) for name, fixed in FIXED.items()),
    *((fixed, {"required": [n for n in TRIAL.names if n != name]}, "constant signals", "pass", "")
      for name, fixed in FIXED.items()),
    (DEGREES, {}, "units", "not checked", ""),
    (DEGREES, {"ranges": {"angle": (-1.0, 1.5)}}, "units", "unfit", "look like deg, not rad"),
    (trial_with("pressure_1", lambda p: p / 1e5), {"ranges": {"pressure_1": (0.0, 6e5)}},
     "units", "unfit", "look like bar, not Pa"),
    (TRIAL, {"ranges": {"angle": (0.0, 0.2)}}, "units", "doubt", "outside the plausible"),
    (TRIAL, {"ranges": {"pressure_1": (0.0, 2.5e5)}}, "units", "doubt", ""),
    (trial_with("pressure_1", lambda p: np.maximum(p, 101325.0)), {"ranges": FROM_VACUUM},
     "gauge pressure", "pass", ""),
    (trial_with("angle", lambda q: np.round(q / 0.08) * 0.08), {},
     "quantisation", "pass", "angle covers"),
    # The pressures tell of a machine that stands still.
    (STILL, {}, "noise floor", "doubt", ""),
    (STILL, {"required": ["angle"]}, "noise floor", "unfit",
     "no more than its noise of 0.0573 deg rms"),
]  # fmt: skip


@pytest.mark.parametrize(("recording", "known", "name", "result", "said"), FINDINGS)
def test_what_a_check_finds(
    recording: Recording, known: dict[str, Any], name: str, result: str, said: str
) -> None:
    report = check_recording(recording, **known)
    check = report.check(name)
    assert ("doubt" if check.doubt else check.result, said in check.note) == (result, True), check
    assert report.fit is (result != "unfit")
    assert not report.fit or all(report.recording.valid(n).all() for n in TRIAL.names)


@pytest.mark.parametrize(("most", "doubtful"), [(9.0, False), (10.02, False), (10.6, True)])
def test_a_command_beyond_the_range_that_the_plant_declares_is_a_doubt(
    most: float, doubtful: bool
) -> None:
    valve = TRIAL.signal("valve")
    pushed = np.where(np.arange(len(valve.values)) % 200 < 20, most, valve.values)
    recording = with_values(TRIAL, "valve", pushed).select(["valve"])
    finding = check_units(recording, expectations(recording, model=arm(), required=["valve"]))
    assert finding.result == "pass" and finding.doubt == doubtful, finding
    assert ("the model gets it clipped" in finding.note) == doubtful


@pytest.mark.parametrize("seed", range(5))
@pytest.mark.parametrize("closed", [False, True])
def test_sound_recordings_pass(seed: int, closed: bool) -> None:
    report = check_recording(example_recording(seconds=6.0, seed=seed, closed_loop=closed))
    assert report.result == "pass", str(report)


@pytest.mark.parametrize("name", ["angle", "pressure_1"])
@pytest.mark.parametrize("length", [40, 200])
def test_frozen_measurement(name: str, length: int) -> None:
    values = TRIAL[name].copy()
    # Freeze where the signal moves, or nothing would be lost.
    start = 500 + int(np.argmax(np.abs(values[500 + length : 2500] - values[500 : 2500 - length])))
    values[start : start + length] = values[start]
    report = check_recording(with_values(TRIAL, name, values))
    check = report.check("stuck samples")
    assert check.result == "corrected", check.note
    bad = np.flatnonzero(~report.recording.valid(name))
    assert abs(bad[0] - start - 1) <= 1
    assert abs(len(bad) - (length - 1)) <= 1


@pytest.mark.parametrize("nothing", [0.0, 1.2e6])
@pytest.mark.parametrize("spells", [1, 2, 8])
def test_a_sensor_that_drops_out_is_bridged(nothing: float, spells: int) -> None:
    values, first = TRIAL["pressure_1"].copy(), np.linspace(200, 2600, spells).astype(int)
    gone = np.isin(np.arange(len(values)), [k + i for k in first for i in range(3)])
    values[gone] = nothing
    report = check_recording(with_values(TRIAL, "pressure_1", values))
    # What happens once may be the machine.
    assert ("drops out" in report.check("stuck samples").note) == (spells > 1)
    if spells > 1:
        np.testing.assert_array_equal(report.recording.valid("pressure_1"), ~gone)


@pytest.mark.parametrize("rows", [slice(0, 1), slice(0, 3), slice(-2, None)])
def test_a_sensor_that_is_not_ready_does_not_count(rows: slice) -> None:
    values = TRIAL["pressure_1"].copy()
    values[rows] = 500.0
    report = check_recording(with_values(TRIAL, "pressure_1", values))
    assert "drops out 1 time" in report.check("stuck samples").note
    np.testing.assert_array_equal(report.recording.valid("pressure_1"), values != 500.0)


@pytest.mark.parametrize("let_go", [True, False])
def test_what_is_let_go_or_driven_as_a_recording_begins_counts(let_go: bool) -> None:
    # Of 2 s half of it is gone in every step of 1 s; or all of it comes with the first command.
    time, noise = np.arange(400.0), 1e-3 * np.random.default_rng(1).normal(size=400)
    command = np.zeros(400) if let_go else np.where(time > 0.0, 5.0, 0.0)
    read = 5.0 * 0.5**time if let_go else command
    trial = recording_of("trial", 1.0, {"drive [V]": command}, {"speed [m/s]": read + noise})
    assert not not_ready(trial, "speed").any()


def test_a_machine_that_friction_holds_is_a_doubt_and_no_lost_data() -> None:
    # Slow moves whose sensor has noise, and rests between them where it has none.
    time = TRIAL.time
    phase = time % 2.0
    moving = (phase > 0.6) & (phase < 1.4)
    ramp = np.where((time // 2.0) % 2 == 0, 1.0, -1.0) * np.clip((phase - 0.6) / 0.8, 0.0, 1.0)
    ramp = np.where((time // 2.0) % 2 == 0, ramp, 1.0 + ramp)
    noise = np.random.default_rng(3).normal(0.0, 1e-3, len(time)) * moving
    values = np.round(0.02 * ramp + noise, 4)
    found = check_recording(with_values(TRIAL, "angle", values)).check("stuck samples")
    assert found.result == "pass" and found.doubt, found
    assert "goes on without a jump" in found.note and "friction" in found.note


def test_a_machine_that_is_held_to_the_end_is_a_doubt_whatever_its_command_does() -> None:
    # Its only reading has noise in motion and none at rest; the command goes on against friction.
    time = TRIAL.time
    moving = time < 2.0
    noise = np.random.default_rng(4).normal(0.0, 1e-3, len(time)) * moving
    values = np.round(0.1 * np.sin(np.minimum(time, 2.0)) + noise, 4)
    held = with_values(TRIAL, "angle", values).select(["valve", "angle"])
    report = check_recording(held)
    assert np.ptp(held["valve"][time > 3.0]) > 0
    assert report.fit and report.check("stuck samples").doubt, str(report)
    assert report.recording.valid("angle").all()


@pytest.mark.parametrize("name", ["angle", "pressure_1"])
@pytest.mark.parametrize("quantile", [0.9, 0.98])
def test_clipped_sensor(name: str, quantile: float) -> None:
    limit = float(np.quantile(TRIAL[name], quantile))
    report = check_recording(with_values(TRIAL, name, np.minimum(TRIAL[name], limit)))
    check = report.check("clipping")
    assert check.result == "corrected", check.note
    assert check.values["limits"][name] == pytest.approx(limit)
    # The values stay, because the true ones lie beyond; the samples are excluded.
    lost = np.mean(~report.recording.valid(name))
    assert lost == pytest.approx(1 - quantile, abs=0.01)
    assert report.recording[name].max() == pytest.approx(limit)


def test_numbers_without_a_unit_that_fit_in_one_of_them_alone(tmp_path: Path) -> None:
    path = tmp_path / "run.csv"
    degrees = np.rad2deg(TRIAL["angle"])
    np.savetxt(path, np.column_stack([TRIAL.time, degrees]), "%.8g", ",", header="t,angle")
    recording = read_recording(path, signals={"angle": "rad"})
    check = check_recording(recording, ranges={"angle": (-1.0, 1.5)}).check("units")
    assert (check.result, "look like deg, not rad" in check.note) == ("unfit", True)
    plain = check_recording(recording, ranges={"angle": (-90.0, 90.0)}).check("units")
    assert (plain.result, plain.note) == ("pass", "no unit stated for angle: taken as SI")


def test_the_size_of_a_state_is_that_of_the_output_which_reads_it() -> None:
    model = machine(lambda m: {"x": 0.1 * m.u.valve}, "x m scale=0.1", "valve V", "x m")
    valve = np.random.default_rng(1).uniform(-1.0, 1.0, 40).repeat(20)
    x = 1e3 * np.cumsum(0.1 * 0.01 * valve)
    trial = recorded(0.01, {"valve V": valve}, {"x m": x})
    found = check_units(trial, expectations(trial, model=model))
    assert found.result == "unfit" and "look like mm, not m" in found.note


def test_absolute_pressures_become_gauge() -> None:
    # A trial in which a muscle is vented: it rests at ambient.
    vented = TRIAL
    for name in ("pressure_1", "pressure_2"):
        gauge = np.maximum(TRIAL[name] - 2.5e5, 0.0) + 600 * np.sin(np.arange(len(TRIAL)))
        vented = with_values(vented, name, gauge * 2)
    assert check_recording(vented).check("gauge pressure").result == "pass"
    absolute = vented
    for name in ("pressure_1", "pressure_2"):
        absolute = with_values(absolute, name, vented[name] + 101325.0)
    report = check_recording(absolute)
    assert report.check("gauge pressure").result == "corrected"
    assert np.allclose(report.recording["pressure_1"], vented["pressure_1"])


@pytest.mark.parametrize(("least", "told"), [(0.0, "falls to"), (1.2e5, "never below")])
def test_pressures_are_told_in_the_unit_in_which_they_are_read(least: float, told: str) -> None:
    wave = least + 0.8e5 * (1.0 + np.sin(0.01 * np.arange(1000.0)))
    trial = recorded(0.01, {"pump V": np.sign(np.sin(0.003 * np.arange(1000.0)))}, {"p kPa": wave})
    pressure = replace(trial.signal("p"), values=wave, kind="pressure", display_unit="kPa")
    note = check_recording(trial.with_signal(pressure)).check("gauge pressure").note
    assert note.startswith(told) and "kPa" in note and "bar" not in note, note


@pytest.mark.parametrize("turned", [1.0, -1.0])
def test_what_swings_both_ways_is_neither_a_doubt_nor_a_wrong_sign(turned: float) -> None:
    # A stiff loop whose position has next to no noise: what is new in it alternates.
    rng, step = np.random.default_rng(0), 1e-3
    force = np.repeat(100.0 * rng.integers(0, 2, 24), 500)
    time, position, speed = step * np.arange(len(force)), np.zeros(len(force)), 0.0
    for k in range(1, len(force)):
        speed += step * (force[k] / 50.0 - 8100.0 * position[k - 1] - 126.0 * speed)
        position[k] = position[k - 1] + step * speed
    position += 0.01 * np.sin(2.0 * time) + 1e-9 * rng.normal(size=len(time))
    trial = recorded(time, {"force N": turned * force}, {"position m": position})
    check = check_recording(trial, model=servo_axis()).check("signs")
    assert check.result == "not checked" and "both ways" in check.note and not check.doubt, check


@pytest.mark.parametrize(("strength", "result"), [(-1.0, "unfit"), (-0.5, "unfit"), (-0.05, "not")])
def test_a_cause_that_hardly_acts_does_not_tell_its_sign(strength: float, result: str) -> None:
    # Exchanged columns act as strongly as the model says. Where friction balances a slow motion,
    # the acceleration is nothing but what is left over.
    rng = np.random.default_rng(0)
    time = 0.002 * np.arange(5000)
    push = np.interp(time, time[::250], rng.normal(size=20))
    speed = np.cumsum(strength * push) * 0.002
    trial = recorded(time, {}, {"force N": push, "angle rad": np.cumsum(speed) * 0.002})
    pair = ("force", "angle")
    found = check_signs(trial, Expected(signs={pair: 1}, slopes={pair: 1.0}))
    assert found.result.startswith(result)
    assert ("hardly acts" in found.note) is (result == "not")


def test_what_no_reversed_column_explains_is_a_doubt() -> None:
    # b drives a as the model says, a drives b the other way: turning either column turns both.
    rng = np.random.default_rng(0)
    time, pushes = 0.002 * np.arange(5000), np.repeat(rng.normal(size=(2, 100)), 50, axis=1)
    x, v = np.zeros((2, len(time))), np.zeros(2)
    for k in range(1, len(time)):
        a, b = x[:, k - 1]
        force = np.array([30.0 * b - 50.0 * a, -30.0 * a - 50.0 * b])
        v += 0.002 * (force - 8.0 * v + pushes[:, k])
        x[:, k] = x[:, k - 1] + 0.002 * v
    given = {f"push_{i} N": u for i, u in enumerate(pushes)}
    trial = recorded(time, given, {"a m": x[0], "b m": x[1]})
    pairs = {("a", "b"): 1, ("b", "a"): 1}
    found = check_signs(trial, Expected(signs=pairs, slopes=dict.fromkeys(pairs, 30.0)))
    assert found.result == "pass" and found.doubt
    assert "as expected: b -> a; a -> b has the wrong sign" in found.note
    turned = check_signs(trial, Expected(signs={("a", "b"): 1}, slopes={("a", "b"): 30.0}))
    assert turned.result == "unfit" and "reversed" in turned.note


def test_a_sink_that_warms_with_its_cooler_does_not_turn_a_sign() -> None:
    # The current cools a plate; the sink that would warm it follows the current at once.
    rng = np.random.default_rng(0)
    current = np.repeat(rng.uniform(0.0, 4.0, 50), 20)
    sink = np.round(298.0 + 0.3 * current + rng.normal(0.0, 0.3, 1000), 1)
    plate = np.full(1000, 296.0)
    for k in range(1, 1000):
        rate = 0.02 * (sink[k - 1] - plate[k - 1]) - 0.3 * current[k - 1]
        plate[k] = plate[k - 1] + rate
    signs = {("current", "plate"): -1, ("sink", "plate"): 1}
    read = plate + rng.normal(0.0, 0.02, 1000)
    trial = recorded(2.0, {"current A": current, "sink K": sink}, {"plate K": read})
    found = check_signs(trial, Expected(signs=signs))
    assert found.result == "pass" and "wrong" not in found.note
    # Were the current reversed, nothing else would explain its answer.
    wrong = check_signs(trial, Expected(signs={**signs, ("current", "plate"): 1}))
    assert wrong.result == "unfit" and "current or plate is probably reversed" in wrong.note


def test_a_flow_has_the_sign_that_its_own_warmth_gives_it() -> None:
    def heater(m: Any) -> dict[str, Any]:
        return {"t": 1e3 * m.u.flow * (m.u.t_in - m.x.t)}

    # Nobody declares how warm what flows in is: by default it is at zero kelvin.
    model = machine(heater, "t K 300", "flow m3/s, t_in K", "t K")
    flow = np.random.default_rng(1).uniform(1e-4, 3e-4, 400).repeat(5)
    t = [310.0]
    for f in flow[:-1]:
        t.append(t[-1] + 0.1 * (1e3 * f * (340.0 - t[-1]) - 0.1 * (t[-1] - 290.0)))
    trial = recorded(0.1, {"flow m3/s": flow, "t_in K": 0 * flow + 340.0}, {"t K": np.array(t)})
    found = check_signs(trial, expectations(trial, model=model))
    assert found.result != "unfit"


def test_what_a_loop_holds_against_what_would_fall_has_its_sign() -> None:
    def magnet(m: Any) -> dict[str, Any]:
        force = 41.0 * m.u.current + 2.2e5 * m.x.gap
        return {"gap": m.x.speed, "speed": force / 2.3}

    model = machine(magnet, "gap m, speed m/s", "current A", "gap m")
    # A load that nobody records pushes it about, which the current answers to.
    rng = np.random.default_rng(2)
    gap, speed, gaps, currents = 0.0, 0.0, [], []
    for load in np.repeat(rng.uniform(-25.0, 25.0, 50), 50):
        gaps.append(gap + rng.normal(0.0, 2e-7))
        read = gap + rng.normal(0.0, 2e-7)
        currents.append(-12e3 * read - 22.0 * speed)
        for _ in range(4):
            speed += 5e-5 * (41.0 * currents[-1] + 2.2e5 * gap + load) / 2.3
            gap += 5e-5 * speed
    trial = recorded(2e-4, {"current A": np.array(currents)}, {"gap m": np.array(gaps)})
    found = check_signs(trial, expectations(trial, model=model))
    assert found.result != "unfit" and "a loop holds the machine" in found.note


def test_what_a_balancing_command_goes_with_has_no_sign_of_its_own() -> None:
    def rates(force: Any, v: Any, theta: Any) -> tuple[Any, Any]:
        a = (force - 0.1 * v - 1.96 * theta) / 0.5
        return a, (9.81 * theta - a) / 0.3

    def cart(m: Any) -> dict[str, Any]:
        a, alpha = rates(m.u.force, m.x.v, m.x.theta)
        return {"p": m.x.v, "v": a, "theta": m.x.omega, "omega": alpha}

    model = machine(cart, "p m, v m/s, theta rad, omega rad/s", "force N", "p m, theta rad")
    rng = np.random.default_rng(3)
    p, v, theta, omega = 0.0, 0.0, 0.03, 0.0
    rows = []
    for goal in rng.uniform(-0.3, 0.3, 20).repeat(150):
        force = 3.16 * (p - goal) + 6.2 * v + 38.0 * theta + 8.6 * omega
        rows.append((force, p + rng.normal(0.0, 4e-4), theta + rng.normal(0.0, 7e-4)))
        for _ in range(20):
            a, alpha = rates(force - 0.8 * math.tanh(v / 0.01), v, theta)
            v, omega = v + 5e-4 * a, omega + 5e-4 * alpha
            p, theta = p + 5e-4 * v, theta + 5e-4 * omega
    pushed, place, tilt = np.array(rows).T
    trial = recorded(0.01, {"force N": pushed}, {"p m": place, "theta rad": tilt})
    found = check_signs(trial, expectations(trial, model=model))
    assert found.result != "unfit" and "theta -> p cannot be told: a loop" in found.note


def test_what_begins_the_other_way_than_it_goes_has_no_sign() -> None:
    def converter(m: Any) -> dict[str, Any]:
        off = 1.0 - m.u.duty
        current = (m.u.supply - off * m.x.voltage) / 47e-6
        voltage = (off * m.x.current - m.x.voltage / 24.0) / 220e-6
        return {"current": current, "voltage": voltage}

    boost = machine(
        converter,
        "current A 2, voltage V 24",
        "duty 1 nominal=0.5, supply V nominal=12",
        "current A, voltage V",
    )
    assert response_signs(boost) == {("duty", "current"): 1, ("supply", "current"): 1}


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize("rate", [-1e6, 1e6, math.inf])
def test_a_plant_of_any_speed_has_signs(rate: float) -> None:
    def equations(m: Any) -> tuple[dict[str, Any], dict[str, Any]]:
        own = rate * m.x.a if math.isfinite(rate) else ca.sqrt(m.x.a)
        return {"a": m.u.drive + own, "b": 2.0 * m.x.a - 1e-3 * m.x.b}, {"a": m.x.a, "b": m.x.b}

    plant = machine(
        equations, "a m scale=1, b m scale=1", "drive N scale=1", "a m scale=1, b m scale=1"
    )
    assert response_signs(plant) == {("drive", "a"): 1}


def test_a_command_that_moves_cause_and_motion_does_not_turn_a_sign() -> None:
    # The drive of a crane moves the cart and swings the load, whose weight pulls at the cart too.
    case = next(c for c in plan(60, 9200) if c.name == "foreign-9207")
    recordings = [r for n, r in case.recordings().items() if n.startswith("hold")]
    driven = [r.with_roles({"voltage": "command"}) for r in recordings]
    assert all(check_recording(r, model=case.build()).fit for r in driven)


def test_a_level_that_stays_at_the_end_of_its_sensor_is_not_lost() -> None:
    case = next(c for c in plan(60, 9300) if c.name == "foreign-9342")
    for recording in case.recordings().values():
        assert check_recording(recording, model=case.build()).fit, recording.name


def trolley(size: float = 0.0) -> Model:
    def equations(m):
        acceleration = (m.u.drive - 10.0 * m.x.speed) / 100.0
        return {"place": m.x.speed, "speed": acceleration}, {"place": m.x.place}

    return Model(
        "trolley",
        equations,
        states=(State("place", "m"), State("speed", "m/s")),
        inputs=(Input("drive", "N", lower=-5000.0, upper=5000.0),),
        outputs=(Output("place", "m", size, display_unit="mm"),),
    )


def test_the_range_of_a_drive_does_not_tell_how_far_a_machine_moves() -> None:
    # Seven metres are little of what the drive could do, and are no metres called millimetres.
    time = np.arange(1000) * 0.04
    place = 3.5 * np.sin(time) + 1e-3 * np.cos(70 * time)
    recording = recorded(time, {"drive N": 300.0 * np.sin(time)}, {"place m": place})
    row = MappedColumn("place [mm]", "place", "mm", "m", "name")
    recording = replace(recording, mapping=ColumnMapping((row,)))
    check = check_recording(recording, model=trolley()).check("units")
    assert (check.result, check.doubt) == ("pass", False)
    # Of a size that somebody declared it is one.
    check = check_recording(recording, model=trolley(7e4)).check("units")
    assert (check.result, "look like m, not mm" in check.note) == ("unfit", True)


def test_a_measured_temperature_of_the_surroundings_is_plausible() -> None:
    def equations(m):
        return {"air": (m.u.outside - m.x.air) / 100.0}, {"air": m.x.air}

    model = machine(
        equations, "air K 290", "outside K nominal=280 display_unit=degC", "air K display_unit=degC"
    )
    time = np.arange(500.0)
    outside, air = 278.0 + 5.0 * np.sin(time / 50), 278.0 + 2.0 * np.sin(time / 50 - 1)
    trial = recorded(time, {"outside K": outside}, {"air K": air})
    check = check_recording(trial, model=model).check("units")
    assert (check.result, check.doubt) == ("pass", False)


def test_a_switch_is_no_drive_that_saturates() -> None:
    model = machine(
        lambda m: {"oven": m.u.heater - m.x.oven / 50.0}, "oven K", "heater 1 0 1", "oven K"
    )
    time = np.arange(500.0)
    trial = recorded(time, {"heater 1": time % 40 < 20}, {"oven K": 20.0 + np.sin(time / 6)})
    report = check_recording(trial, model=model)
    assert report.check("clipping").note == "heater is switched"
    assert "heater 0 to 1;" in report.check("excitation").note


@pytest.mark.parametrize("read", [True, False])
def test_what_goes_with_an_unread_position_has_no_sure_sign(read: bool) -> None:
    def equations(m: Any) -> tuple[dict[str, Any], dict[str, Any]]:
        cable = m.x.drum - m.x.dish + 0.01 * (m.x.turning - m.x.rate)
        rates = {
            "drum": m.x.turning,
            "turning": m.u.torque - cable,
            "dish": m.x.rate,
            "rate": cable - 0.1 * m.x.rate,
        }
        shown = {"turning": m.x.turning, "dish": m.x.dish}
        return rates, {**shown, "drum": m.x.drum} if read else shown

    names = ("drum", "turning", "dish", "rate")
    outputs = ("turning", "dish", "drum") if read else ("turning", "dish")
    plant = Model(
        "telescope",
        equations,
        states=tuple(State(n, "rad" if n in ("drum", "dish") else "rad/s") for n in names),
        inputs=(Input("torque", "N m"),),
        outputs=tuple(Output(n, "rad/s" if n == "turning" else "rad") for n in outputs),
    )
    assert (("turning", "dish") in response_signs(plant)) is read
