"""The laws give the same numbers on floats and on CasADi symbols, from which C is written."""

from __future__ import annotations

from typing import Any

import casadi as ca
import numpy as np
import pytest

from controllers import design_pid, design_sliding_mode
from controllers.arithmetic import SYMBOLS
from controllers.named_state import flat, restored
from workbench.linearisation import LinearModel


@pytest.mark.parametrize("design", [design_pid, design_sliding_mode])
def test_symbols_agree_with_floats(design: Any, linear: LinearModel) -> None:
    law = design(linear)
    state = law.initial_state((0.5, 4e5, 4e5))
    z, m, r = ca.SX.sym("z", len(flat(state))), ca.SX.sym("m", 3), ca.SX.sym("r")
    command, following, _ = law.law(
        restored(state, ca.vertsplit(z)), tuple(ca.vertsplit(m)), (r,), SYMBOLS
    )
    function = ca.Function("law", [z, m, r], [ca.vcat(command), ca.vcat(flat(following))])
    rng = np.random.default_rng(1)
    for _ in range(200):
        measured = (rng.uniform(0.1, 0.9), rng.uniform(1e5, 6e5), rng.uniform(1e5, 6e5))
        wanted = (rng.uniform(0.1, 0.9),)
        numbers = function(ca.DM(list(flat(state))), ca.DM(list(measured)), wanted[0])
        command, state, _ = law.step(state, measured, wanted)
        assert float(numbers[0]) == pytest.approx(command[0], abs=1e-9)
        np.testing.assert_allclose(numbers[1].full().ravel(), flat(state), rtol=1e-9, atol=1e-9)
