"""The next experiment: predictions against filters run on made-up recordings of the truth."""

from __future__ import annotations

from functools import lru_cache

import numpy as np
import pytest

from tests.diagnosis.axis_case import diagnosed, observed
from tests.diagnosis.machine_data import recording
from tests.machines import machine
from workbench.diagnosis.estimation.filter import Innovations
from workbench.diagnosis.estimation.observe import observe
from workbench.diagnosis.estimation.prediction_error import Observed
from workbench.diagnosis.estimation.priors import Prior, default_priors
from workbench.diagnosis.estimation.process_noise import fit_with_process_noise
from workbench.diagnosis.estimation.simulated_recordings import pushes, simulated
from workbench.diagnosis.experiment.menu import Experiment, menu, other_settings, with_setting
from workbench.diagnosis.experiment.next_experiment import next_experiment, separate
from workbench.diagnosis.experiment.separation import (
    Explanation,
    Separator,
    reduced,
    separation,
    spread_after,
)
from workbench.errors import WorkbenchError
from workbench.physics.friction import quadratic_drag, viscous_friction
from workbench.plants.arm import arm
from workbench.plants.servo_axis import servo_axis

SAMPLE_TIME = 0.01

SMOOTH_AXIS = servo_axis().without("coulomb_friction")
"""Without stiction, which the filter and the simulation integrate differently."""


def test_reduced_is_the_least_squares_with_what_is_known() -> None:
    rng = np.random.default_rng(0)
    e, j = rng.normal(size=(40, 1)), rng.normal(size=(40, 1, 3))
    known = np.diag([1.0, 4.0, 0.25])
    # An independent route: the knowledge as further rows.
    rows = np.vstack([j[:, 0], np.sqrt(known)])
    right = np.concatenate([e[:, 0], np.zeros(3)])
    step, *_ = np.linalg.lstsq(rows, -right, rcond=None)
    expected = 0.5 * np.sum((right + rows @ step) ** 2)
    assert reduced(Innovations(e, j, e, e, (e, e)), known) == pytest.approx(expected)


def test_what_runs_away_from_its_references_is_not_offered() -> None:
    # A magnetic bearing grows by e in 3 ms, and the menu's own loop does not hold it.
    bearing = machine(
        lambda m: {"x": m.x.v, "v": (4.5e5 * m.x.x + 120.0 * m.u.current) / 4.0},
        "x m scale=1e-4, v m/s scale=0.02",
        "current A -4 4",
        "x m 5e-7",
    )
    rng = np.random.default_rng(0)
    current, x, v = np.zeros(4000), np.zeros(4000), 0.0
    goal = np.repeat(rng.uniform(-8e-5, 8e-5, 40), 100)
    for k in range(3999):
        current[k] = np.clip((-9e5 * (x[k] - goal[k]) - 1200.0 * v - 4.5e5 * goal[k]) / 120, -4, 4)
        v += 2e-4 * (4.5e5 * x[k] + 120.0 * current[k]) / 4.0
        x[k + 1] = x[k] + 2e-4 * v
    seen = observe(bearing, recording("a", 2e-4, {"current [A]": current}, {"x [m]": x}))
    texts = [e.text for e in menu(bearing, [seen])]
    assert not any("follow" in text for text in texts), texts


@pytest.mark.long
def test_the_menu_of_the_arm_stays_within_its_range() -> None:
    plant = arm(load_kg=3)
    volts = 5.0 + 0.02 * pushes(1500, largest=30.0, hold=150)
    seen = simulated(plant, volts, sample_time=0.004)
    offered = menu(plant, [seen])
    assert len(offered) > 10
    assert len({e.text for e in offered}) == len(offered)
    names = [q.name for q in plant.outputs]
    for e in offered:
        assert e.sample_time * (len(e.inputs) - 1) <= 20.0
        assert np.all((e.inputs >= 0.0) & (e.inputs <= 10.0))
        read = e.measurements(plant, seen.start)
        assert read is not None
        angle = np.degrees(read[:, names.index("angle")])
        assert angle.min() >= -1.0 and angle.max() <= 61.0
    loops = [e for e in offered if e.text.startswith("in closed loop, a slow triangle")]
    read = loops[0].measurements(plant, seen.start)
    assert read is not None
    # The loop moves the arm through most of its range, which no open-loop input needs to do.
    assert np.ptp(np.degrees(read[:, names.index("angle")])) > 20.0


