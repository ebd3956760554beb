"""What a study missed, as annotations of a pull request at the lines of the study file."""

from __future__ import annotations

import os
from collections.abc import Mapping

from workbench.study.grouped import changes_by_plant, missed_by_plant
from workbench.study.result import StudyResult
from workbench.study.schema import read_study
from workbench.study.toml_tables import line_of

MOST = 10
"""Annotations of each kind; GitHub shows ten per step."""


def github_annotations(outcome: StudyResult) -> tuple[str, ...]:
    """Return workflow commands of GitHub: errors for what fails the study, else warnings."""
    text = read_study(outcome.study.path).text
    errors: list[tuple[int, str]] = []
    warnings: list[tuple[int, str]] = []
    for hard, found in ((True, outcome.missed), (False, outcome.missed_softly)):
        for group in missed_by_plant(found):
            j = group.worst
            line = line_of(text, ("requirements", outcome.study.demands.index(j.demand)))
            (errors if hard else warnings).append((line, f"{j} {group.also}".strip()))
    for r in outcome.box_missed:
        said = f"{r.controller}, worst plant of the box: {r.why()}"
        where = errors if outcome.fragile else warnings
        where.append((line_of(text, ("robustness",)), said))
    errors += [(1, str(change)) for change in outcome.weakened]
    errors += [
        (line_of(text, ("controllers", r.controller)), f"{', '.join(r.key[:3])}: {r.reason}")
        for r in outcome.failed
    ]
    for change in changes_by_plant(outcome.worse, outcome.required):
        place = line_of(text, ("controllers", change.worst.key[0]))
        errors.append((place, f"worse than the baseline: {change.worst} {change.also}".strip()))
    file = os.path.relpath(outcome.study.path)
    return tuple(
        f"::{kind} file={_property(file)},line={line}::{_data(text)}"
        for kind, found_ in (("error", errors), ("warning", warnings))
        for line, text in found_[:MOST]
    )


def on_github(environment: Mapping[str, str]) -> bool:
    """Tell whether a runner of GitHub reads what is printed."""
    return environment.get("GITHUB_ACTIONS") == "true"


def _data(text: str) -> str:
    return text.replace("%", "%25").replace("\r", "%0D").replace("\n", "%0A")


def _property(text: str) -> str:
    return _data(text).replace(":", "%3A").replace(",", "%2C")
