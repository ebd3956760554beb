"""Plants that need no file of Python: a transfer function in one line, matrices of MATLAB."""

from __future__ import annotations

import math
from collections.abc import Callable
from pathlib import Path
from typing import Any

import casadi as ca
import control as ct
import numpy as np
import pytest
from scipy.io import savemat

from controllers.plain.state_feedback import design_lqi
from tests.machines import at_rest
from tests.shell import Shell
from workbench.errors import WorkbenchError
from workbench.linearisation import linear_model, linearise
from workbench.linearisation.exact_delays import channels_of
from workbench.linearisation.transfer import transfer_function
from workbench.model.linear_system import with_free_coefficients
from workbench.operating_point import operating_point
from workbench.physics.library import library
from workbench.plants.plant import adopt
from workbench.plants.registry import PLANTS
from workbench.simulation import simulate


def answer(plant: str, s: complex) -> np.ndarray:
    model = PLANTS.get(plant).model({})
    linear = at_rest(model)
    return transfer_function(linear.A, linear.B, linear.C, linear.D, s)


def late(time: float, s: complex) -> complex:
    return complex(np.exp(-time * s))


@pytest.mark.parametrize(
    ("text", "exact"),
    [
        ("1/(s+1)", lambda s: 1 / (s + 1)),
        ("2 exp(-0.1 s) / (s (0.5 s + 1))", lambda s: 2 * late(0.1, s) / (s * (0.5 * s + 1))),
        ("2e^(-0.5s)/(3s+1)^2", lambda s: 2 * late(0.5, s) / (3 * s + 1) ** 2),
        ("-3.5E-1*(1 - 2s)/(s**2+.2s+1)", lambda s: -0.35 * (1 - 2 * s) / (s**2 + 0.2 * s + 1)),
        (
            "exp(-0.5s) tf([1 3], [2, 1 5e-1])",
            lambda s: late(0.5, s) * (s + 3) / (2 * s * s + s + 0.5),
        ),
        ("1/s + 1/s^2", lambda s: 1 / s + 1 / s**2),
        ("(1/2) s/(s+1) - exp(-s)/(s+2)", lambda s: 0.5 * s / (s + 1) - late(1.0, s) / (s + 2)),
    ],
)
def test_a_line_means_what_it_says(text: str, exact: object) -> None:
    s = 0.3j
    assert callable(exact)
    assert answer(text, s)[0, 0] == pytest.approx(exact(s), abs=1e-6)


def test_common_factors_and_delays_have_states_once() -> None:
    assert len(PLANTS.get("1/s + 1/s^2").model({}).states) == 2
    # Both answers of a command come after the second that they have in common.
    one = PLANTS.get("[exp(-s)/(s + 1); exp(-s)/(s + 2)]").model({})
    assert len(one.states) == 5 and [q.name for q in one.outputs] == ["y_1", "y_2"]


def test_what_stands_for_a_delay_is_no_coefficient_to_refit_and_no_place() -> None:
    texts = ("exp(-s)/(2 s + 1)", "1/(2 s + 1)", "1/(2 s + 1) + exp(-s)/(s + 3)")
    late, prompt, both = (PLANTS.get(text).model({}) for text in texts)
    # A gain and a time constant, and where the lag is, whatever comes before it.
    assert len(with_free_coefficients(late).parameters) == 2
    assert len(with_free_coefficients(prompt).parameters) == 2
    assert [port.name for port in late.ports] == [port.name for port in prompt.ports]
    assert with_free_coefficients(both) is both


def test_a_product_of_two_poles_may_go_as_far_as_both_of_them() -> None:
    model = with_free_coefficients(PLANTS.get("3/((5 s + 1) (2 s + 1) (s + 1))").model({}))
    ends = {q.name: (q.lower, q.upper) for q in model.parameters}
    # 0.2 and 0.5 1/s are the motion, whose place is read, and 1 1/s comes before.
    assert ends["A_0_1"] == pytest.approx((-0.4, 0.0))
    assert ends["A_2_2"] == pytest.approx((-2.0, 0.0))


