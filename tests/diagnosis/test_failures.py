"""One bad candidate, or one stage that fails, is a line of the verdict and not its end."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import casadi as ca
import pytest

from tests.diagnosis.example_diagnosis import rubbing_runs
from workbench.diagnosis import diagnose as engine
from workbench.diagnosis.diagnose import diagnose
from workbench.diagnosis.location import located_signal
from workbench.diagnosis.selection import (
    final_refit,
    first_refit,
    search,
    simulation_error,
    withdrawal,
)
from workbench.diagnosis.verdict import Verdict
from workbench.errors import NumericalError
from workbench.model import Effect, Parameter, PortView
from workbench.model.regularisation import Expression
from workbench.physics.hypothesis import Hypothesis
from workbench.physics.library import library
from workbench.plants.servo_axis import servo_axis


def _law(name: str, transform: Callable[[PortView], Expression]) -> Hypothesis:
    size = Parameter("size", "N", 10.0, value=0.0, lower=0.0, upper=50.0, fitted=True)
    return Hypothesis(Effect(name, ("axis.force",), transform, (size,)), "size", 10.0)


def _raises(at: PortView) -> Expression:
    raise ZeroDivisionError("my own mistake")


def _diverges(at: PortView) -> Expression:
    return at.value + at.p.size * ca.log(-1.0 - at.signals.speed**2)


def _diagnosed(*more: Hypothesis, **options: Any) -> Verdict:
    model, fit_on, hold_out, own = rubbing_runs()
    own["entries"] += more
    return diagnose(model, fit_on, hold_out, **own | options).verdict


def _refused(verdict: Verdict) -> dict[str, str]:
    return {str(row["effect"]): str(row["reason"]) for row in verdict.refused}


@pytest.mark.long
@pytest.mark.parametrize("law", [_raises, _diverges])
def test_a_law_of_the_users_that_fails_is_a_line(law: Callable[[PortView], Expression]) -> None:
    verdict = _diagnosed(_law("mine", law))
    assert [f.effect for f in verdict.findings] == ["coulomb_friction"]
    assert _refused(verdict)["mine"].startswith("it could not be tried, because ")


@pytest.mark.parametrize("error", [NumericalError("lost"), RuntimeError("gcc: out of memory")])
@pytest.mark.parametrize(
    ("room", "step"), [(first_refit, "_refitted"), (final_refit, "_judged_on")]
)
def test_a_refit_that_fails_is_a_line(
    room: Any, step: str, error: Exception, monkeypatch: pytest.MonkeyPatch
) -> None:
    whole = getattr(room, step)

    def sometimes(base: Any, given: Any, *rest: Any) -> Any:
        if given.entry.name == "spring":
            raise error
        return whole(base, given, *rest)

    monkeypatch.setattr(room, step, sometimes)
    spring = next(e for e in library(servo_axis()) if e.law == "linear_spring")
    verdict = _diagnosed(replace(spring, effect=replace(spring.effect, name="spring")))
    assert [f.effect for f in verdict.findings] == ["coulomb_friction"]
    if step == "_refitted":
        assert _refused(verdict)["spring"] == f"it could not be tried, because {error}"


def _never(*_: Any, **__: Any) -> Any:
    raise NumericalError("the filter left the finite numbers")


@pytest.mark.long
@pytest.mark.parametrize(
    ("module", "name"),
    [
        (engine, "locate"),
        (engine, "next_experiment"),
        (search, "over_floor"),
        (withdrawal, "judged_run"),
        (simulation_error, "least_squares"),
        (located_signal, "unknown_input"),
    ],
)
def test_a_stage_that_fails_leaves_the_others(
    module: Any, name: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(module, name, _never)
    (finding,) = _diagnosed(advise=name == "next_experiment").findings
    assert finding.effect == "coulomb_friction"


@pytest.mark.parametrize("name", ["fit_with_likely_starts", "blocks_as_trusted"])
def test_a_nominal_model_that_cannot_be_refitted_or_judged_is_a_verdict(
    name: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(engine, name, _never)
    verdict = _diagnosed()
    assert verdict.kind == "unexplained" and "left the finite numbers" in verdict.sentence


def test_a_term_without_a_name_that_fails_is_a_line(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(engine, "nonparametric_term", _never)
    model, fit_on, hold_out, options = rubbing_runs()
    few = [e for e in library(model) if e.law == "constant_force"]
    found = diagnose(model, fit_on, hold_out, **options | {"entries": few})
    assert found.verdict.kind == "unexplained"
    assert "could not be tried, because" in found.nonparametric.reason
