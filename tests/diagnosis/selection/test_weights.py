"""Weights of sets of effects: what time series of costs they come from."""

from __future__ import annotations

import numpy as np
import pytest

from workbench.diagnosis.selection.weights import Compared, set_weights

BLOCKS = 60


def _set(*effects: str, cost: float = 0.0, uneven: float = 0.0, blocks: int = BLOCKS) -> Compared:
    """Return a set whose costs sum to ``cost``, up and down by ``uneven`` from block to block."""
    half = blocks // 2
    each = np.full(half, cost / blocks) + uneven * np.random.default_rng(3).normal(size=half)
    return Compared(effects, (each, each))


def test_an_effect_has_to_gain_its_penalty() -> None:
    for gain, weight in ((19.0, 1 / (1 + np.e)), (20.0, 0.5), (21.0, np.e / (1 + np.e))):
        found = dict(set_weights([_set(), _set("a", cost=-gain)], 20.0))
        assert found[("a",)] == pytest.approx(weight)


def test_what_gains_everywhere_is_sure_and_what_gains_here_and_loses_there_is_not() -> None:
    same, turns = _set("b", cost=-60.0), _set("b", cost=-60.0, uneven=30.0)
    assert set_weights([_set("a"), same], 20.0)[0] == (("b",), pytest.approx(1.0))
    sure = dict(set_weights([_set("a"), turns], 20.0))
    assert 0.1 < sure[("a",)] < 0.9


def test_of_two_refits_of_a_set_the_likelier_counts_and_other_blocks_do_not() -> None:
    sets = [_set(), _set("a", cost=-10.0), _set("a", cost=-500.0), _set("b", cost=-9e9, blocks=20)]
    assert [w.effects for w in set_weights(sets, 20.0)] == [("a",), ()]
    assert set_weights([Compared((), (np.array([np.nan]),))], 20.0) == ()
    assert str(set_weights(sets, 20.0)[1]) == "nothing"
