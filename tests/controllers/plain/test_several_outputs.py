"""Laws of several commands and outputs: on equations of NumPy, by SciPy's LSODA, and in C."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from functools import cache, partial
from pathlib import Path
from typing import Any

import casadi as ca
import control as ct
import numpy as np
import pytest
from scipy.integrate import solve_ivp

from controllers.h_infinity.synthesis import has_slycot
from controllers.plain.limits import LoopLimits
from controllers.plain.loop import loop_of
from controllers.plain.pairing import best_pairings, interaction, relative_gains, zeros
from controllers.plain.selection import settled_after
from controllers.plain.state_feedback import LQISpecification, reachable_speed
from controllers.plain.transfer_law import pid_by_hand
from controllers.sensitivity import least_gain, loop_matrices
from tests.controllers import families
from tests.controllers.in_c import InC, agrees, agrees_on
from tests.machines import at_rest, machine, stepped
from workbench.errors import WorkbenchError
from workbench.linearisation import LinearModel, linear_model
from workbench.linearisation.time_scales import usual_sample_time
from workbench.model import Input, Model
from workbench.study.margins import analyse_loop
from workbench.verification import Scenario, Steps, guarded, metrics, step_scenario, verify

FAMILIES = ["plain-pid", "lqi", "plain-mpc", *(["plain-h-infinity"] if has_slycot() else [])]

MPC_LONG = [pytest.param(n, marks=pytest.mark.long) if n == "plain-mpc" else n for n in FAMILIES]
"""Each family, of which an MPC takes longest to design."""

H, SPREAD = 2.0, np.array([0.7, 0.6])
AREA, HOLE, PUMP = np.array([28e-4, 32e-4] * 2), np.array([7.1e-6, 5.7e-6] * 2), 3.3e-6


def tank_rates(h: Any, u: Any, root: Callable[[Any], Any], spread: Any = SPREAD) -> list[Any]:
    """Johansson's quadruple tank: levels in m, pumps in V."""
    q = [hole * root(19.62 * level) for hole, level in zip(HOLE, h, strict=True)]
    inflow = [
        spread[0] * PUMP * u[0] + q[2],
        spread[1] * PUMP * u[1] + q[3],
        (1.0 - spread[1]) * PUMP * u[1],
        (1.0 - spread[0]) * PUMP * u[0],
    ]
    return [(a - b) / area for a, b, area in zip(inflow, q, AREA, strict=True)]


def tanks(spread: Any = SPREAD, slew: float = math.inf) -> Model:
    def equations(m: Any) -> Any:
        h, u = [m.x[f"h{i}"] for i in range(4)], (m.u.left, m.u.right)
        rates = tank_rates(h, u, lambda v: ca.sqrt(ca.fmax(v, 1e-6)), spread)
        return {f"h{i}": rates[i] for i in range(4)}, {"low": h[0], "other": h[1]}

    levels = enumerate((0.12, 0.12, 0.02, 0.02))
    return machine(
        equations,
        ", ".join(f"h{i} m {level} scale=0.1" for i, level in levels),
        ", ".join(f"{n} V 0 10 3 scale=3 slew={slew}" for n in ("left", "right")),
        ", ".join(f"{n} m 1e-4 scale=0.02" for n in ("low", "other")),
    )


@pytest.fixture(scope="module")
def linear() -> LinearModel:
    return at_rest(tanks())


designed = partial(families.designed, sample_time=H)


@pytest.fixture(scope="module")
def law_of(linear: LinearModel) -> Callable[[str], Any]:
    """The law of each family for both tanks, designed once for all tests."""
    return cache(lambda name: designed(name, linear))


