"""Attempts to fool the gate of a pull request: each ends red, or says what it leaves open."""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from xml.sax.saxutils import escape

import pytest

from tests.study.gate import STUDY, Gate, finished_gate
from tests.study.small_study import changed, small_study
from workbench.files import json_text, write_whole
from workbench.reports.study_page import study_page
from workbench.reports.summary import mark_of, summary
from workbench.reports.tables import Table
from workbench.study.baseline import baseline_text, bless, box_changes, read_baseline
from workbench.study.ci_files import github_annotations, junit
from workbench.study.conditions import condition_changes, conditions
from workbench.study.read import load_study
from workbench.study.result import StudyResult, run_study
from workbench.study.summary import plain_summary

NARROW = ("limit = 0.6", "limit = 0.495")
"""A limit that holds on the plant and its variation, and not everywhere in the box."""

INFORMS = ("draws = 4", "hard = false\ndraws = 4")


@pytest.fixture(scope="module")
def gate(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Gate]:
    """A finished study."""
    yield finished_gate(tmp_path_factory.mktemp("gate"))


def said(outcome: StudyResult) -> dict[str, str]:
    """Return the first line of everything that a reviewer reads."""
    return {
        "headline": outcome.headline(),
        "terminal": plain_summary(outcome).splitlines()[-1],
        "summary": summary(outcome).splitlines()[0],
    }


@pytest.mark.parametrize("place", ["headline", "terminal", "summary"])
def test_nominal_variations_box_and_soft_misses_are_in_the_first_line(
    gate: Gate, place: str
) -> None:
    line = said(gate.compared(NARROW, INFORMS, against=False))[place]
    assert "2 of 2 hard requirements met nominally" in line
    assert "2 of 2 on the variations" in line
    assert "box missed by 1 of 1" in line and "settling time" in line and "of 4 plants" in line
    assert "which only informs" in line and "4 of 4 soft ones missed" in line


def test_what_requires_nothing_is_not_said_to_be_met(tmp_path: Path) -> None:
    study = replace(load_study(small_study(tmp_path)), demands=())
    outcome = run_study(study, tmp_path / "out")
    assert outcome.passed and outcome.verdict() == "nothing required"
    for line in said(outcome).values():
        assert "no hard requirement declared" in line and "0 of 0" not in line
    page = study_page(outcome)
    assert "nothing required" in page.title and not page.marks["met"]
    tables = [b for b in page.first if isinstance(b, Table)]
    cells = [str(c) for b in tables for row in (b.headings, *b.rows) for c in row]
    assert "pid" in cells and "0.00" not in cells
    assert "✅" not in summary(outcome) and "0.00" not in plain_summary(outcome)


def test_a_requirement_on_the_box_is_hard_unless_said_otherwise(gate: Gate) -> None:
    outcome = gate.compared(NARROW, against=False)
    assert not outcome.missed and not outcome.passed
    assert (
        "failed, box missed" in outcome.verdict()
        and "### Worst plant found in the box" in summary(outcome)
    )
    assert "worst plant of the box" in junit(outcome) and "<failure" in junit(outcome)
    assert "{" not in junit(outcome)


def test_a_box_that_only_informs_is_named_in_title_table_and_junit(gate: Gate) -> None:
    outcome = gate.compared(NARROW, INFORMS, against=False)
    page = study_page(outcome)
    assert "passed, box missed, 4 soft missed" in page.title and "box missed" in page.lead
    text = summary(outcome)
    assert "❌" in text and "informs and does not fail this study" in text
    assert "pid                  box" in plain_summary(outcome)
    assert "(only informs)" in junit(outcome)
    names = [picture.name for picture in page.pictures]
    # The trajectory on the worst plant stands beside the nominal one.
    assert names.index("worst-1") == names.index("tracking-1") + 1


