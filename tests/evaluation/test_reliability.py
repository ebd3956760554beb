"""Reliability: findings by their weight, and how many of them are right."""

from __future__ import annotations

from workbench.evaluation.rates import reliability, reliability_lines, told


def _finding(effect: str | None, weight: float | None, *alike: str) -> dict[str, object]:
    return {"effect": effect, "class": [effect, *alike], "weight": weight}


def test_only_named_findings_that_were_weighed_count() -> None:
    verdict = {
        "findings": [
            _finding("play", 0.95),
            _finding("creep", 0.4, "drift"),
            _finding("ripple", None),
            _finding("nonparametric", 0.9),
            _finding(None, 0.9),
        ]
    }
    assert told(verdict, ["play", "drift"]) == [(0.95, True), (0.4, True)]
    assert told(verdict, ["friction"]) == [(0.95, False), (0.4, False)]
    assert told({}, ["friction"]) == []


def test_each_finding_is_in_one_bin() -> None:
    findings = [(0.0, False), (0.5, True), (0.6, False), (0.9, True), (0.95, True), (1.0, True)]
    bins = reliability(findings)
    assert sum(b.right.total for b in bins) == len(findings)
    assert [(b.right.count, b.right.total) for b in bins] == [(1, 2), (1, 2), (1, 1), (1, 1)]
    assert len(reliability_lines(findings)) == 1 + len(bins) and reliability_lines([]) == []
