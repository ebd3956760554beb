"""Commands that are on their way."""

from __future__ import annotations

import numpy as np

from workbench.linearisation import linear_model
from workbench.linearisation.exact_delays import channels_of, foretold


def test_what_is_on_its_way_is_foretold() -> None:
    rng = np.random.default_rng(1)
    F, G, x = rng.normal(size=(3, 3)), rng.normal(size=(3, 2)), rng.normal(size=3)
    sent = rng.normal(size=(4, 2))
    then = x
    for command in sent:
        then = F @ then + G @ command
    # Those on their way stand behind two states, the last one first.
    known = np.concatenate([x[:2], sent[::-1].ravel(), x[2:]])
    np.testing.assert_allclose(foretold(F, G, 4, 2) @ known, then)


def test_delays_are_known_where_equal_lags_are_taken_together() -> None:
    whole = linear_model("[exp(-10 s), 0.5/(40 s + 1); 0.3/(30 s + 1), 1/(30 s + 1)]")
    shown = whole.without_unseen()
    assert len(shown.A) == len(whole.A) - 1
    found = channels_of(shown)
    assert found is not None and found.delays == (0.0, 10.0, 0.0)
