"""Plants that another tool wrote as rates of vectors: python-control, CasADi."""

from __future__ import annotations

from typing import Any

import casadi as ca
import control as ct
import numpy as np
import pytest

from tests.machines import at_rest
from workbench.errors import WorkbenchError
from workbench.model.rate_functions import model_of_rates
from workbench.operating_point import operating_point
from workbench.plants.plant import adopt

X, U = ca.SX.sym("x", 2), ca.SX.sym("u")
RATES = ca.vertcat(X[1], U - 4.0 * ca.sin(X[0]) - 0.4 * X[1])


def _rates(t: float, x: Any, u: Any, params: dict[str, float]) -> Any:
    return np.array([x[1], u[0] - params["g"] * np.sin(x[0]) - 0.4 * x[1]])


SYSTEMS = {
    "control": ct.nlsys(
        _rates, lambda t, x, u, p: x[0], inputs=1, outputs=1, states=2, params={"g": 4.0}
    ),
    "function": ca.Function("f", [X, U], [RATES, X[0]]),
    "dae": {"x": X, "u": U, "ode": RATES},
    "dae of parameters": {"x": X, "p": U, "ode": RATES},
}


@pytest.mark.parametrize("tool", SYSTEMS)
def test_rates_are_a_plant(tool: str) -> None:
    model = adopt(SYSTEMS[tool], "mine:plant").model({})
    linear = at_rest(model)
    assert np.allclose(linear.A, [[0.0, 1.0], [-4.0, -0.4]]) and np.allclose(linear.B.T, [[0, 1]])
    # Without outputs all states are measured.
    assert len(model.outputs) == (2 if "dae" in tool else 1)


def test_parameters_of_a_system_may_be_refitted() -> None:
    (gravity,) = model_of_rates(SYSTEMS["control"]).parameters
    assert (gravity.name, gravity.value, gravity.fitted) == ("g", 4.0, True)
    heavier = model_of_rates(SYSTEMS["control"]).with_parameters({"g": 9.0})
    linear = at_rest(heavier)
    assert linear.A[1, 0] == pytest.approx(-9.0)


@pytest.mark.parametrize(
    ("system", "message"),
    [
        (ct.nlsys(lambda t, x, u, p: [t * x[0]], inputs=1, states=1), "depends on the time"),
        (ct.nlsys(lambda t, x, u, p: [x[0]], inputs=1, states=1, dt=0.1), "is sampled"),
        (ct.nlsys(lambda t, x, u, p: [x[0]], inputs=1, states=2), "1 rates instead of 2"),
        (ca.Function("F", [X, U], [X + RATES], ["x", "u"], ["x_next"]), "the state after a step"),
        (ca.Function("F", [X], [X]), "one of x and u"),
        ({"x": X, "z": U, "ode": RATES, "alg": U}, "algebraic equations"),
    ],
)
def test_what_is_no_plant_is_told(system: Any, message: str) -> None:
    with pytest.raises(WorkbenchError, match=message):
        operating_point(adopt(system, "mine:plant").model({}))


def test_tuples_of_scipy_are_systems() -> None:
    for system in (([2.0], [1.0, 3.0]), ([], [-3.0], 2.0), ([[-3.0]], [[1.0]], [[2.0]], [[0.0]])):
        model = adopt(system, "mine:plant").model({})
        linear = at_rest(model)
        assert np.allclose(linear.A, -3.0) and np.allclose(linear.C @ linear.B, 2.0)