@pytest.mark.long
@pytest.mark.parametrize("name", FAMILIES)
def test_each_output_follows_and_leaves_the_other(
    name: str, linear: LinearModel, law_of: Callable[[str], Any], tmp_path: Path
) -> None:
    law = law_of(name)
    assert law.controlled == ("low", "other") and law.actuators == ("left", "right")
    x = np.array(linear.x0)
    state = law.initial_state(tuple(linear.y0))
    asked = np.array(linear.y0) + np.array([0.02, 0.0])
    seen = []
    for k in range(500):
        if k == 250:
            asked[1] += 0.02
        seen.append(x[:2])
        u, state, _ = law.step(state, tuple(x[:2]), tuple(asked))
        held = solve_ivp(
            lambda t, h, u=u: tank_rates(h, u, np.sqrt), (0, H), x, "LSODA", rtol=1e-9, atol=1e-12
        )
        x = held.y[:, -1]
    away = np.array(seen) - linear.y0
    # The step of one, then of the other: there within 2 %, the one that rests is left alone.
    for i, part in ((0, away[:250, 0]), (1, away[250:, 1])):
        assert np.abs(part[125:] - 0.02).max() < 4e-4, i
        assert part.max() < 0.0215
    assert np.abs(away[:250, 1]).max() < 0.008 and np.abs(away[250:, 0] - 0.02).max() < 0.008
    scenario = step_scenario("low", linear.y0[0], linear.y0[0] + 0.02, hold=200.0, sample_time=H)
    rest = step_scenario("other", linear.y0[1], linear.y0[1]).references
    scenario = replace(scenario, references={**scenario.references, **rest})
    run = verify(law, tanks(), scenario)
    same = verify(guarded(law, tanks()), tanks(), scenario)
    np.testing.assert_array_equal(same.inputs, run.inputs)
    found = metrics(run)
    assert found["other.interaction"].value < 0.008
    assert "low.interaction" not in found and "other.settling_time" not in found
    agrees_on(run, law, tmp_path, 1e-13)


@pytest.mark.long
@pytest.mark.parametrize("name", FAMILIES)
def test_units_change_no_loop(name: str) -> None:
    A = np.array([[-0.1, 0.02], [0.0, -0.05]])
    B, C = np.array([[0.1, -0.06], [0.04, 0.08]]), np.eye(2)
    sizes = {"u": 1e5, "v": 1e-3, "y": 1e-6, "z": 300.0}
    found = []
    for factor in (dict.fromkeys(sizes, 1.0), sizes):
        into, out = (np.array([factor[n] for n in names]) for names in (("u", "v"), ("y", "z")))
        system = ct.ss(A, B / into, out[:, None] * C, 0, inputs=["u", "v"], outputs=["y", "z"])
        limits = {n: (-size, size) for n, size in factor.items()}
        law = designed(name, linear_model(system, limits=limits), sample_time=0.5)
        F, G, K, J = law.around_rest()
        z = np.exp(1j * np.array([1e-2, 0.1, 1.0]))
        whole = np.array([K @ np.linalg.solve(v * np.eye(len(F)) - F, G) + J for v in z])
        found.append(whole / into[:, None] * np.tile(out, 2))
    np.testing.assert_allclose(found[1], found[0], rtol=2e-3, atol=2e-3 * np.abs(found[0]).max())


@pytest.mark.long
@pytest.mark.parametrize("name", MPC_LONG)
def test_a_pump_at_its_end_keeps_the_other_tank_from_nothing(name: str) -> None:
    A, B = np.diag([-0.1, -0.1]), np.array([[0.1, 0.01], [0.02, 0.1]])
    system = ct.ss(A, B, np.eye(2), 0, inputs=["u", "v"], outputs=["y", "z"])
    linear = linear_model(system, limits=dict.fromkeys(("u", "v", "y", "z"), (-1.0, 1.0)))
    law = designed(name, linear, sample_time=0.5)
    over = np.linalg.matrix_power(np.eye(2) + 0.5 * A / 200, 200)
    x, state, seen = np.zeros(2), law.initial_state((0.0, 0.0)), []
    # More than can be reached, for long, and back again.
    for k in range(900):
        asked = (3.0 if k < 400 else 0.2, 0.4)
        u, state, _ = law.step(state, tuple(x), asked)
        assert max(map(abs, u)) <= 1.0
        x = over @ x + np.linalg.solve(A, (over - np.eye(2)) @ B @ np.array(u))
        seen.append(x)
    assert seen[399][0] > 0.9
    late = np.abs(np.array(seen[640:]) - [0.2, 0.4])
    assert late.max() < 0.01


def test_relative_gains_and_pairs_are_those_of_the_book() -> None:
    # Wood and Berry's column: 2.0 for top by reflux; Seborg et al., Process Dynamics and Control.
    G = np.array([[12.8, -18.9], [6.6, -19.4]])
    np.testing.assert_allclose(relative_gains(G), [[2.01, -1.01], [-1.01, 2.01]], atol=0.01)
    system = ct.ss(-np.eye(2), G[:, ::-1], np.eye(2), 0, inputs=["steam", "reflux"], outputs=2)
    loop = loop_of(linear_model(system))
    assert best_pairings(loop)[0].commands == (1, 0)
    assert best_pairings(loop)[0].niederlinski == pytest.approx(0.498, abs=1e-3)


