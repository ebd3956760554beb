"""Rules: the penalty, and what a verdict doubts."""

from __future__ import annotations

import math
from dataclasses import replace
from types import SimpleNamespace
from typing import Any, cast

import pytest

from tests.diagnosis.selection.candidates import (
    ASKED,
    entries,
    estimated,
    made_candidate,
    model_that,
)
from workbench.diagnosis.selection.rules import (
    LEAST_GAIN,
    Limits,
    doubted_in,
    judged,
    selection_penalty,
)


def test_the_penalty_grows_with_library_samples_and_parameters() -> None:
    base = selection_penalty(40, 1000, 1)
    assert base == pytest.approx(LEAST_GAIN + 0.5 * math.log(1000) + math.log(40))
    assert selection_penalty(80, 1000, 1) - base == pytest.approx(math.log(2))
    assert selection_penalty(40, 1000, 3) - base == pytest.approx(math.log(1000))


def test_what_may_only_even_out_the_noise_of_an_input_is_doubted() -> None:
    def told(name: str, *misread: tuple[str, float]) -> tuple[str, ...]:
        given = made_candidate(name, 900.0, 0.1)
        fit = cast(
            Any, SimpleNamespace(**vars(cast(Any, given.fit)) | {"model": model_that(*misread)})
        )
        return judged(replace(given, fit=fit), Limits(20.0, 100.0)).doubts

    read = ("pressure", 15.0)
    (said,) = told("sensor_lag_angle", read)
    assert said == "it may only even out the noise with which pressure was read"
    assert told("sensor_lag_angle") == told("valve_offset", read) == ()
    # A play of 10 mrad does more than even out a noise of 0.1 mrad, and may do that to one of 5.
    assert told("sensor_play_angle", ("steer", 1e-4)) == ()
    assert told("sensor_play_angle", ("steer", 5e-3)) != ()


def test_doubts_are_those_of_the_fit_that_is_told() -> None:
    candidate = made_candidate("valve_offset", 900.0, 0.1)
    assert candidate.fit is not None
    size = entries()["valve_offset"].typical_size

    def of(std: float) -> Any:
        estimate = estimated(size, std)
        return SimpleNamespace(
            refit=SimpleNamespace(converged=True, estimate=lambda name: estimate, estimates=())
        )

    vague = judged(replace(candidate, fit=of(size)), ASKED)
    assert len(vague.doubts) == 1 and "standard deviations of zero" in vague.doubts[0]
    told = doubted_in(replace(vague, doubts=(*vague.doubts, "it is small")), of(1e-3 * size))
    assert told.doubts == ("it is small",)
    assert doubted_in(told, of(size)).doubts == (*vague.doubts, "it is small")
    assert doubted_in(candidate, candidate.fit) is candidate
