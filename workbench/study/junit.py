"""The outcome of a study as JUnit XML, one test per requirement, run and comparison."""

from __future__ import annotations

import re
import xml.etree.ElementTree as ET

from workbench.study.result import StudyResult

_NOT_XML = re.compile("[^\t\n\r -\ud7ff\ue000-\ufffd\U00010000-\U0010ffff]")


def junit(outcome: StudyResult) -> str:
    """Write the outcome as JUnit XML, one suite per controller.

    A test per requirement, scenario and variation fails if a hard one is missed, and is skipped,
    with the reason, if a soft one is; a test per run is an error if the run failed, and fails if it
    is worse than the baseline.
    """
    root = ET.Element("testsuites", name=_clean(outcome.study.name))
    suites = {}
    for controller in dict.fromkeys(
        [*outcome.study.controllers, *(c.key[0] for c in outcome.changes)]
    ):
        suites[controller] = ET.SubElement(root, "testsuite", name=_clean(controller))

    def case(controller: str, group: str, name: str, seconds: float = 0.0) -> ET.Element:
        return ET.SubElement(
            suites[controller],
            "testcase",
            classname=_clean(f"{outcome.study.name}.{controller}.{group}"),
            name=_clean(name),
            time=f"{seconds:.3f}",
        )

    for record in outcome.records:
        name = f"runs, {record.variation}, seed {record.seed}"
        test = case(record.controller, record.scenario, name, record.seconds)
        if record.failed:
            ET.SubElement(test, "error", message=_clean(record.reason))
    for j in outcome.judgements:
        test = case(j.controller, j.scenario, f"{j.demand}, {j.variation}")
        if j.met:
            continue
        kind, tail = ("failure", "") if j.hard else ("skipped", " (soft)")
        message = f"{j.demand.requirement.metric} {j.excess()}{tail}"
        ET.SubElement(test, kind, message=_clean(message))
    for r in outcome.robustness:
        test = case(r.controller, "robustness", "worst plant of the box")
        if r.missed:
            message = f"score {r.worst_score:.3g} at {dict(r.worst)}: {r.judgement or r.why()}"
            kind, tail = ("failure", "") if r in outcome.fragile else ("skipped", " (only informs)")
            ET.SubElement(test, kind, message=_clean(message + tail))
    for change in outcome.condition_changes:
        if "conditions" not in suites:
            suites["conditions"] = ET.SubElement(root, "testsuite", name="conditions")
        test = case("conditions", "baseline", f"{change.name} is as in the baseline")
        if change.fails:
            ET.SubElement(test, "failure", message=_clean(str(change)))
    if outcome.baseline is not None:
        runs = [*(r.key for r in outcome.records), *outcome.baseline.records]
        for key in dict.fromkeys([*runs, *(c.key for c in outcome.worse)]):
            if key[0] not in suites:
                continue
            test = case(key[0], key[2], f"no worse than the baseline, {key[1]}, seed {key[3]}")
            own = [str(c) for c in outcome.worse if c.key == key]
            if own:
                ET.SubElement(test, "failure", message=_clean("; ".join(own)))
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