def test_a_zero_in_the_right_half_plane_is_said_and_kept_to() -> None:
    other = at_rest(tanks(spread=np.array([0.43, 0.34])))
    loop = loop_of(other)
    expected = [v.real for v in ct.ss(other.A, other.B, other.C, other.D).zeros() if v.real > 0]
    found = [v.real for v in zeros(loop) if v.real > 0.0]
    np.testing.assert_allclose(found, expected, rtol=1e-6)
    assert any("a zero in the right half plane at" in sentence for sentence in interaction(loop))
    assert best_pairings(loop)[0].commands == (1, 0)
    law = designed("lqi", other)
    run = verify(law, other, step_both(other, 0.02))
    # Opposite steps excite it: slower than in the plant without.
    assert metrics(run)["low.settling_time"].value > 1.0 / found[0]


def step_both(linear: LinearModel, size: float) -> Any:
    pairs = zip(linear.output_names, linear.y0, (size, -size), strict=True)
    one, two = (step_scenario(n, y, y + d, hold=900.0, sample_time=H) for n, y, d in pairs)
    return replace(one, references={**one.references, **two.references})


@pytest.mark.long
def test_no_pairing_is_refused_and_a_decoupler_is_not() -> None:
    # A known plant of three without a pairing whose relative gains are positive.
    G = np.array([[1.0, 1.0, -0.1], [0.1, 2.0, -1.0], [-2.0, -3.0, 1.0]])
    G = np.linalg.inv(G) if np.all(np.diag(relative_gains(G)) > 0.0) else G
    system = ct.ss(-0.1 * np.eye(3), 0.1 * G, np.eye(3), 0)
    with pytest.raises(WorkbenchError, match="no pairing of .* negative relative gain"):
        designed("plain-pid", system, decoupled=False)
    law = designed("plain-pid", system)
    assert law.name == "decoupled PID"
    run = verify(law, linear_model(system), step_scenario_of_three())
    assert np.abs(run.outputs[-1] - [1.0, 0.0, 0.0]).max() < 0.01


@pytest.mark.long
def test_pids_of_joints_whose_inertia_couples_fast_are_decoupled_or_slow() -> None:
    # A planar arm of two links: damping alone couples nothing at rest, the inertia does fast.
    inertia, damping = np.array([[0.6, 0.2], [0.2, 0.1]]), np.diag([0.9, 0.25])
    fast = -np.linalg.solve(inertia, damping)
    A = np.block([[np.zeros((2, 2)), np.eye(2)], [np.zeros((2, 2)), fast]])
    B = np.vstack([np.zeros((2, 2)), np.linalg.inv(inertia)])
    names = {"inputs": ["upper", "lower"], "outputs": ["shoulder", "elbow"]}
    system = ct.ss(A, B, np.eye(2, 4), 0, **names)
    ends = {"upper": (-20.0, 20.0), "lower": (-8.0, 8.0)}
    linear = linear_model(system, limits=ends | dict.fromkeys(names["outputs"], (-0.3, 0.3)))
    settled = {}
    for decoupled in (None, False):
        law = designed("plain-pid", linear, sample_time=0.005, decoupled=decoupled)
        assert law.name == ("PID" if decoupled is False else "decoupled PID")
        x, state, seen = np.zeros(4), law.initial_state((0.0, 0.0)), []
        for _ in range(1200):
            u, state, _ = law.step(state, tuple(x[:2]), (0.02, 0.0))
            for _ in range(5):
                x = x + 0.001 * (A @ x + B @ np.array(u) + 0.0005 * A @ (A @ x + B @ np.array(u)))
            seen.append(x[:2])
        away = np.abs(np.array(seen) / 0.02 - [1.0, 0.0])
        settled[decoupled] = 0.005 * np.flatnonzero(away[:, 0] > 0.02)[-1]
        assert max(np.array(seen)[:, 0]) < 1.1 * 0.02
        assert away[:, 1].max() < (0.25 if decoupled is False else 0.1)
    assert settled[None] < 0.5 < 2.0 * settled[False]


def step_scenario_of_three() -> Any:
    one = step_scenario("y_0", 0.0, 1.0, hold=400.0, sample_time=H)
    others = {n: step_scenario(n, 0.0, 0.0).references[n] for n in ("y_1", "y_2")}
    return replace(one, references={**one.references, **others})