@pytest.mark.parametrize(("text", "exact", "free"), [
    ("2/(s (0.5 s + 1))", lambda s: 2 / (s * (0.5 * s + 1)), 2),
    ("1/(s (s + 2) (0.1 s + 1))", lambda s: 1 / (s * (s + 2) * (0.1 * s + 1)), 3),
    ("exp(-0.1 s)/(s (s + 2) (0.1 s + 1))",
     lambda s: late(0.1, s) / (s * (s + 2) * (0.1 * s + 1)), 3),
    ("5/(s (s^2 + 4 s + 400))", lambda s: 5 / (s * (s * s + 4 * s + 400)), 3),
    ("1/(s (s^2 + 0.4 s + 1))", lambda s: 1 / (s * (s * s + 0.4 * s + 1)), 3),
    ("(s + 3)/((s^2 + s + 4) (s^2 + 3 s + 900))",
     lambda s: (s + 3) / ((s * s + s + 4) * (s * s + 3 * s + 900)), 6),
    ("1/((s + 2) (s^2 + 0.4 s + 100))", lambda s: 1 / ((s + 2) * (s * s + 0.4 * s + 100)), 4),
])  # fmt: skip
def test_friction_acts_on_a_speed_whose_place_is_read(
    text: str, exact: Callable[[complex], complex], free: int
) -> None:
    model = PLANTS.get(text).model({})
    (friction,) = (h for h in library(model) if h.name == "coulomb_friction")
    names = [q.name for q in model.states]
    speed = model.exact.x[names.index(friction.ports[0].removesuffix(".rate"))]
    places = [ca.is_equal(rate, speed) for rate in ca.vertsplit(model.exact.rates)]
    assert sum(places) == 1
    assert ca.depends_on(model.exact.outputs, model.exact.x[places.index(True)])
    assert len(with_free_coefficients(model).parameters) == free
    assert answer(text, 0.7j)[0, 0] == pytest.approx(exact(0.7j), rel=1e-6)


def test_a_column_of_a_distillation_has_rows_for_outputs() -> None:
    """R. K. Wood and M. W. Berry, Chem. Eng. Sci. 28 (1973) 1707; times in minutes."""
    column = (
        "[12.8e^(-s)/(16.7s+1), -18.9e^(-3s)/(21s+1); 6.6e^(-7s)/(10.9s+1), -19.4e^(-3s)/(14.4s+1)]"
    )
    s = 0.05j
    exact = [
        [12.8 * late(1, s) / (16.7 * s + 1), -18.9 * late(3, s) / (21 * s + 1)],
        [6.6 * late(7, s) / (10.9 * s + 1), -19.4 * late(3, s) / (14.4 * s + 1)],
    ]
    np.testing.assert_allclose(answer(column, s), exact, atol=1e-5)


def test_two_pools_of_a_canal_keep_their_delays(shell: Shell) -> None:
    pools = "[exp(-180 s)/(4000 s), -1/(4000 s); 0, exp(-300 s)/(6000 s)]"
    known = channels_of(linear_model(pools))
    assert known is not None and sorted(known.stood_in) == pytest.approx([180.0, 300.0])
    # What stands for a delay answers the wrong way first, which no pool does.
    said = shell("linearise --plant", Path(pools)).out
    assert "pairs of single loops: y_1 by u_1" in said and "the wrong way" not in said


@pytest.mark.parametrize(
    ("plant", "zero"),
    [("exp(-5 s) (1 - 3 s)/((10 s + 1)(2 s + 1))", "0.333"), ("exp(-5 s)/(10 s + 1)", "")],
)
def test_a_zero_in_the_right_half_plane_is_told(plant: str, zero: str, shell: Shell) -> None:
    said = shell("linearise --plant", Path(plant)).out
    assert (f"a zero in the right half plane at {zero} rad/s: y" in said) == bool(zero)
    assert ("wrong way" in said) == bool(zero)


def test_a_step_that_goes_the_wrong_way_shows_it(shell: Shell) -> None:
    told = shell("verify -c lqi -c plain-pid --limit 3 --plant", Path("(1 - 5 s)/(s + 1)^2"))
    # ln 2 over the zero: one that settles within it goes by more than its step.
    assert "by more than its step where that settles within 3.47 s" in told.err
    assert "undershoot" in told.out and "every 10 ms" in told.out
    told = shell("verify -c lqi -c plain-pid --limit 3 --plant", Path("1/(s + 1)^2"))
    assert "overshoot" in told.out and "undershoot" not in told.out


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("K/(s+1)", "'K' stands where a number, s, exp"),
        ("1/2s", "Write 1/(2 s) or (1/2) s"),
        ("s^2/(s+1)", "add the lag of its filter"),
        ("1/(1+exp(-s))", "divides by what is late"),
        ("1/(s+1", "its end stands behind '1/(s+1'"),
        ("1/(s+1))", "')' stands behind '1/(s+1)'"),
        ("exp(s)/(s+1)", "T above 0 s"),
        ("1/(s-s)", "divides by zero"),
        ("(s-1)/((s-1)*(s+1))", "divides out s = 1 rad/s"),
        ("1/(s^2-2s+5) * (s^2-2s+5)", "which grows by itself"),
        ("[1/s, 2/s; 3/s]", "have 2, 1 entries"),
        ("(s+1)^0.5/s", "a whole exponent"),
        ("1/s $", "'$' stands behind '1/s'"),
        ("1/(2p + 1)", "'p' stands behind '1/(2'"),
        ("tf(1, [1 1], 'InputDelay', 2)", "'tf' stands where a number"),
        ("arm.slx", "linmod('arm'); save arm.mat A B C D"),
        ("arm.fmu", "only its own program runs"),
    ],
)
def test_what_is_no_transfer_function_is_told_where(text: str, said: str) -> None:
    with pytest.raises(WorkbenchError) as told:
        PLANTS.get(text)
    assert said in str(told.value)


