"""Margins of opened loops against python-control and against changed loops."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path
from typing import Any

import control as ct
import numpy as np
import pytest

from controllers.mpc.whole_model import design_mpc
from controllers.pid import CascadePID, FixedGains, design_pid
from controllers.plain.pid_design import design_plain_pid
from controllers.plain.transfer_law import pid_by_hand
from controllers.sensitivity import loop_matrices, peak_sensitivities
from controllers.sliding_mode import design_sliding_mode
from tests.machines import machine
from tests.study.small_study import BY_BANDWIDTH, small_study
from workbench.linearisation import LinearModel, linear_model, linearise
from workbench.operating_point import operating_point
from workbench.plants.arm import arm
from workbench.study.margins import analyse_loop, analyse_study
from workbench.study.read import load_study


@pytest.fixture(scope="module")
def linear() -> LinearModel:
    plant = arm(3).without("bearing_friction")
    return linearise(operating_point(plant, {"angle": math.radians(30)}), verdict=False)


def opened_at_the_command(controller: Any, linear: LinearModel) -> ct.StateSpace:
    """Return plant and controller in series, built by python-control."""
    A, B, C, F, G, H, J = loop_matrices(controller, linear)
    h = controller.sample_time
    plant = ct.ss(A, B, C, np.zeros((len(C), 1)), h)
    law = ct.ss(F, G, H, J, h)
    return -(law * plant)


def test_margins_agree_with_python_control(linear: LinearModel) -> None:
    pid = design_pid(linear)
    found = analyse_loop(pid, linear, points=4000)[1]
    loop = opened_at_the_command(pid, linear)
    omega = np.geomspace(0.3, 0.98 * math.pi / pid.sample_time, 4000)
    response = loop(np.exp(1j * omega * pid.sample_time))
    gain, phase = ct.stability_margins(ct.FRD(response, omega, smooth=True))[:2]
    assert found.gain_margin == pytest.approx(gain, rel=2e-3)
    assert math.degrees(found.phase_margin) == pytest.approx(phase, abs=0.05)
    disk, disk_gain_dB, disk_phase = ct.disk_margins(loop, omega)
    assert found.disk_margin == pytest.approx(disk, rel=2e-3)
    assert 20 * math.log10(found.disk_gain_margin) == pytest.approx(disk_gain_dB, rel=3e-3)
    assert math.degrees(found.disk_phase_margin) == pytest.approx(disk_phase, rel=3e-3)


def test_a_delay_takes_of_the_delay_margin(linear: LinearModel) -> None:
    law = design_pid(linear)
    at_once, late = (analyse_loop(law, linear, delay=late)[-1] for late in (0.0, 0.005))
    assert late.delay_margin == pytest.approx(at_once.delay_margin - 0.005, rel=0.01)
    assert late.sensitivity > at_once.sensitivity


def test_commands_that_are_late_in_every_run_are_late_in_the_loop(tmp_path: Path) -> None:
    study = load_study(small_study(tmp_path))
    scenarios = {n: replace(s, late_samples=1) for n, s in study.scenarios.items()}
    own, late = (
        next(loop for loop in analyse_study(one) if loop.command)
        for one in (study, replace(study, scenarios=scenarios))
    )
    h = next(iter(scenarios.values())).sample_time
    assert late.delay_margin == pytest.approx(own.delay_margin - h, rel=0.02)


@pytest.mark.parametrize("design", [design_pid, design_sliding_mode])
def test_peaks_agree_with_the_design(design: Any, linear: LinearModel) -> None:
    controller = design(linear)
    outer = analyse_loop(controller, linear)[0]
    ms, mt = peak_sensitivities(controller, linear)
    # The grids have 600 and 300 frequencies.
    assert outer.sensitivity == pytest.approx(ms, rel=5e-3)
    assert outer.complementary == pytest.approx(mt, rel=5e-3)


def test_an_mpc_has_margins_too(linear: LinearModel) -> None:
    outer, command = analyse_loop(design_mpc(linear), linear)
    assert outer.stable and command.stable
    assert 1.0 < command.sensitivity < 3.0 and command.delay_margin > 0.002


def test_a_law_that_is_not_linear_at_rest_has_no_margins(tmp_path: Path) -> None:
    designs = (
        BY_BANDWIDTH,
        'design = "scheduled-sliding-mode"\nspecification = { kind = "super-twisting" }\n'
        '[controllers.scheduled]\ndesign = "scheduled-pid"',
    )
    found = analyse_study(load_study(small_study(tmp_path, designs)))
    reasons = {a.controller: a.reason for a in found}
    assert "not linear around rest" in reasons["pid"]
    assert not reasons["scheduled"] and all(a.stable for a in found if not a.reason)


def test_the_gain_margin_is_where_the_loop_becomes_unstable(linear: LinearModel) -> None:
    pid = design_pid(linear)
    margin = analyse_loop(pid, linear, points=4000)[0].gain_margin

    def scaled(factor: float) -> CascadePID:
        # All outer gains act on the angle alone.
        own = pid.gains
        assert isinstance(own, FixedGains)
        outer = [factor * gain for gain in (own.proportional, own.integral, own.derivative)]
        return replace(pid, gains=FixedGains(*outer, own.inner))

    assert analyse_loop(scaled(0.99 * margin), linear)[0].stable
    unstable = analyse_loop(scaled(1.01 * margin), linear)[0]
    assert not unstable.stable and "unstable" in unstable.reason


@pytest.mark.parametrize("damping", [2e-3, 1e-4])
def test_a_light_resonance_is_met_between_frequencies(damping: float) -> None:
    w = 2.0 * math.pi * 0.37
    flexible = machine(
        lambda m: (
            {"turn": m.x.rate, "rate": m.u.torque, "bend": m.x.sway}
            | {"sway": m.u.torque - w**2 * m.x.bend - 2.0 * damping * w * m.x.sway},
            {"turn": m.x.turn + m.x.bend},
        ),
        "turn rad scale=1, rate rad/s scale=1, bend rad scale=1, sway rad/s scale=1",
        "torque rad/s2 -1 1",
        "turn rad 1e-4",
    )
    linear = linearise(operating_point(flexible))
    law = design_plain_pid(linear)
    found, dense = (analyse_loop(law, linear, points=points)[0] for points in (600, 300_000))
    assert len(found.response) < 1000 and np.all(np.diff(found.frequency_Hz) > 0.0)
    peak = [np.abs(a.response[np.abs(a.frequency_Hz - 0.37) < 0.01]).max() for a in (found, dense)]
    assert peak[0] == pytest.approx(peak[1], rel=0.01)
    for name in ("sensitivity", "complementary", "disk_margin", "phase_margin", "gain_margin"):
        assert getattr(found, name) == pytest.approx(getattr(dense, name), rel=2e-3)


def test_a_loop_far_slower_than_its_samples_has_its_margins() -> None:
    # 7 (1 + 1/(10 s)) exp(-s)/(10 s + 1) = 0.7 exp(-s)/s crosses 1 at 0.7 rad/s; samples of 2 ms.
    late = linear_model(ct.tf([1.0], [10.0, 1.0]), delay=1.0)
    law = pid_by_hand(7.0, 0.7, measured="y", actuator="u", sample_time=0.002)
    found = analyse_loop(law, late)[0]
    assert found.crossover_Hz == pytest.approx(0.7 / (2 * math.pi), rel=1e-2)
    assert found.phase_margin == pytest.approx(math.pi / 2 - 0.7, rel=5e-3)
    assert found.gain_margin == pytest.approx(math.pi / 2 / 0.7, rel=5e-3)
    assert found.delay_margin == pytest.approx((math.pi / 2 - 0.7) / 0.7, rel=5e-3)
    assert peak_sensitivities(law, late)[0] == pytest.approx(found.sensitivity, rel=1e-2)