@pytest.mark.parametrize(
    ("C", "told", "said"),
    [
        (np.eye(2), {"actuator": "u"}, "u does not move z"),
        (
            [[1.0, 0.0], [1.0, 1.0]],
            {"actuator": "w"},
            "cannot all be followed by w: as many outputs as there are commands",
        ),
        ([[1.0, 0.0], [2.0, 0.0]], {}, "y and z cannot be held independently by u and w"),
        ([[1.0, 1.0], [0.0, 1.0]], {"measured": "y,x"}, "'x'"),
    ],
)
def test_what_cannot_be_followed_together_is_said(C: Any, told: Any, said: str) -> None:
    B = np.array([[1.0, 0.0, 1.0], [0.0, 1.0, 1.0]])
    system = ct.ss(-np.diag([1.0, 2.0]), B, C, 0, inputs=["u", "v", "w"], outputs=["y", "z"])
    for name in FAMILIES:
        with pytest.raises(WorkbenchError, match=said):
            designed(name, system, **{"measured": "y, z", **told})


def test_by_default_those_outputs_are_followed_that_are_held_independently() -> None:
    # A position and its speed: at rest the speed is 0, whatever the commands.
    A = np.array([[0.0, 1.0, 0.0], [0.0, -1.0, 0.0], [0.0, 0.0, -2.0]])
    B = np.array([[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]])
    system = ct.ss(A, B, np.eye(3), 0, inputs=["u", "v"], outputs=["position", "speed", "heat"])
    assert loop_of(system).measured == ("position", "heat")
    assert loop_of(system, "heat").actuators == ("v",)
    with pytest.raises(WorkbenchError, match="position and speed cannot all be followed by u"):
        loop_of(system, "position, speed")


def test_least_gain_is_that_of_the_best_units() -> None:
    rng = np.random.default_rng(2)
    for k in (2, 3):
        M = rng.normal(size=(k, k)) + 1j * rng.normal(size=(k, k))
        sizes = np.exp(rng.uniform(-6.0, 6.0, (20_000, k)))
        tried = np.linalg.norm(sizes[:, :, None] * M / sizes[:, None], 2, axis=(1, 2)).min()
        assert tried > (0.9999 if k == 2 else 0.95) * least_gain(M)
        assert least_gain(np.diag(sizes[0]) @ M / sizes[0]) == pytest.approx(
            least_gain(M), rel=1e-2
        )
    # What acts one way only is no loop, as of pools of a canal.
    for pools in ([[0.5, 1e9], [0.0, 0.3]], [[0.5, 0.0, 0.0], [-1.0, 0.3, 0.0], [0.0, -1.0, 0.2]]):
        assert least_gain(np.array(pools)) == pytest.approx(0.5, rel=1e-3)


@pytest.mark.long
def test_pids_that_are_stable_together_alone() -> None:
    # A beam over two magnets: each one alone lets the other end fall.
    A = np.zeros((4, 4))
    A[0, 1] = A[2, 3] = 1.0
    A[1, 0], A[3, 2] = 40.0, 60.0
    B = np.array([[0.0, 0.0], [1.0, 1.0], [0.0, 0.0], [3.0, -3.0]])
    C = np.array([[1.0, 0.0, 1.0, 0.0], [1.0, 0.0, -1.0, 0.0]])
    law = designed("plain-pid", ct.ss(A, B, C, 0), sample_time=0.002)
    x, state = np.array([0.0, 0.0, 0.01, 0.0]), law.initial_state((0.01, -0.01))
    for _ in range(2000):
        u, state, _ = law.step(state, tuple(C @ x), (0.0, 0.0))
        x = x + 0.002 * (A @ x + B @ np.array(u) + 0.001 * A @ (A @ x + B @ np.array(u)))
    assert np.abs(x).max() < 1e-4


@pytest.mark.long
@pytest.mark.parametrize("name", FAMILIES)
def test_a_pump_that_changes_slowly_is_asked_for_no_more(name: str, tmp_path: Path) -> None:
    slow = 0.02
    model = tanks(slew=slow)
    linear = at_rest(model)
    law = designed(name, linear)
    y0 = linear.y0.tolist()
    one = step_scenario("low", y0[0], y0[0] + 0.04, back=True, hold=500.0, sample_time=H)
    rest = step_scenario("other", y0[1], y0[1]).references
    scenario = replace(one, references={**one.references, **rest})
    run = verify(law, model, scenario)
    steps = np.abs(np.diff(run.inputs, axis=0))
    assert steps.max() == pytest.approx(slow * H, rel=1e-6)
    # The law knows: what it asks for is what is applied, so that nothing winds up.
    memory, asked = law.initial_state(tuple(run.measured[0].tolist())), []
    for row, *wanted in zip(run.measured.tolist(), *run.references.values(), strict=True):
        u, memory, _ = law.step(memory, tuple(row), tuple(wanted))
        asked.append(u)
    agrees_on(run, law, tmp_path, 1e-13)
    assert np.abs(np.diff(np.array(asked), axis=0)).max() < slow * H * (1.0 + 1e-6)
    found = metrics(run)
    assert found["low.overshoot"].value < 0.12
    assert found["low.steady_error"].value < 4e-4 and found["other.steady_error"].value < 4e-4


