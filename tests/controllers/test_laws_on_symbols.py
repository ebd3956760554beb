"""The laws give the same numbers on floats and on CasADi symbols, from which C is written."""

from __future__ import annotations

import math
import pickle
from dataclasses import fields, replace
from typing import Any

import casadi as ca
import numpy as np
import pytest

from controllers.arithmetic import FLOATS, SYMBOLS
from controllers.h_infinity.synthesis import has_slycot
from controllers.joint.schedule import JointSchedule
from controllers.named_state import flat, names, restored
from controllers.plain.transfer_law import TransferLaw, pid_by_hand
from tests.controllers.families import CLOSED_FORM, family
from workbench.linearisation import LinearModel

LAWS = {**CLOSED_FORM, "H-infinity": family("scheduled-h-infinity")}


@pytest.mark.parametrize("name", LAWS)
def test_symbols_agree_with_floats(name: str, schedule: JointSchedule, linear: LinearModel) -> None:
    if name == "H-infinity" and not has_slycot():
        pytest.skip("slycot is not installed")
    law = LAWS[name](schedule, linear)
    state = law.initial_state((0.5, 4e5, 4e5)[: len(law.sensors)])
    z, m = ca.SX.sym("z", len(flat(state))), ca.SX.sym("m", len(law.sensors))
    r = ca.SX.sym("r")
    command, following, _ = law.law(
        restored(state, ca.vertsplit(z)), tuple(ca.vertsplit(m)), (r,), SYMBOLS
    )
    function = ca.Function("law", [z, m, r], [ca.vcat(command), ca.vcat(flat(following))])
    rng = np.random.default_rng(1)
    for k in range(60):
        angle = 0.5 + 0.1 * math.sin(0.2 * k)
        measured = (angle, *rng.uniform(2e5, 5e5, 2).tolist())[: len(law.sensors)]
        wanted = 0.5 if k < 20 else 0.7
        numbers = function(ca.DM(list(flat(state))), ca.DM(list(measured)), wanted)
        command, state, _ = law.step(state, measured, (wanted,))
        assert float(numbers[0]) == pytest.approx(command[0], abs=1e-9)
        np.testing.assert_allclose(numbers[1].full().ravel(), flat(state), rtol=1e-9, atol=1e-9)
    assert len(names(state)) == len(flat(state))


class Counted(TransferLaw):
    """A law that counts how often its text runs."""

    read = 0

    def law(self, *told: Any) -> Any:
        """Count, and run the text."""
        type(self).read += 1
        return super().law(*told)


def test_a_plain_law_is_traced_once_and_gives_the_same_numbers() -> None:
    by_hand = pid_by_hand(2.0, 10.0, 0.1, measured="y", actuator="u", lower=-3.0, upper=4.0)
    law = Counted(**{f.name: getattr(by_hand, f.name) for f in fields(by_hand)})
    state = other = law.initial_state((0.0,))
    for y in np.random.default_rng(1).standard_normal(20).tolist():
        expected, other, _ = by_hand.law(other, (y,), (1.0,), FLOATS)
        command, state, told = law.step(state, (y,), (1.0,))
        assert (command, state) == (expected, other)
        assert type(command[0]) is float and set(told) == {"asked.u"}
    assert Counted.read == 1
    # What is not finite is left to the text, which passes it on.
    assert math.isnan(law.step(state, (math.nan,), (1.0,))[0][0])
    # Another process makes its own.
    assert pickle.dumps(law) == pickle.dumps(replace(law))