def test_the_menu_is_written_in_the_units_in_which_people_read_inputs_and_long_times() -> None:
    plant = machine(
        lambda m: {"warm": (m.u.power - m.x.warm) / 7200.0},
        "warm K scale=1",
        "power 1 0 1 0.5 scale=1 display_unit=%",
        "warm K 0.01 scale=1",
    )
    time = 360.0 * np.arange(400)
    power = 0.5 + 0.2 * np.sign(np.sin(time / 9000.0))
    run = recording("a", 360.0, {"power [1]": power}, {"warm [K]": power})
    said = [e.text for e in menu(plant, [observe(plant, run)])]
    assert any("of power between 30 and 70 %, for" in text for text in said), said
    assert all(text.endswith((" h", " d")) for text in said), said


def test_what_was_never_at_rest_moves_about_the_middle_of_what_was_recorded() -> None:
    plant = machine(
        lambda m: {"salt": (20.0 - m.u.flow * m.x.salt) / 50.0},
        "salt kg/m3 scale=1",
        "flow m3/s 0",
        "salt kg/m3 0.01 scale=1",
    )
    time = np.arange(400.0)
    flow = 4.0 + 2.0 * np.sign(np.sin(time / 20.0))
    salt = [5.0]
    for f in flow[:-1]:
        salt.append(salt[-1] + (20.0 - f * salt[-1]) / 50.0)
    run = recording("a", 1.0, {"flow [m3/s]": flow}, {"salt [kg/m3]": salt})
    found = menu(plant, [observe(plant, run)])
    assert any("pulses of flow" in e.text for e in found)
    assert not any(e.text.startswith("rest") for e in found)
    assert all(e.inputs.min() >= 0.0 for e in found)


def test_what_goes_to_one_side_of_its_rest_stays_there() -> None:
    plant = machine(
        lambda m: {"speed": 2.0 - 0.1 * m.x.speed - m.u.push},
        "speed rad/s scale=1",
        "push N",
        "speed rad/s 0.01 scale=1",
    )
    time = 0.1 * np.arange(400)
    push = np.where(np.sin(time) > 0.5, 1.5, 0.0)
    speed = [1.0]
    for u in push[:-1]:
        speed.append(speed[-1] + 0.1 * (2.0 - 0.1 * speed[-1] - u))
    run = recording("a", 0.1, {"push [N]": push}, {"speed [rad/s]": speed})
    found = menu(plant, [observe(plant, run)])
    played = [e for e in found if " of push " in e.text]
    # Nor does a prediction leave what was recorded, where no sensor or state declares a range.
    room = 0.05 * np.ptp(speed)
    for e in found:
        read = e.measurements(plant, [1.0])
        assert read is not None
        assert read.min() >= min(speed) - room and read.max() <= max(speed) + room
    assert {e.text.partition(" of push ")[2] for e in played} >= {"between 0 and 1.5 N, for 80 s"}
    assert all(e.inputs.min() >= 0.0 for e in played)


def test_settings_are_those_a_user_can_change() -> None:
    words = dict(other_settings(arm(load_kg=3)))
    assert words["at 1 kg load"] == {"load": 1.0}
    assert words["at 7 bar supply pressure"] == {"supply_pressure": 7e5}
    assert not any("load" in w for w, _ in other_settings(arm(load_kg=3), ["load"]))
    assert other_settings(servo_axis()) == ()
    rest = Experiment("rest", 0.01, np.full((100, 1), 5.0))
    heavy = with_setting(rest, "at 5 kg load", {"load": 5.0})
    assert heavy.on(arm(load_kg=3)).parameter("load").value == 5.0
    assert rest.on(arm(load_kg=3)).parameter("load").value == 3.0