@pytest.mark.long
def test_noise_takes_no_more_of_a_slew_than_of_a_range() -> None:
    rotor = machine(
        lambda m: {"speed": -0.012 * m.x.speed - m.x.blade, "blade": (m.u.pitch - m.x.blade) / 0.3},
        "speed rad/s, blade rad scale=0.2",
        "pitch rad -0.3 1.2 slew=0.14",
        "speed rad/s 0.02",
    )
    linear = at_rest(rotor)
    law = designed("lqi", linear, sample_time=0.02)
    assert stepped(law, rotor, "speed", 0.0, 0.4, hold=40.0)["settling_time"] < 15.0


def test_a_slew_is_positive() -> None:
    with pytest.raises(WorkbenchError, match="slew of u is 0"):
        Input("u", "V", slew=0.0)


def test_an_mpc_at_a_pace_is_the_same_in_c(
    linear: LinearModel, law_of: Callable[[str], Any], tmp_path: Path
) -> None:
    law = replace(law_of("plain-mpc"), pace=(1e-4, 3e-4), brake=(2e-5, math.inf))
    y0 = tuple(linear.y0.tolist())
    state, asked = law.initial_state(y0), (y0[0] + 0.004, y0[1] - 0.02)
    measured = [(y0[0] + 1e-3 * math.sin(0.3 * k), y0[1]) for k in range(60)]
    agrees(law, tmp_path, measured, [asked] * 60, 1e-12)
    for seen in measured:
        _, state, _ = law.step(state, seen, asked)
    # The first has braked and arrived, the second is on its way.
    np.testing.assert_allclose(state.paced[:2], np.array(y0) + [4e-3, -0.018], atol=1e-12)
    np.testing.assert_allclose(state.paced[2:], [0.0, -3e-4], atol=1e-12)


@pytest.mark.parametrize("name", FAMILIES)
def test_what_all_channels_bear_at_once_is_what_no_change_of_less_exceeds(
    name: str, linear: LinearModel, law_of: Callable[[str], Any]
) -> None:
    law = law_of(name)
    *each, whole = analyse_loop(law, linear)
    assert [own.opened for own in each] == ["low", "other", "left", "right"]
    assert whole.opened == "all at once"
    # At once they bear no more than one by one.
    assert whole.disk_margin <= min(own.disk_margin for own in each) * (1.0 + 1e-6)
    assert whole.sensitivity >= max(own.sensitivity for own in each) * (1.0 - 1e-6)
    # Gains of both commands within the disk, both ways, leave the loop stable; NumPy's eigenvalues.
    A, B, C, F, G, K, J = loop_matrices(law, linear)
    # Frequencies end a little below half of the sampling rate.
    half = 0.5 * 0.995 * whole.disk_margin
    for signs in ((1, 1), (1, -1), (-1, 1), (-1, -1)):
        gain = np.diag([((1 + half) / (1 - half)) ** sign for sign in signs])
        closed = np.block([[A + B @ gain @ J @ C, B @ gain @ K], [G @ C, F]])
        assert np.abs(np.linalg.eigvals(closed)).max() < 1.0


@pytest.mark.parametrize("name", FAMILIES)
@pytest.mark.parametrize(
    ("moved", "shown", "said"),
    [
        (0.0, 1.0, "x_1_ grows by itself, as exp.0.3 t., and u and v do not move it"),
        (1.0, 0.0, "x_1_ grows by itself, as exp.0.3 t., and y and z do not show it"),
    ],
)
def test_what_grows_out_of_reach_or_out_of_sight_is_said(
    name: str, moved: float, shown: float, said: str
) -> None:
    A = np.diag([-1.0, 0.3, -2.0])
    B = np.array([[1.0, 0.0], [moved, 0.0], [0.0, 1.0]])
    C = np.array([[1.0, shown, 0.0], [0.0, 0.0, 1.0]])
    system = ct.ss(A, B, C, 0, inputs=["u", "v"], outputs=["y", "z"])
    with pytest.raises(WorkbenchError, match=said.replace("_1_", "_1")):
        designed(name, system, sample_time=0.1)