def test_matrices_go_to_matlab_and_back(tmp_path: Path, shell: Shell) -> None:
    file = tmp_path / "axis.mat"
    shell("linearise --plant servo-axis --out", file)
    model = PLANTS.get(str(file)).model({"limit": 3.0})
    assert [q.name for q in model.outputs] == ["position"]
    assert [(q.name, q.lower, q.upper) for q in model.inputs] == [("force", -3.0, 3.0)]
    assert [q.name for q in model.states] == ["position", "speed"]


def test_a_line_is_designed_for(shell: Shell) -> None:
    told = shell("verify -c plain-pid --plant 2*exp(-0.1*s)/(s*(0.5*s+1)) --limit 5").out
    assert "step 0 to 0.25" in told and "nan" not in told


def test_a_struct_of_matlab_says_its_delay_and_sample_time(tmp_path: Path) -> None:
    savemat(tmp_path / "lag.mat", {"G": {"num": [2.0], "den": [3.0, 1.0], "InputDelay": 0.5}})
    s = 0.4j
    found = answer(str(tmp_path / "lag.mat"), s)[0, 0]
    assert found == pytest.approx(2.0 * late(0.5, s) / (3.0 * s + 1.0), abs=1e-6)
    held = {"a": 0.9, "b": 0.1, "c": [[1.0], [2.0]], "d": 0.0, "Ts": 0.2}
    savemat(tmp_path / "held.mat", held)
    sampled = PLANTS.get(str(tmp_path / "held.mat")).model({})
    assert len(sampled.outputs) == 2
    # Its pole keeps the time of the samples: 0.9 = exp(a h).
    linear = at_rest(sampled)
    assert linear.poles[0] == pytest.approx(np.log(0.9) / 0.2)


def test_a_text_of_octave_holds_matrices(tmp_path: Path) -> None:
    sizes = "# rows: 2\n# columns: 2\n"
    (tmp_path / "lag.mat").write_text(
        "# Created by Octave 8.4.0\n"
        f"# name: A\n# type: matrix\n{sizes} -1 3\n 0 -2\n\n\n"
        f"# name: B\n# type: diagonal matrix\n{sizes}1\n4\n\n\n"
        "# name: C\n# type: matrix\n# rows: 1\n# columns: 2\n 1 0\n\n\n"
    )
    s = 0.4j
    found = answer(str(tmp_path / "lag.mat"), s)
    assert found == pytest.approx(np.array([[1.0, 12.0 / (s + 2.0)]]) / (s + 1.0))


def test_lines_of_text_name_states_and_version_4_is_read(tmp_path: Path) -> None:
    kept = {"A": -np.eye(2), "B": [1.0, 2.0], "C": [1.0, 2.0]}
    savemat(tmp_path / "named.mat", {**kept, "StateName": ["p", "v"]})
    named = PLANTS.get(str(tmp_path / "named.mat")).model({})
    assert [q.name for q in named.states] == ["p", "v"]
    savemat(tmp_path / "old.mat", kept, format="4")
    assert len(PLANTS.get(str(tmp_path / "old.mat")).model({}).states) == 2


def test_a_file_without_a_system_is_told(tmp_path: Path) -> None:
    savemat(tmp_path / "data.mat", {"time": [0.0, 1.0]})
    with pytest.raises(WorkbenchError, match="holds time, and no system"):
        PLANTS.get(str(tmp_path / "data.mat"))
    with pytest.raises(WorkbenchError, match="cannot read plant"):
        PLANTS.get(str(tmp_path / "missing.mat"))
    for odd in ({"A": [1.0, 2.0, 3.0], "B": [1.0], "C": [1.0]}, {"num": "x", "den": [1.0]}):
        savemat(tmp_path / "odd.mat", odd)
        with pytest.raises(WorkbenchError, match="no numbers of one system"):
            PLANTS.get(str(tmp_path / "odd.mat"))
    (tmp_path / "text.mat").write_text("A = 1")
    with pytest.raises(WorkbenchError, match="and no system|cannot be read"):
        PLANTS.get(str(tmp_path / "text.mat"))


