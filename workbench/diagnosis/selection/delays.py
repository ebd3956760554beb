"""How likely a recording is by how late the events of a model come in it."""

from __future__ import annotations

import contextlib
import math
from collections.abc import Mapping
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from workbench.arrays import Vector
from workbench.diagnosis.estimation.filter import End
from workbench.diagnosis.estimation.prediction_error import Observed, PredictionError
from workbench.errors import NumericalError

_PARTS, _LEAST = 100, 200
"""Parts of a recording, at whose ends what was filtered once is gone on from, and least samples of
one: the filter is as quick over so many as it is to call."""

_FORGOTTEN = 1e-2
"""Difference of two filtered states over their uncertainty up to which both expect the same."""


class _Part(NamedTuple):
    """A part of a recording that was filtered.

    Args:
        begin: State and covariance with which the filter went into it.
        cost: Minus the log likelihood of the part, dimensionless.
    """

    begin: End
    cost: float


class Delays:
    """Minus the log likelihood of a recording by how late the clocks of its events start.

    What comes before the events is the same for every delay, and so is what comes so long after
    them that the filter has forgotten them: both are filtered once.

    Args:
        clocks: Usual start of each event's clock, in s, by the number of its state.
        span: When the events begin and end with the usual starts, in s; None where they repeat.
    """

    def __init__(
        self,
        filter_: PredictionError,
        observed: Observed,
        clocks: Mapping[int, float],
        span: tuple[float, float] | None,
    ) -> None:
        self._filter, self._observed, self._span = filter_, observed, span
        self._places, self._usual = list(clocks), np.array(list(clocks.values()))
        size = max(len(observed.outputs) // _PARTS, _LEAST)
        self._step = size * observed.sample_time
        begins = range(0, len(observed.outputs), size)
        self._parts = [observed.part(slice(k, k + size)) for k in begins]
        self._before: list[_Part] = []
        self._after: list[_Part] = []
        if span is not None:
            # Past both ends of the recording the events never come, or are over.
            never, over = span[0] - (len(self._parts) + 1) * self._step, span[1] + self._step
            with contextlib.suppress(NumericalError):
                self._before, self._after = self._filtered(never), self._filtered(over)

    def cost(self, delay: float) -> float:
        """Return minus the log likelihood, dimensionless; infinite if the filter fails.

        Args:
            delay: How much later than usual the clocks start, in s.
        """
        if self._span is None or not self._before:
            return self.cost_from(self._usual + delay)
        first, last = (time - delay for time in self._span)
        k = int(np.clip(first // self._step, 0, len(self._before) - 1))
        total, begin = sum(part.cost for part in self._before[:k]), self._before[k].begin
        begin = self._with_clocks(begin, delay, k)
        try:
            for j, part in enumerate(self._parts[k:], k):
                if j * self._step > last and self._forgotten(begin, self._after[j].begin):
                    return total + sum(part.cost for part in self._after[j:])
                run = self._filter.run(part, self._filter.model.values, begin)
                total, begin = total + run.cost, run.end
        except NumericalError:
            return math.inf
        return total

    def cost_from(self, clocks: Vector) -> float:
        """Return the same where the clocks start at times, shape (n_clocks,), in s."""
        start = self._observed.start.copy()
        start[self._places] = clocks
        try:
            seen = replace(self._observed, start=start)
            return self._filter.run(seen, self._filter.model.values).cost
        except NumericalError:
            return math.inf

    def _filtered(self, delay: float) -> list[_Part]:
        """Filter the recording part by part."""
        begin = self._with_clocks(self._filter.begin(self._observed), delay, 0)
        found = []
        for part in self._parts:
            run = self._filter.run(part, self._filter.model.values, begin)
            found.append(_Part(begin, run.cost))
            begin = run.end
        return found

    def _with_clocks(self, begin: End, delay: float, part: int) -> End:
        state, covariance = begin[0].copy(), begin[1]
        state[self._places] = self._usual + delay + part * self._step
        return state, covariance

    def _forgotten(self, one: End, other: End) -> bool:
        """Whether two filtered states differ by little of their uncertainty, their clocks apart."""
        own = len(one[0]) - len(self._filter.state_scale)
        scale = np.append(self._filter.state_scale, np.ones(own))
        known = np.sqrt(np.maximum(np.diag(other[1]), 0.0)) * scale
        apart = np.abs(one[0] - other[0])
        apart[self._places] = 0.0
        return bool(np.all(apart <= _FORGOTTEN * known + 1e-12 * scale))
