"""What a law says on CasADi symbols runs in its place; in C it is `test_c_export`'s."""

from __future__ import annotations

import math
import pickle
from dataclasses import fields, replace
from typing import Any

import numpy as np

from controllers.arithmetic import FLOATS
from controllers.plain.transfer_law import TransferLaw, pid_by_hand


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
