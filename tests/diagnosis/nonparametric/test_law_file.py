"""A term without a name as a law of the user's own: it is what was found, and it is named."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from tests.diagnosis.example_diagnosis import sprung, sprung_runs
from workbench.diagnosis.diagnose import diagnose
from workbench.diagnosis.nonparametric.law_file import NAME, law_file
from workbench.diagnosis.nonparametric.result import Likeness, NonparametricTerm
from workbench.diagnosis.nonparametric.shapes import SHAPES, shape_effect
from workbench.diagnosis.verdict import Verdict
from workbench.errors import WorkbenchError
from workbench.physics.law import Law
from workbench.physics.library import library
from workbench.physics.survey import Survey
from workbench.plants.cascaded_tanks import cascaded_tanks
from workbench.plants.plant import own_laws
from workbench.plants.servo_axis import servo_axis
from workbench.registry import load_object


def _term() -> NonparametricTerm:
    term = sprung().nonparametric
    assert term is not None and term.accepted
    return term


def _law(term: NonparametricTerm, folder: Path, name: str) -> Law:
    (folder / f"{name}.py").write_text(law_file(term, "axis"))
    found = load_object("effect", f"{name}:{NAME}", folder=folder)
    assert isinstance(found, Law)
    return found


@pytest.mark.long
def test_the_curve_has_the_shape_of_the_spring_that_is_hidden() -> None:
    term = _term()
    assert term.likeness is not None and term.likeness.law == "linear_spring"
    assert term.likeness.values["size"] == pytest.approx(-200.0, rel=0.01)
    # Two parameters in the place of six ordinates: no less likely, and penalised less.
    curve = next(k for k in term.likenesses if not k.law)
    assert curve.gain == pytest.approx(term.gain)
    assert term.likeness.penalised > curve.penalised
    verdict = sprung().verdict
    assert isinstance(verdict, Verdict) and "shape of linear spring" in verdict.sentence


@pytest.mark.long
def test_the_law_of_a_file_is_found_and_named(tmp_path: Path) -> None:
    axis, fit_on, hold_out, options = sprung_runs()
    (tmp_path / "law_of_spring.py").write_text(law_file(_term(), "axis"))
    every = library(axis, extra=own_laws(axis, [f"law_of_spring:{NAME}"], folder=tmp_path))
    entries = [*options["entries"], *(h for h in every if h.name == NAME)]
    found = diagnose(axis, fit_on, hold_out, **{**options, "entries": entries})
    assert found.verdict.kind == "named"
    (finding,) = found.verdict.findings
    assert finding.effect == NAME
    assert finding.parameters["size"].value == pytest.approx(-200.0, rel=0.01)


def test_the_law_of_a_curve_is_the_curve(tmp_path: Path) -> None:
    term = replace(_term(), likenesses=())
    law = _law(term, tmp_path, "law_of_curve")
    model = servo_axis().with_effect(law("axis.force", amount=1.0))
    x = np.linspace(*term.arguments[0].hull, 7)
    own = term.fit.refit
    fitted = servo_axis().with_effect(
        term.law.effect.with_parameters(  # type: ignore[union-attr]
            {
                short: own.estimate(f"nonparametric.{short}").value
                for short in term.curves["position"].names
            }
        )
    )
    for position in x.tolist():
        np.testing.assert_allclose(
            model.rates([position, 0.1], [5.0]), fitted.rates([position, 0.1], [5.0]), rtol=1e-6
        )
    # Elsewhere it is no hypothesis, and no error.
    assert list(law.hypotheses(Survey(cascaded_tanks()))) == []


@pytest.mark.parametrize("relative", [False, True])
@pytest.mark.parametrize("shape", SHAPES, ids=lambda s: s.name)
def test_every_shape_is_written_as_it_is_computed(
    shape: object, relative: bool, tmp_path: Path
) -> None:
    term = replace(_term(), relative=relative, unit="1" if relative else "N")
    argument = term.arguments[0]
    values = {
        "size": 3.0,
        "level": 0.2,
        "width": 0.07,
        "centre": 0.05,
        "frequency": 50.0,
        "phase": 1.0,
    }
    kind = next(s for s in SHAPES if s is shape)
    values = {name: values[name] for name in ("size", "level", *kind.inner)}
    alike = replace(term, likenesses=(Likeness(kind.name, values, 9.0, 9.0),))
    name = f"law_{kind.name}_{relative}"
    law = _law(alike, tmp_path, name)
    written = servo_axis().with_effect(law("axis.force", **values))
    computed = servo_axis().with_effect(shape_effect(kind, term, argument, values))
    for state in ([0.03, 0.1], [0.11, -0.2]):
        np.testing.assert_allclose(
            written.rates(state, [40.0]), computed.rates(state, [40.0]), rtol=1e-5
        )


def test_a_memory_is_written_with_its_state(tmp_path: Path) -> None:
    term = _term()
    assert term.law is not None
    with_loop = replace(term.law, loop=("speed", "m", 0.01))
    refit = term.fit.refit
    some = refit.estimates[-1]
    more = [
        replace(some, name=f"nonparametric.{name}", value=value)
        for name, value in (("loop", 7.0), ("distance", 0.01))
    ]
    fit = replace(term.fit, refit=replace(refit, estimates=(*refit.estimates, *more)))
    looped = replace(term, law=with_loop, loop=True, fit=fit, likenesses=())
    model = servo_axis().with_effect(
        _law(looped, tmp_path, "law_of_loop")("axis.force", amount=1.0)
    )
    plain = servo_axis().with_effect(
        _law(replace(term, likenesses=()), tmp_path, "law_without")("axis.force", amount=1.0)
    )
    assert len(model.states) == 3
    rates, without = model.rates([0.1, 0.2, 0.5], [5.0]), plain.rates([0.1, 0.2], [5.0])
    mass = servo_axis().parameter("mass").value
    assert rates[1] - without[1] == pytest.approx(7.0 * 0.5 / mass)
    assert rates[2] == pytest.approx((0.2 - 0.2 * 0.5) / 0.01)


def test_a_term_that_was_refused_is_no_law() -> None:
    with pytest.raises(WorkbenchError, match="not accepted"):
        law_file(replace(_term(), reason="it gains less than the penalty"), "axis")
