"""``compare``, ``bless`` and ``report``: what turns red, what accepts it, what is written."""

from __future__ import annotations

import json
import xml.etree.ElementTree as ET
from pathlib import Path

import pytest

from tests.shell import Refused, Shell
from tests.study.small_study import WORSE, small_study
from workbench.cli.study import named_study
from workbench.study.read import load_study, shipped_study

FILES = {"results.json", "summary.md", "junit.xml", "report.html"}


@pytest.mark.usefixtures("undrawn")
@pytest.mark.system
def test_a_worse_controller_is_red_and_says_why_then_an_improved_one_is_blessed(
    tmp_path: Path, shell: Shell
) -> None:
    study, out, baseline = small_study(tmp_path), tmp_path / "out", tmp_path / "b.json"
    against = ("--jobs 1 --out", out, "--baseline", baseline)
    bless = ("bless", out, "--baseline", baseline)
    shell("compare --jobs 1", study, "--out", out)
    assert {p.name for p in out.iterdir()} == FILES | {"runs"}
    assert "2 runs of study small as the first baseline" in shell(*bless).out

    # Deliberately slower: hard requirement and baseline both say so.
    worse = small_study(tmp_path, WORSE)
    said = shell("compare", worse, *against, status=1).out
    summary = (out / "summary.md").read_text(encoding="utf-8")
    results = json.loads((out / "results.json").read_text(encoding="utf-8"))
    missed = [r for r in results["requirements"] if r["hard"] and not r["met"]]
    assert {r["variation"] for r in missed} == {"nominal", "4 kg"}
    first = next(
        line for line in summary.splitlines() if line.startswith("| pid | step | settling")
    )
    worst = max(missed, key=lambda r: r["score"] if r["score"] is not None else 1e9)
    assert f"| {worst['variation']}" in first
    if worst["value"] is not None:
        assert f"{100 * (worst['value'] / 0.6 - 1):.3g} % over the limit of 0.6 s" in first
    assert "### Worse than the baseline" in summary and "small FAILED" in said
    page = (out / "report.html").read_text(encoding="utf-8")
    assert f"workbench bless {out} --baseline {baseline}" in page
    root = ET.parse(out / "junit.xml").getroot()
    failures = root.findall(".//failure")
    assert len(failures) == int(root.get("failures", "0")) >= 3

    # It also fails where only the baseline is worse. Being faster will cost air and overshoot,
    # which this study says it does not mind.
    minded = "".join(f"[tolerances.{m}]\ngates = false\n" for m in ("overshoot", "chatter", "air"))
    given = (("limit = 0.6", "limit = 60"), ("hard = false\n", f"hard = false\n{minded}"))
    loose = small_study(tmp_path, WORSE, *given)
    shell("compare", loose, *against, status=1)
    # Accepting it is one command, which shows what it accepts; then all is green.
    said = shell(*bless).out
    assert "settling_time" in said and "worse" in said and "0 better" not in said.split(":")[0]
    # An improvement does not fail, and is blessed by the same command.
    better = small_study(tmp_path, *given)
    shell("compare", better, *against)
    assert "Better than the baseline" in (out / "summary.md").read_text(encoding="utf-8")
    assert "better" in shell(*bless).out


@pytest.mark.system
def test_linear_analysis_alone(tmp_path: Path, shell: Shell) -> None:
    study, out = small_study(tmp_path), tmp_path / "margins"
    said = shell("report", study, "--bode --angle 20deg --angle 40deg --out", out).out
    assert said.count("disk margin") == 4 and "20°" in said and "40°" in said
    names = {p.name for p in (out / "pictures").iterdir()}
    assert {"bode-1.png", "bode-1.svg", "nyquist-1.png", "nyquist-1.svg"} <= names
    page = (out / "report.html").read_text("utf-8")
    assert not (out / "runs").exists() and "Nyquist" in page
    # A name has no article: it may be x.
    assert "from valve to angle" in page and "to the angle" not in page


CASES = {
    "no study": ("compare nowhere.toml --out out", "cannot be read"),
    "unknown shipped study": ("compare arms --out out", "did you mean 'arm'"),
    "no baseline": ("compare STUDY --out out --baseline b.json", "workbench bless"),
    "no processes": ("compare STUDY --out out --jobs 0", "number of processes"),
    "no results": ("bless nowhere --baseline b.json", "workbench compare"),
    "unknown controller": ("report STUDY --bode -c pd --out out", "'pd'"),
    "angle outside": ("report STUDY --bode --angle 95deg --out out", "95 deg"),
    "results in a file": ("compare STUDY --out STUDY", "is a file; give the name of a"),
    "limit with bode": ("report STUDY --bode --limit --out out", "leave out --b"),
    "controller without bode": ("report STUDY -c pid --out out", "add --bode"),
}


def test_a_folder_of_results_hides_no_shipped_study(here: Path) -> None:
    Path("arm").mkdir()
    assert named_study(Path("arm"), None, ()).name == load_study(shipped_study("arm")).name


@pytest.mark.parametrize("name", CASES)
def test_wrong_use(name: str, here: Path, refused: Refused) -> None:
    words, sentence = CASES[name]
    small_study(here).rename("STUDY")
    assert sentence in refused(words).splitlines()[-1]
    assert not (here / "out").exists() and not (here / "b.json").exists()


@pytest.mark.long
@pytest.mark.usefixtures("undrawn")
def test_a_baseline_of_another_study_is_not_overwritten(
    tmp_path: Path, shell: Shell, refused: Refused
) -> None:
    out, baseline = tmp_path / "out", tmp_path / "b.json"
    shell("compare --jobs 1", small_study(tmp_path), "--out", out)
    shell("bless", out, "--baseline", baseline)
    before = baseline.read_text(encoding="utf-8")
    other = small_study(tmp_path, ('name = "small"', 'name = "other"'))
    said = refused("compare --jobs 1", other, "--out", out)
    assert "holds the results of study 'small'" in said
    out = tmp_path / "another"
    shell("compare --jobs 1", other, "--out", out)
    assert "is the baseline of study 'small'" in refused("bless", out, "--baseline", baseline)
    assert baseline.read_text(encoding="utf-8") == before