@pytest.mark.long
@pytest.mark.parametrize("name", MPC_LONG)
def test_what_one_of_more_commands_cannot_give_the_others_do(name: str, tmp_path: Path) -> None:
    A = np.array([[-0.2, 0.05, 0.0], [0.02, -0.1, 0.0], [0.1, 0.0, -1.0]])
    B = np.array([[0.1, 0.03, 0.02], [0.01, 0.08, -0.03], [0.0, 0.0, 0.1]])
    C = np.array([[1.0, 0.0, 0.0], [0.0, 1.0, 0.2]])
    names = {"inputs": ["u", "v", "w"], "outputs": ["y", "z"]}
    ends = dict.fromkeys(("u", "v", "w", "y", "z"), (-2.0, 2.0))
    law = designed(name, linear_model(ct.ss(A, B, C, 0, **names), limits=ends), sample_time=0.1)
    assert law.actuators == (("u", "v") if name == "plain-pid" else ("u", "v", "w"))
    # Two of them hold no more than 0.92.
    asked = (0.8 if name == "plain-pid" else 1.0, 0.0)
    x, state = np.zeros(3), law.initial_state((0.0, 0.0))
    in_c = InC(law, tmp_path)
    in_c.start((0.0, 0.0))
    most = 0.0
    for _ in range(900):
        seen = tuple((C @ x).tolist())
        u, state, _ = law.step(state, seen, asked)
        in_c.step(seen, asked)
        np.testing.assert_allclose(in_c.command, u, rtol=0, atol=1e-12)
        most = max(most, *map(abs, u))
        rate = B[:, : len(u)] @ np.array(u)
        middle = x + 0.05 * (A @ x + rate)
        x = x + 0.1 * (A @ middle + rate)
    # The first command alone is at its end on the way.
    assert most == pytest.approx(2.0) or name == "plain-h-infinity"
    assert np.abs(C @ x - asked).max() < 0.02


@pytest.mark.parametrize("pace", [1e-9, 1.0, 1e9])
@pytest.mark.parametrize("units", [(1e-9, 1e9, 1e9, 1e-9), (1e5, 2e10, 6e-10, 3e5)])
def test_what_commands_hold_is_alike_in_any_unit(
    pace: float, units: tuple[float, float, float, float]
) -> None:
    A = np.array([[-1.0, 0.3, 0.0], [0.2, -2.0, 0.5], [0.0, 0.1, -0.5]]) / pace
    B = np.array([[1.0, 0.2], [0.0, 1.0], [0.4, 0.0]]) / pace / units[:2]
    C = np.array([[1.0, 0.0, 0.3], [0.0, 1.0, 0.0]]) * np.array(units[2:])[:, None]
    linear = linear_model(ct.ss(A, B, C, np.zeros((2, 2)), outputs=["p", "q"]))
    # By default those are followed that the commands hold independently.
    assert loop_of(linear).measured == ("p", "q")


@pytest.mark.long
def test_late_outputs_of_unlike_size_are_led_as_fast_as_they_can_be() -> None:
    """Of two outputs of Ogunnaike and Ray's column one goes ten times as far as the other."""

    def late(gain: float, lag: float, delay: float) -> Any:
        return ct.tf([gain], [lag, 1.0]) * ct.tf(*ct.pade(delay, 2))

    column = ct.combine_tf(
        [
            [late(-2.36, 5.0, 3.0), late(-0.01, 7.09, 1.2)],
            [late(46.2, 10.9, 9.4), late(0.87, 11.6, 1.0)],
        ]
    )
    linear = linear_model(column)
    outputs = linear.operating_point.model.outputs
    # Nobody says how far they go: each counts by how far the commands move it.
    assert [q.scale for q in outputs] == pytest.approx([1.3, 16.0], rel=0.5)
    # Nor does anybody say that a command may go by 1, which would move one within a sample of 0.02.
    assert usual_sample_time(linear, linear.output_names) == usual_sample_time(linear) == 0.1
    want = LQISpecification(linear.output_names, sample_time=0.25)
    # No state feedback that asks for what the plant does by itself is within its limits.
    assert reachable_speed(LoopLimits(want.loop(linear), want)) > 0.03