WEAKER = {
    "a looser limit": ("limit = 0.6", "limit = 0.7", "limit 0.6 -> 0.7 s, looser"),
    "a looser limit in another unit": ('limit = 0.6\nunit = "s"', 'limit = 700\nunit = "ms"',
        "limit 0.6 -> 0.7 s, looser"),
    "a hard limit made soft": ('unit = "deg"\nscenario = "sine"',
        'unit = "deg"\nhard = false\nscenario = "sine"',
        "requirement on rmse in sine: hard -> soft"),
    "a removed requirement": (
        '[[requirements]]\nmetric = "rmse"\nlimit = 20.0\nunit = "deg"\nscenario = "sine"', "",
        "requirement on rmse in sine: removed"),
    "a requirement on fewer variations": ('unit = "deg"\nscenario = "sine"',
        'variations = ["nominal"]\nscenario = "sine"', "requirement on rmse in sine: removed"),
    "a gentler step": ("values = [25, 35]", "values = [25, 34]", "scenario step: references"),
    "a later end": ('duration = "1.5 s"', 'duration = "1.6 s"', "duration 1.5 -> 1.6"),
    "sensors without noise": ('settle = "0.1 s"', 'settle = "0.1 s"\nnoise = false',
        "scenario step: noise as usual -> False"),
    "errors counted later": ('duration = "1 s"', 'duration = "1 s"\ncount_from = "0.5 s"',
        "scenario sine: count_from"),
    "a removed variation": ('[variations."4 kg"]\nparameters = { load = "4 kg" }', "",
        "variation 4 kg: removed"),
    "a milder variation": ('load = "4 kg" }', 'load = "3.1 kg" }', "4 -> 3.1"),
    "a variation that is not judged": ('load = "4 kg" }', 'load = "4 kg" }\njudged = false',
        "variation 4 kg: judged as usual -> False"),
    "a variation in one scenario only": ('load = "4 kg" }', 'load = "4 kg" }\nscenarios = ["sine"]',
        "variation 4 kg: scenarios"),
    "an easier plant": ('[plant]\nload = "3 kg"', '[plant]\nload = "2 kg"', "3 -> 2"),
    "a narrower box": ("load = [2, 6]", "load = [2, 5]", "2 to 6 -> 2 to 5, narrower"),
    "no box": ("[robustness]\ndraws = 4\nsearch = 0\n\n[robustness.box]\nload = [2, 6]", "",
        "box of load: removed"),
    "a box that only informs": (*INFORMS, "box of hard: True -> False"),
    "another seed of the draws": ("draws = 4", "seed = 7\ndraws = 4", "box of seed: 1 -> 7"),
    "a wider tolerance": ("[robustness]\n", "[tolerances.rmse]\nrelative = 5.0\n[robustness]\n",
        "tolerance of rmse: relative"),
    "a metric that no longer gates": ("[robustness]\n",
        "[tolerances.rmse]\ngates = false\n[robustness]\n",
        "tolerance of rmse: gates True -> False"),
}  # fmt: skip


@pytest.mark.parametrize("name", WEAKER)
def test_weaker_conditions_are_red_and_named(gate: Gate, name: str) -> None:
    before, after, sentence = WEAKER[name]
    outcome = gate.compared((before, after))
    text = summary(outcome)
    assert not outcome.passed and outcome.weakened
    assert (
        "### Changed conditions, which must be accepted" in text
        and sentence.replace(": ", " | ", 1) in text
    )
    assert "changed condition: " in plain_summary(outcome) and "conditions" in junit(outcome)


def test_a_controller_that_is_no_longer_judged_is_weaker() -> None:
    (change,) = condition_changes({"unjudged": {}}, {"unjudged": {"pid": True}})
    assert change.fails and str(change) == "judging of pid: no longer judged"
    (change,) = condition_changes({"unjudged": {"pid": True}}, {})
    assert not change.fails


STRICTER = {
    "a tighter limit": ("limit = 0.6", "limit = 0.55"),
    "a wider box": ("load = [2, 6]", "load = [2, 6.5]"),
    "a narrower tolerance": ("[robustness]\n", "[tolerances.air]\nrelative = 1e-3\n[robustness]\n"),
}


@pytest.mark.parametrize("name", STRICTER)
def test_stricter_conditions_are_told_and_pass(gate: Gate, name: str) -> None:
    outcome = gate.compared(STRICTER[name])
    assert outcome.passed, outcome.headline()
    assert outcome.condition_changes and "Stricter conditions" in summary(outcome)


def test_changed_conditions_are_accepted_like_any_other_change(gate: Gate, tmp_path: Path) -> None:
    outcome = gate.compared(("limit = 0.6", "limit = 0.7"))
    (tmp_path / "results.json").write_text(json_text(outcome.table()), encoding="utf-8")
    kept = tmp_path / "kept.json"
    kept.write_bytes(gate.baseline.read_bytes())
    said = bless(tmp_path, kept)
    assert "accepted 1 changed conditions" in said and "0.6 -> 0.7 s" in said
    accepted = replace(outcome, baseline=read_baseline(kept))
    assert accepted.passed and not accepted.condition_changes


def test_names_are_no_markdown_no_html_and_no_mention(gate: Gate) -> None:
    name = "*s* | <img src=x> [a](b) @team #7 $x^{$ `c`"
    outcome = gate.compared(("[scenarios.sine", f'[scenarios."{name}"'),
                            ('scenario = "sine"', f'scenario = "{name}"'))  # fmt: skip
    text = summary(outcome)
    for dangerous in ("*s*", "<img", "](b)", "@team", "#7", "`c`"):
        assert not re.search(rf"(?<!\\){re.escape(dangerous)}", text), dangerous
    # A name with a dollar sign is no formula: the picture is drawn.
    (picture,) = (p for p in study_page(outcome).pictures if p.name == "tracking-2")
    assert "svg" in picture.document