def test_what_a_verb_takes_for_a_plant_a_function_takes_too() -> None:
    system = ct.tf([2.0], [0.5, 1.0, 0.0])
    for plant in (system, linear_model(system), "2 / (s (0.5 s + 1))", lambda: system):
        np.testing.assert_allclose(np.sort(linearise(plant, verdict=False).poles), [-2.0, 0.0])
        assert operating_point(plant).model.outputs[0].name == "y"
        assert simulate(plant, np.ones(3), sample_time=0.1)["y"][1] > 0.0
    with pytest.raises(WorkbenchError, match="plant 'float' is a float; a plant is a function"):
        operating_point(2.0)


@pytest.mark.parametrize("limits", [5.0, {"u": 5}, {"u": (-5.0, 5.0)}])
def test_a_largest_magnitude_is_a_limit(limits: Any) -> None:
    model = linear_model(ct.tf([1.0], [1.0, 1.0]), limits=limits).operating_point.model
    assert [(q.lower, q.upper) for q in model.inputs] == [(-5.0, 5.0)]
    assert model.outputs[0].upper == math.inf


@pytest.mark.parametrize("system", [ct.tf([2.0], [0.5, 1.0]), ([2.0], [0.5, 1.0])])
def test_a_system_of_a_module_may_be_limited_where_it_is_named(system: Any) -> None:
    plant = adopt(system, "mine:G")
    for given, limit in (({"limit": 5.0}, 5.0), ({}, math.inf)):
        assert [(q.lower, q.upper) for q in plant.model(given).inputs] == [(-limit, limit)]


def test_a_linear_model_keeps_the_limits_that_it_was_given() -> None:
    linear = linear_model(ct.tf([1.0], [1.0, 1.0]), limits=5.0)
    assert adopt(linear, "mine:linear").model({}).inputs[0].upper == 5.0


@pytest.mark.parametrize(
    ("text", "order", "exact"),
    [
        (
            "[1/(s - 1); 1/((s - 1)*(s + 3))]", 2,
            lambda s: [[1 / (s - 1)], [1 / ((s - 1) * (s + 3))]],
        ),
        # A cart with a pendulum that stands upright; what fades stands there twice.
        (
            "[(s^2 - 16.35)/(s^4 - 24.525*s^2); -1.6667/(s^2 - 24.525)]", 5,
            lambda s: [[(s**2 - 16.35) / (s**4 - 24.525 * s**2)], [-1.6667 / (s**2 - 24.525)]],
        ),
        ("[1/s^2; 2/s^2]", 2, lambda s: [[1 / s**2], [2 / s**2]]),
        # Two stores that two pumps fill on their own are two.
        ("[1/s, 2/(s + 1); 0, 1/s]", 3, lambda s: [[1 / s, 2 / (s + 1)], [0.0, 1 / s]]),
    ],
)  # fmt: skip
def test_what_grows_in_several_entries_is_one_mode(text: str, order: int, exact: Any) -> None:
    linear = at_rest(PLANTS.get(text).model())
    assert len(linear.A) == order
    for s in (0.7j, 3.0j, 2.0 + 1.0j):
        told = transfer_function(linear.A, linear.B, linear.C, linear.D, s)
        assert told == pytest.approx(np.array(exact(s)), rel=1e-6, abs=1e-9)
    for pole in linear.poles[linear.poles.real > -1e-6]:
        moved = np.hstack([linear.A - pole * np.eye(order), linear.B])
        assert np.linalg.svd(moved)[1].min() > 1e-3


def test_a_matrix_of_python_control_has_what_grows_once() -> None:
    num = [[[1.0, 0.0, -19.6]], [[-2.0]]]
    cart = ct.tf(num, [[[1.0, 0.0, -21.6, 0.0, 0.0]], [[1.0, 0.0, -21.6]]], inputs=["push"])
    linear = linear_model(cart)
    assert np.count_nonzero(linear.poles.real > -1e-6) == 3 and linear.input_names == ("push",)
    s = 0.4 + 2.0j
    told = transfer_function(linear.A, linear.B, linear.C, linear.D, s)
    assert told == pytest.approx(np.asarray(cart(s)).reshape(2, 1), rel=1e-9)
    assert design_lqi(linear).actuators == ("push",)
