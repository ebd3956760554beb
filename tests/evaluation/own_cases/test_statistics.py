"""Rates, intervals and tables from made-up answers."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from tests.evaluation.own_cases.made_up import found, row, verdict
from workbench.cli.evaluate import report
from workbench.evaluation.benchmark.sindy import thresholded
from workbench.evaluation.own_cases.report import figure, summary, tables
from workbench.evaluation.own_cases.statistics import by_effect, by_size, score_of, scores
from workbench.evaluation.rates import Rate
from workbench.files import plain

TILT = found("tilt_gravity", "joint.torque", tilt=(0.08, 0.002))
SMALL = found("tilt_gravity", "joint.torque", tilt=(0.040, 0.002))
RIPPLE = found("ripple", "joint.torque")
SILENT = verdict()
BASE = {"refit only": SILENT, "greedy": verdict(RIPPLE), "sindy": SILENT}
ROWS = [
    row(1, ("tilt",), verdict(TILT), **BASE),
    row(2, ("tilt",), verdict(SMALL), factor=0.4, **BASE),
    row(3, ("stribeck",), verdict(kind="unexplained", scale=4.0), **BASE),
    row(4, (), SILENT, **BASE),
    row(5, (), SILENT, **BASE),
    row(6, ("torque_noise",), verdict(RIPPLE), kind="outside", **BASE),
]


def test_wilson_interval_against_its_definition() -> None:
    # The bounds are the shares at which the count is 1.96 standard deviations away.
    for count, total in ((0, 24), (3, 40), (40, 40)):
        for bound in Rate(count, total).interval:
            if 0.0 < bound < 1.0:
                deviation = np.sqrt(bound * (1 - bound) / total)
                assert abs(count / total - bound) / deviation == pytest.approx(1.96, abs=1e-3)
    assert Rate(0, 24).interval[0] == 0.0 and Rate(40, 40).interval[1] == 1.0
    assert Rate(0, 0).interval == (0.0, 1.0)


def test_rates_of_the_tool_and_of_baselines() -> None:
    tool, refit, greedy, _ = scores(ROWS)
    assert [s.who for s in (tool, refit, greedy)] == ["tool", "refit only", "greedy"]
    rates = tool.rates()
    assert (rates["false alarms"].count, rates["false alarms"].total) == (0, 2)
    # Outside effects are counted apart.
    assert (rates["right name or class"].count, rates["right name or class"].total) == (2, 3)
    assert rates["confidently wrong"].count == 1
    assert rates["outside the library: wrong name"].count == 1
    # One of five that hide something of the library, or nothing, is at four times the limit.
    assert rates["held out within 1.3 of the limit"].count == 4
    assert tool.round.points == 6 + 6 + 0 + 6 + 6 - 6
    assert refit.round.points == 6 + 6
    assert greedy.round.points == -36 and greedy.rates()["false alarms"].count == 2
    assert tool.round.p_value < refit.round.p_value


def test_only_cases_with_baselines_are_compared() -> None:
    rows = [*ROWS, row(7, ("tilt",), verdict(RIPPLE))]
    assert all(len(s.judged) == len(ROWS) for s in scores(rows))
    assert len(score_of("tool", rows).judged) == len(rows)


def test_sizes_and_smallest_named() -> None:
    first = next(e for e in by_effect(ROWS) if e.effect == "tilt")
    assert first.outcomes == {1.0: "right", 0.4: "right"}
    assert first.smallest_named == pytest.approx(0.032)
    assert first.predicted == 0.01
    # 0.08 of 0.08 and 0.040 of 0.032; the latter is four standard deviations off.
    assert first.sizes.median == pytest.approx(0.125)
    assert (first.sizes.coverage.count, first.sizes.coverage.total) == (1, 2)
    assert by_size(ROWS)[0.4]["right name or class"].value == 1.0
    assert by_size(ROWS)[1.0]["right name or class"].value == 0.5


def test_tables_figure_and_summary(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    text = tables(ROWS)
    assert "0/2 = 0 % [0, 66]" in text and "missed" in text
    for content in ROWS:
        (tmp_path / f"{content['case']}.json").write_text(json.dumps(content))
    report(tmp_path, figure=tmp_path / "f.png", summary=tmp_path / "s.json")
    assert capsys.readouterr().out == f"{text}\n"
    assert (tmp_path / "f.png").stat().st_size > 10_000
    kept = json.loads((tmp_path / "s.json").read_text())
    assert kept == plain(summary(ROWS))
    assert kept["bars"]["confidently wrong"]["met"] is False
    figure(ROWS[:1], tmp_path / "one.png")


def test_sparse_regression_keeps_the_true_terms() -> None:
    rng = np.random.default_rng(1)
    a = rng.standard_normal((500, 6))
    b = 0.8 * a[:, 1] - 0.5 * a[:, 4] + 0.05 * rng.standard_normal(500)
    found_terms = thresholded(a, b, 0.1)
    assert np.flatnonzero(found_terms).tolist() == [1, 4]
    # Without noise in the estimate beyond 0.05 / sqrt(500).
    assert found_terms[[1, 4]] == pytest.approx([0.8, -0.5], abs=0.01)