def airliner() -> LinearModel:
    """Roll and yaw of an airliner by ailerons, behind their actuator, and by its rudder."""
    A = [
        [-0.0558, 0.0802, -0.9968, 0.0415, 0.0],
        [-3.05, -0.465, 0.388, 0.0, 0.143],
        [0.598, -0.0318, -0.115, 0.0, 0.00775],
        [0.0, 1.0, 0.0805, 0.0, 0.0],
        [0.0, 0.0, 0.0, 0.0, -10.0],
    ]
    B = [[0.0, 0.0073], [0.0, 0.153], [0.0, -0.475], [0.0, 0.0], [10.0, 0.0]]
    system = ct.ss(A, B, [[0, 0, 0, 1, 0], [1, 0, 0, 0, 0]], 0, inputs=["ail", "rud"])
    return linear_model(system, limits={"ail": (-0.4, 0.4), "rud": (-0.3, 0.3)})


@pytest.mark.long
def test_an_output_may_be_much_faster_than_another() -> None:
    law = designed("lqi", airliner(), measured="y_0, y_1", sample_time=0.05)
    assert settled_after(law, airliner(), {"y_0": 1.0}) < 100.0


def test_what_is_not_stable_never_settles() -> None:
    law = pid_by_hand(-2.0, -1.0, measured="y", actuator="u", sample_time=0.1)
    assert settled_after(law, linear_model("1/(s (s + 1))"), {"y": 1.0}) == math.inf


@pytest.mark.long
def test_pairs_are_those_of_fast_loops_where_these_are_better() -> None:
    # A looper between the stands of a hot strip mill: at rest its pairs are the other way round.
    A = [
        [0, 1, 0, 0, 0],
        [0, -5, -30, 8, 0],
        [0, 6, -9, 0, 12],
        [0, 0, 0, -25, 0],
        [0, 0, 0, 0, -15],
    ]
    B = [[0, 0], [0, 0], [0, 0], [25, 0], [0, 15]]
    names = {"inputs": ["torque", "mill"], "outputs": ["angle", "tension"]}
    system = ct.ss(A, B, [[1, 0, 0, 0, 0], [0, 0, 1, 0, 0]], np.zeros((2, 2)), **names)
    looper = linear_model(system, limits=5.0)
    law = designed("plain-pid", looper, measured="angle, tension", sample_time=0.002)
    assert settled_after(law, looper, {"angle": 0.25, "tension": 0.06}) < 1.8


def test_what_stands_for_a_delay_is_told_as_one() -> None:
    late = linear_model("[3 exp(-12 s)/(90 s + 1), exp(-30 s)/(140 s + 1); 1, exp(-2 s)/s]")
    told = str(late)
    assert "u_1 acts 12 s late on y_1\n  u_2 acts 30 s late on y_1, 2 s late on y_2" in told
    half = str(linear_model("[1/(s + 1), exp(-s)/(s + 2); 0, 3/(s^2 + s + 1)]"))
    assert half.endswith("u_2 acts 1 s late on y_1")
    assert str(linear_model("exp(-s)/(s + 2) + exp(-3 s)/s")).endswith("u acts 1 s and 3 s late")
    assert told.count("\n  mode ") == 3 and "140 s" in told
    # Only the zeros that are the plant's own are said.
    behind = linear_model("[exp(-9 s)/(s + 1), 0; 0, exp(-9 s) (1 - 2 s)/(s + 1)^2]")
    said = [line for line in interaction(loop_of(behind)) if "zero in the right" in line]
    assert len(said) == 1 and "at 0.5 rad/s" in said[0]


@pytest.mark.long
def test_an_mpc_brakes_where_its_horizon_ends_long_before_a_step() -> None:
    # A tape between two reels: its tension is fast, its place takes 0.32 s of all of the torques.
    radius, inertia, drag, tape = 0.05, 0.05, 0.01, np.array([-500.0, 500.0, -0.05, 0.05])
    turned = np.outer([radius, -radius], tape) / inertia - drag / inertia * np.eye(2, 4, 2)
    A = np.vstack([np.eye(2, 4, 2) * radius, turned])
    B = np.vstack([np.zeros((2, 2)), np.eye(2) / inertia])
    C = np.vstack([[0.5, 0.5, 0.0, 0.0], tape])
    reels = linear_model(ct.ss(A, B, C, 0), limits={"u[0]": (-10, 10), "u[1]": (-10, 10)})
    law = designed("plain-mpc", reels, sample_time=0.001)
    found = first_stepped(law, reels, (0.0, 0.0), 0.25, 1.0)
    assert found["y_0.overshoot"] < 0.02 and found["y_0.settling_time"] < 0.45


