"""What continuous integration reads of a study: JUnit XML, and annotations of its file."""

from __future__ import annotations

import os
import re
import xml.etree.ElementTree as ET

from workbench.study.grouped import changes_by_plant, missed_by_plant
from workbench.study.read import read_study
from workbench.study.result import StudyResult
from workbench.study.summary import worst_plant
from workbench.study.toml_lines import line_of

_NOT_XML = re.compile("[^\t\n\r -\ud7ff\ue000-\ufffd\U00010000-\U0010ffff]")


def junit(outcome: StudyResult) -> str:
    """Write the outcome as JUnit XML, one suite per controller.

    A test per requirement, scenario and variation fails if a hard one is missed, and is skipped,
    with the reason, if a soft one is; a test per run is an error if the run failed, and fails if it
    is worse than the baseline.
    """
    root = ET.Element("testsuites", name=_clean(outcome.study.name))
    names = dict.fromkeys([*outcome.study.controllers, *(c.key[0] for c in outcome.changes)])
    names |= dict.fromkeys(["conditions"] if outcome.condition_changes else [])
    suites = {name: ET.SubElement(root, "testsuite", name=_clean(name)) for name in names}

    def case(
        controller: str, group: str, name: str, kind: str, message: str, seconds: float = 0.0
    ) -> None:
        test = ET.SubElement(
            suites[controller],
            "testcase",
            classname=_clean(f"{outcome.study.name}.{controller}.{group}"),
            name=_clean(name),
            time=f"{seconds:.3f}",
        )
        if kind:
            ET.SubElement(test, kind, message=_clean(message))

    for record in outcome.records:
        name = f"runs, {record.variation}, seed {record.seed}"
        kind = "error" if record.failed else ""
        case(record.controller, record.scenario, name, kind, record.reason, record.seconds)
    for j in outcome.judgements:
        kind, tail = ("failure", "") if j.hard else ("skipped", " (soft)")
        message = f"{j.demand.requirement.metric} {j.excess()}{tail}"
        name = f"{j.demand}, {j.variation}"
        case(j.controller, j.scenario, name, "" if j.met else kind, message)
    for r in outcome.robustness:
        message = (
            f"score {r.worst_score:.3g} at {worst_plant(outcome, r)}: {r.judgement or r.why()}"
        )
        kind, tail = ("failure", "") if r in outcome.fragile else ("skipped", " (only informs)")
        name = "worst plant of the box"
        case(r.controller, "robustness", name, kind if r.missed else "", message + tail)
    for change in outcome.condition_changes:
        name = f"{change.name} is as in the baseline"
        case("conditions", "baseline", name, "failure" if change.fails else "", str(change))
    if outcome.baseline is not None:
        runs = [*(r.key for r in outcome.records), *outcome.baseline.records]
        for key in dict.fromkeys([*runs, *(c.key for c in outcome.worse)]):
            if key[0] in suites:
                name = f"no worse than the baseline, {key[1]}, seed {key[3]}"
                own = "; ".join(str(c) for c in outcome.worse if c.key == key)
                case(key[0], key[2], name, "failure" if own else "", own)
    for element in (*suites.values(), root):
        tests = list(element.iter("testcase"))
        element.set("tests", str(len(tests)))
        for kind, count in (("failure", "failures"), ("error", "errors"), ("skipped", "skipped")):
            if kind != "skipped" or element is not root:
                element.set(count, str(sum(t.find(kind) is not None for t in tests)))
        element.set("time", f"{sum(float(t.get('time', 0)) for t in tests):.3f}")
    ET.indent(root)
    return f'<?xml version="1.0" encoding="UTF-8"?>\n{ET.tostring(root, encoding="unicode")}\n'


def _clean(text: str) -> str:
    return _NOT_XML.sub("?", text)


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
    file = _data(os.path.relpath(outcome.study.path)).replace(":", "%3A").replace(",", "%2C")
    return tuple(
        f"::{kind} file={file},line={line}::{_data(text)}"
        for kind, found_ in (("error", errors), ("warning", warnings))
        for line, text in found_[:MOST]
    )


def _data(text: str) -> str:
    return text.replace("%", "%25").replace("\r", "%0D").replace("\n", "%0A")