def test_annotations_stand_at_the_lines_of_the_study(gate: Gate) -> None:
    changes = ("limit = 0.6", "limit = 0.3"), INFORMS
    outcome = gate.compared(*changes)
    lines = changed(STUDY, *changes).splitlines()
    said = github_annotations(outcome)
    place = re.compile(r"::(error|warning) file=[^,]*gate\.toml,line=(\d+)::(.*)")
    found = [m.groups() for m in map(place.fullmatch, said) if m is not None]
    assert len(found) == len(said)
    (missed,) = (f for f in found if "settling_time is" in f[2] and f[0] == "error")
    assert lines[int(missed[1]) - 1] == "[[requirements]]" and "25" in missed[2]
    assert lines[int(missed[1])] == 'metric = "settling_time"'
    assert {lines[int(n) - 1] for k, n, t in found if "of the box:" in t} == {"[robustness]"}
    assert any(k == "warning" and "chatter" in t for k, _, t in found)


def test_a_summary_fits_into_a_comment_and_ends_with_its_mark(
    gate: Gate, monkeypatch: pytest.MonkeyPatch
) -> None:
    outcome = gate.compared()
    assert summary(outcome).splitlines()[-1] == mark_of("small")
    monkeypatch.setattr("workbench.reports.summary.LONGEST", 700)
    short = summary(outcome)
    assert len(short) < 900 and short.splitlines()[-1] == mark_of("small")
    assert short.count("<details>") == short.count("</details>")


def test_fewer_plants_of_the_box_than_accepted_are_worse(gate: Gate, tmp_path: Path) -> None:
    now = gate.compared(NARROW, INFORMS, against=False)
    (row,) = [r.table() for r in now.robustness]
    (own,) = [r for r in row["requirements"] if r["hard"]]
    assert (own["met"], own["draws"]) == (3, 4)
    kept = tmp_path / "kept.json"
    write_whole(kept, baseline_text("small", now.records, conditions(now.study), [row]))
    assert gate_against(now, kept).passed
    # Accepted were all four; the box informs only, and still nothing may get worse unseen.
    better = {**row, "requirements": [{**own, "met": 4}]}
    write_whole(kept, baseline_text("small", now.records, conditions(now.study), [better]))
    outcome = gate_against(now, kept)
    assert not outcome.passed
    (change,) = outcome.worse
    name = "plants that meet settling_time at most 0.495 s"
    assert str(change) == f"pid, box: {name} 100 -> 75 %, worse (tolerance 0 %)"
    assert f"| pid | box | {name} | 100 → 75 % ❌ |" in summary(outcome)
    assert f'<failure message="{escape(str(change))}' in junit(outcome)
    # A baseline that keeps none says what it cannot see.
    write_whole(kept, baseline_text("small", now.records, conditions(now.study)))
    assert "keeps no results of the parameter box" in summary(gate_against(now, kept))


def gate_against(outcome: StudyResult, kept: Path) -> StudyResult:
    """Return the outcome compared with a baseline."""
    stored = read_baseline(kept)
    found = box_changes([r.table() for r in outcome.robustness], stored)
    return replace(outcome, baseline=stored, changes=found)


def test_a_reviewer_reads_what_changed_nominal_and_worst_in_ten_lines(gate: Gate) -> None:
    outcome = gate.compared(("bandwidth = 30.0", "bandwidth = 24.0"))
    full = [line for line in summary(outcome).splitlines() if line]
    top = full[: full.index("<details>")]
    assert len(top) <= 12
    scores = next(line for line in top if line.startswith("| pid"))
    assert " → " in scores and "✅" in scores
    (row,) = (line for line in top if "chatter" in line)
    # Both numbers are those of the baseline and of now, on the nominal plant and on the worst.
    (nominal, worst) = re.findall(r"([\d.]+) → ([\d.]+) V/s \(\+[\d.]+ %\)", row)
    runs = {r.variation: r for r in outcome.records if r.scenario == "sine"}
    now = {name: r.metrics["chatter"].value for name, r in runs.items() if r.metrics}
    assert float(nominal[1]) == pytest.approx(now["nominal"], rel=1e-3)
    assert float(worst[1]) == pytest.approx(max(now.values()), rel=1e-3)


def test_a_broken_controller_is_told_once(gate: Gate) -> None:
    (gate.folder / "broken.py").write_text(
        "def design(linear, specification):\n    raise ValueError('no gain')\n"
    )
    outcome = gate.compared(('design = "pid"', 'design = "broken:design"'))
    for text in (summary(outcome), plain_summary(outcome)):
        assert text.count("ValueError: no gain") == 1 and "4 of 4 runs" in text
    assert "100 → 0 %" in summary(outcome)