@lru_cache(maxsize=1)
def drags() -> tuple[tuple[Explanation, Explanation], Observed]:
    """Quadratic drag, or a linear spring, on weak pushes that show little of either."""
    axis = SMOOTH_AXIS
    drag = quadratic_drag("axis.force", coefficient=30.0, upper=2000.0)
    # At rest first: the start is read from the first samples.
    force = np.concatenate([np.zeros(10), pushes(290, largest=60.0, seed=4)])
    seen = simulated(axis.with_effect(drag), force, sample_time=SAMPLE_TIME)
    rival = viscous_friction("axis.force", coefficient=20.0, upper=500.0, name="more")
    found = []
    for effect, own in ((drag, "quadratic_drag.coefficient"), (rival, "more.coefficient")):
        model = axis.with_effect(effect)
        priors = [*default_priors(axis, ["mass", "offset"])]
        size = model.parameter(own)
        priors.append(Prior(own, 0.0, size.upper, size.lower, size.upper))
        fit = fit_with_process_noise(model, [seen], priors, noise_scale=0.03)
        found.append(Explanation(effect.name, fit, own))
    return (found[0], found[1]), seen


def test_the_predicted_gain_is_that_of_a_made_up_recording() -> None:
    (true, other), seen = drags()
    ranked = separate([true, other], [seen], SMOOTH_AXIS)
    assert ranked[0].sigma > 3.0
    assert ranked[0].sigma >= ranked[-1].sigma
    for told in ranked[:10:3]:
        # An independent route: make the recording, with noise, and refit both to the two.
        force = np.concatenate([np.zeros((10, 1)), told.experiment.inputs])
        made = simulated(true.fit.model, force, sample_time=SAMPLE_TIME, seed=5)
        costs = {}
        for e in (true, other):
            priors = [q.prior for q in e.fit.refit.estimates]
            for number, recordings in ((1, [seen]), (2, [seen, made])):
                costs[e.name, number] = fit_with_process_noise(
                    e.fit.model,
                    recordings,
                    priors,
                    start={q.name: q.value for q in e.fit.refit.estimates},
                    noise_scale=min(true.fit.noise_scale, other.fit.noise_scale),
                    follow=False,
                ).cost
        gain = (costs[other.name, 2] - costs[true.name, 2]) - (
            costs[other.name, 1] - costs[true.name, 1]
        )
        # A factor: far apart, models are not linear and outliers count less. And noise, which
        # moves the gain by about the root of twice itself.
        noise = 4 * np.sqrt(2 * told.gain) + 2.0
        assert told.gain / 3 - noise < gain < 3 * told.gain + noise


def test_an_experiment_on_which_rivals_agree_separates_nothing() -> None:
    (true, other), seen = drags()
    rest = Experiment("rest", SAMPLE_TIME, np.zeros((300, 1)))
    separator = Separator(seen, SMOOTH_AXIS)
    assert separation(separator, true, other, rest).sigma < 1.0
    assert separation(separator, true, true, rest).sigma == 0.0


def test_the_spread_of_a_size_shrinks_as_a_refit_shrinks_it() -> None:
    (true, _), seen = drags()
    force = np.concatenate([np.zeros(10), pushes(590, largest=300.0, hold=100, seed=3)])
    experiment = Experiment("strong pushes", SAMPLE_TIME, force[:, None])
    now, then = spread_after(Separator(seen, SMOOTH_AXIS), true, experiment)
    made = simulated(true.fit.model, force, sample_time=SAMPLE_TIME, seed=6)
    priors = [q.prior for q in true.fit.refit.estimates]
    both = fit_with_process_noise(
        true.fit.model, [seen, made], priors, noise_scale=true.fit.noise_scale, follow=False
    )
    assert now == true.fit.refit.estimate(true.size).std
    # The prediction keeps the present factor for correlated errors, the refit finds its own.
    assert then < 0.5 * now
    assert then == pytest.approx(both.refit.estimate(true.size).std, rel=0.6)


def test_nothing_to_plan_from_is_refused() -> None:
    with pytest.raises(WorkbenchError, match="planned from recordings"):
        menu(servo_axis(), [])


def test_what_is_proposed_after_a_name_and_after_silence() -> None:
    for hidden in (True, False):
        step, plan = next_experiment(diagnosed(hidden), [observed(1, hidden=hidden)])
        assert plan is None or not plan.settings
        if step:
            assert str(step["sentence"]).endswith(".")
            # One explanation is left, or none: there is nothing to separate.
            assert step["separation_sigma"] is None