@pytest.mark.long
def test_integrals_of_outputs_in_small_units_go_on_while_a_command_of_others_waits() -> None:
    # Gas leaves at the end of its valve, so that noise holds it there half of the time: counted in
    # m and Pa, the integral of the level stood still, and the level went 0.8 m astray.
    vessel = machine(
        lambda m: {
            "level": 0.004 - 1.2e-5 * m.u.valve * ca.sqrt(ca.fmax(m.x.pressure, 0.0)),
            "pressure": 1e5 / 3.0 * (0.1 - 1e-7 * m.u.gas * m.x.pressure),
        },
        "level m 1.5, pressure Pa 1e6 scale=1e6",
        "valve 1 0 1 0.3, gas 1 0 1 0.3",
        "level m 0.002, pressure Pa 500",
    )
    linear = at_rest(vessel, level=1.5, pressure=1e6)
    found = first_stepped(designed("lqi", linear), vessel, (1.5, 1e6), 1.0, 1000.0)
    assert found["level.overshoot"] < 0.02 and found["level.settling_time"] < 300.0


def first_stepped(
    law: Any, plant: Any, rest: tuple[float, float], size: float, hold: float
) -> dict[str, float]:
    """Return the metrics of a step of the first output, in SI, where the other one stays."""
    (first, y), (other, stays) = zip(law.controlled, rest, strict=True)
    one = step_scenario(first, y, y + size, hold=hold, sample_time=law.sample_time)
    still = step_scenario(other, stays, stays).references
    run = verify(law, plant, replace(one, references={**one.references, **still}))
    return {name: found.value for name, found in metrics(run).items()}


@pytest.mark.long
def test_an_mpc_waits_for_no_wall_that_gets_warm_in_days() -> None:
    # Two rooms and heavy walls: their air takes hours, the walls 36 h.
    heat, flow = np.array([3e6, 5e6, 8e7]), np.array([[0, 80, 150], [80, 0, 120], [150, 120, 0.0]])
    A = (flow - np.diag(flow.sum(axis=1) + [60.0, 40.0, 200.0])) / heat[:, None]
    B = np.diag(1000.0 / heat)[:, :2]
    rooms = linear_model(ct.ss(A, B, np.eye(2, 3), 0), limits={f"u[{i}]": (-5, 5) for i in (0, 1)})
    law = designed("plain-mpc", rooms, sample_time=5.0)
    assert settled_after(law, rooms, dict.fromkeys(law.controlled, 0.01)) < 200.0


def test_an_mpc_leans_a_scooter_that_gathers_speed_for_a_minute() -> None:
    # Pitch answers within a second, the speed at which drag holds the lean within 17 s.
    A = [[0, 1, 0, 0], [24.6, 0, 0, 0.17], [0, 0, 0, 1], [-17.0, 0, 0, -0.17]]
    lean = ct.ss(A, [[0.0], [-0.29], [0.0], [0.28]], [[1, 0, 0, 0]], 0)
    plant = linear_model(lean, limits={"u[0]": (-80, 80)})
    law = designed("plain-mpc", plant, sample_time=0.005, noise=1e-3)
    assert settled_after(law, plant, dict.fromkeys(law.controlled, 1e-3)) < 2.0


@pytest.mark.long
@pytest.mark.parametrize("name", ["plain-mpc", "plain-h-infinity"])
def test_a_delay_alone_beside_a_lag_is_neither_overshot_nor_waited_for(name: str) -> None:
    """A pipe that delays one output and lets its command stir the other, which is at once."""
    if name == "plain-h-infinity" and not has_slycot():
        pytest.skip("needs slycot")
    linear = linear_model("[exp(-10 s), 0.5/(40 s + 1); 0.3/(30 s + 1), 1/(30 s + 1)]")
    law = designed(name, linear, sample_time=0.5)
    for moved, within in (("y_1", 120.0), ("y_2", 40.0)):
        references = {
            each: Steps((0.0, 1.0), (0.0, float(each == moved))) for each in law.controlled
        }
        found = metrics(verify(law, linear, Scenario("step", references, 200.0, 0.5)))
        assert found[f"{moved}.settling_time"].value < within
        # Between two samples of a pulse, which passes a delay alone as it is, nothing is hidden.
        assert found[f"{moved}.overshoot"].value < 0.05
