"""The model language knows no plant; a foreign plant is written in some thirty lines of it."""

from __future__ import annotations

import ast
import inspect
from pathlib import Path

import numpy as np
import pytest

import workbench.model
from workbench.model import REGULARISED
from workbench.physics.friction import coulomb_friction
from workbench.plants import servo_axis as servo_module
from workbench.plants.arm import arm
from workbench.plants.servo_axis import servo_axis

FOLDER = Path(workbench.model.__file__).parent


@pytest.mark.parametrize("path", sorted(FOLDER.glob("*.py")), ids=lambda p: p.name)
def test_the_language_knows_no_plant(path: Path) -> None:
    text = path.read_text(encoding="utf-8").lower()
    for word in ("muscle", "chamber", "pneumatic", "spool", "encoder"):
        assert word not in text, f"{path.name} speaks of a {word}"


def test_the_foreign_plant_is_short() -> None:
    tree = ast.parse(inspect.getsource(servo_module))
    functions = [node for node in tree.body if isinstance(node, ast.FunctionDef)]
    lines = 0
    for function in functions:
        body = function.body[1:] if ast.get_docstring(function) else function.body
        lines += body[-1].end_lineno - body[0].lineno + 2  # type: ignore[operator]
    # "Some 30 lines", one argument a line.
    assert lines <= 60


def test_both_plants_speak_the_same_language() -> None:
    for model, port in ((arm(3.0), "joint.torque"), (servo_axis(), "axis.force")):
        extra = coulomb_friction(port, level=1.0, name="extra_friction")
        x = model.initial_state({"speed": 0.5})
        slower = model.with_effect(extra).rates(x, model.nominal_input)
        assert slower.sum() < model.rates(x, model.nominal_input).sum()


def sample(rng: np.random.Generator, count: int) -> tuple[np.ndarray, np.ndarray]:
    low = [-1.0, -100.0, 1.1e5, 260.0, 1.1e5, 260.0, np.radians(-0.1), -4.0]
    high = [1.0, 100.0, 6.9e5, 340.0, 6.9e5, 340.0, np.radians(60.1), 4.0]
    return rng.uniform(low, high, (count, 8)), rng.uniform(4.0, 6.0, count)


def test_forms_of_the_arm_differ_little_over_its_states(rng: np.random.Generator) -> None:
    model = arm(3.0)
    states, voltages = sample(rng, 2000)
    exact = model.exact.rates_function.map(2000)
    smooth = model.form(REGULARISED).rates_function.map(2000)
    values = np.tile(model.values[:, None], (1, 2000))
    a = np.asarray(exact(states.T, voltages[None, :], values))
    b = np.asarray(smooth(states.T, voltages[None, :], values))
    apart = np.abs(a - b)
    size = np.std(a, axis=1, keepdims=True)
    share = np.where(size > 0, apart / np.where(size > 0, size, 1.0), apart)
    # Most samples lie outside every rounded neighbourhood; inside, a few percent of the spread.
    assert np.median(share.max(axis=0)) < 5e-3
    assert share.max() < 0.05
    assert share.max() > 0.0


def test_the_regularised_form_has_finite_derivatives_at_every_kink() -> None:
    model = arm(3.0)
    jacobian = model.form(REGULARISED).jacobian_function
    atmosphere = 101_325.0
    for angle in (0.0, np.radians(60.0), np.radians(30.0)):
        for pressure in (atmosphere, 4e5, 6e5 + atmosphere):
            x = model.initial_state(
                {"angle": angle, "pressure_1": pressure, "pressure_2": pressure}
            )
            for block in jacobian(x, [5.0], model.values):
                assert np.isfinite(np.asarray(block)).all()
