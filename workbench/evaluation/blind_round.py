"""Scoring a blind round: verdicts against what was hidden, and against random answers.

Points per hidden effect: 6 for the right name at the right group of ports; 3 for a class of at most
three look-alikes that contains it; 2 for the right group only; 1 for telling a sensor from the
process; 0 for an honest abstention; -6 for a confident wrong name. Where nothing is hidden: 6 for
silence, -6 for any name. For an effect outside the library: 6 for a free-form term in the right
group that improves the held-out recordings, -6 for a wrong name.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import permutations
from pathlib import Path
from typing import Any, get_args

import numpy as np

from workbench.checked_json import (
    TableShape,
    listed,
    named,
    number,
    one_of,
    optional,
    read_json,
    text,
)
from workbench.diagnosis.verdict import SCHEMA, Kind, upgraded
from workbench.display import aligned_table
from workbench.errors import WorkbenchError
from workbench.evaluation.answer_key import (
    NOTHING,
    Names,
    Truth,
    check_commitments,
    read_key,
    read_names,
    words_of,
)
from workbench.evaluation.rates import Rate
from workbench.files import picked


@dataclass(frozen=True)
class Answer:
    """What one verdict claims.

    Args:
        findings: Pairs of the class of names (the named one first; empty without a name) and the
            groups of ports, the most likely first.
        improves: Whether the extended model is better than the refitted one on held-out recordings.
        over_noise: Error of the extended model over the sensors' noise, root mean square over the
            outputs, dimensionless; NaN if it was not given.
    """

    case: str
    kind: str
    findings: tuple[tuple[tuple[str, ...], tuple[str, ...]], ...]
    improves: bool
    over_noise: float = math.nan

    @property
    def names(self) -> int:
        """How many effects it names."""
        return sum(bool(names) for names, _ in self.findings)


def read_answer(path: str | Path, case: str, names: Names) -> Answer:
    """Read what a ``verdict.json`` claims."""
    data = read_json(path, "verdict", _VERDICT, fix=_FORM)
    return answer_of(upgraded(data, f"verdict {str(path)!r}"), case, names)


_FORM = (
    '\'workbench diagnose\' writes it; of another method it is {"schema": "'
    + SCHEMA
    + '", "verdict": WORD, "findings": [{"effect": NAME, "where": [PORT]}]}'
)
_ERRORS = optional(named(optional(number)))
_HELD_OUT = TableShape({}, dict.fromkeys(("extended", "refitted", "noise_floor"), _ERRORS))
_FINDING = TableShape(
    {}, {"effect": optional(text), "class": optional(listed(text)), "where": optional(listed(text))}
)
_VERDICT = TableShape(
    {"schema": text, "verdict": one_of(*get_args(Kind))},
    {
        "findings": optional(listed(_FINDING)),
        "fit": optional(TableShape({}, {"held_out": optional(_HELD_OUT)})),
    },
)


def answer_of(data: Mapping[str, Any], case: str, names: Names) -> Answer:
    """Return what the content of a ``verdict.json`` claims."""
    data = upgraded(data)
    findings = []
    for finding in data.get("findings") or ():
        effect = finding.get("effect")
        named = bool(effect) and effect != "nonparametric"
        alike = tuple(finding.get("class") or ()) if named else ()
        members = tuple(dict.fromkeys((effect, *alike))) if named else ()
        groups = tuple(dict.fromkeys(names.group(port) for port in finding.get("where") or ()))
        findings.append((members, groups))
    better = over_limit(data, held_out(data, "refitted")) < 1.0
    over_noise = over_limit(data, held_out(data, "noise_floor"))
    return Answer(case, data["verdict"], tuple(findings), better, over_noise)


LARGEST_RATIO = 1.5
"""Held-out error over that of the true model which still counts as within the noise."""


def over_limit(verdict: Mapping[str, Any], limit: Mapping[str, float]) -> float:
    """Return the held-out error of a verdict's model over a limit; NaN if it has none.

    Args:
        limit: Error of the true model by output, root mean square in SI.

    Returns:
        The ratio, root mean square over the outputs.
    """
    ratios = [
        float(value) / float(limit[name])
        for name, value in held_out(verdict, "extended").items()
        if value is not None and limit.get(name)
    ]
    with np.errstate(over="ignore", invalid="ignore"):
        return float(np.sqrt(np.mean(np.square(ratios)))) if ratios else math.nan


def held_out(verdict: Mapping[str, Any], whose: str) -> Mapping[str, float]:
    """Return held-out errors that a verdict gives, in SI by output; nothing if it gives none.

    Args:
        whose: ``refitted``, ``extended`` or ``noise_floor``.
    """
    return ((verdict.get("fit") or {}).get("held_out") or {}).get(whose) or {}


def names_of(verdict: Mapping[str, Any]) -> list[str]:
    """Return the names that a verdict gives."""
    said = (finding.get("effect") for finding in verdict.get("findings") or ())
    return [name for name in said if name not in (None, "nonparametric", "free_form")]


RIGHT, CLASS, GROUP, SIDE, NONE, WRONG = 6, 3, 2, 1, 0, -6
"""Points."""

LARGEST_CLASS = 3
"""Members that a class may have to count."""

WORDS: dict[int, str] = {
    RIGHT: "right",
    CLASS: "right class",
    GROUP: "right group only",
    SIDE: "right side only",
    NONE: "abstained",
    WRONG: "wrong name",
}
"""Points as people read them."""

_SILENT = ("nothing_missing", "parameter")
_DRAWS = 20_000


@dataclass(frozen=True)
class Line:
    """The score of one case.

    Args:
        hidden: What was hidden, in the words of the key.
        most: Most points that could be had.
        located: Whether each hidden effect was put into the right group.
        named: Whether each hidden effect was named, rightly or within a class.
        over_noise: Error of the extended model over the sensors' noise, dimensionless.
    """

    case: str
    hidden: str
    said: str
    points: int
    most: int
    remark: str
    located: tuple[bool, ...] = ()
    named: tuple[bool, ...] = ()
    over_noise: float = math.nan

    def as_data(self) -> dict[str, Any]:
        """Return the score as plain data."""
        return picked(self, "case hidden said points most remark")


@dataclass(frozen=True)
class RoundScore:
    """The score of a round.

    Args:
        p_value: Probability that verdicts dealt out to the cases at random score as much.
        chance: Mean points of such verdicts, dimensionless.
        committed: Number of answers checked against their commitments; None if none were given.
        false_alarms: Cases that hide nothing and got a name, and how many hide nothing.
    """

    lines: tuple[Line, ...]
    p_value: float
    chance: float
    committed: int | None = None
    false_alarms: tuple[int, int] = (0, 0)

    @property
    def points(self) -> int:
        """Points of all cases."""
        return sum(line.points for line in self.lines)

    @property
    def most(self) -> int:
        """Most points that could be had."""
        return sum(line.most for line in self.lines)

    @property
    def wrong(self) -> int:
        """Cases with a confident wrong name."""
        return sum("wrong name" in line.remark for line in self.lines)

    @property
    def rates(self) -> dict[str, Rate]:
        """Shares of hidden effects, of cases, and of cases that hide nothing."""
        return {
            "right group": Rate.of(right for line in self.lines for right in line.located),
            "right name or class": Rate.of(right for line in self.lines for right in line.named),
            "wrong name": Rate(self.wrong, len(self.lines)),
            "false alarm": Rate(*self.false_alarms),
        }

    def as_data(self) -> dict[str, Any]:
        """Return the score as plain data."""
        group, name, wrong, _ = (r.value if r.total else None for r in self.rates.values())
        return {
            "schema": "workbench.round/1",
            **picked(self, "points most p_value points_by_chance=chance answers_checked=committed"),
            "false_alarms": self.false_alarms[0],
            "cases_hiding_nothing": self.false_alarms[1],
            "right_group_rate": group,
            "right_name_or_class_rate": name,
            "confidently_wrong_rate": wrong,
            "cases": [
                line.as_data()
                | {"error_over_noise": line.over_noise if math.isfinite(line.over_noise) else None}
                for line in self.lines
            ],
        }

    def __str__(self) -> str:
        heading = ("case", "hidden", "verdict", "points", "", "over noise")
        rows = []
        for line in self.lines:
            over = f"{line.over_noise:.3g}" if math.isfinite(line.over_noise) else "–"
            points = f"{line.points} of {line.most}"
            rows.append((line.case, line.hidden, line.said, points, line.remark, over))
        group, name, wrong, _ = (
            f"{100 * r.value:.0f} %" if r.total else "–" for r in self.rates.values()
        )
        silent, nothing = self.false_alarms
        checked = f"{self.committed} answers are those committed beforehand"
        return (
            f"{aligned_table(heading, rows, width=None)}\n"
            f"{self.points} of {self.most} points; random answers {self.chance:.1f},"
            f" p = {self.p_value:.2g}\n"
            f"right group {group}, right name or class {name}, confidently wrong {wrong},"
            f" false alarms {silent} of {nothing}\n"
            + ("not checked against commitments" if self.committed is None else checked)
        )


def score_verdicts(
    verdicts: str | Path,
    key: str | Path,
    *,
    commitments: str | Path | None = None,
    names: str | Path | None = None,
) -> RoundScore:
    """Score a folder of verdicts against a key.

    Args:
        verdicts: Folder with ``CASE.json`` or ``CASE/verdict.json`` for each case.
        commitments: Text file with the SHA-256 of each answer, fixed before the verdicts.
        names: TOML file on how words of the key are read, beyond those that ship.

    Raises:
        WorkbenchError: If a file cannot be read, a verdict is missing, a word of the key has no
            meaning, or an answer is not the one committed.
    """
    answers = read_key(key)
    table = read_names(names)
    committed = None if commitments is None else check_commitments(answers, commitments)
    truths = {case: table.truths(case, words_of(answer)) for case, answer in answers.items()}
    given = [read_answer(verdict_file(Path(verdicts), case), case, table) for case in truths]
    return score_round(given, list(truths.values()), committed=committed)


def score_round(
    answers: Sequence[Answer], truths: Sequence[Sequence[Truth]], *, committed: int | None = None
) -> RoundScore:
    """Score answers case by case and against answers dealt out at random.

    Returns:
        The score. The p-value is the share of random permutations of the answers over the cases
        that score at least as much, the given order counted in.
    """
    lines = tuple(score_case(a, t) for a, t in zip(answers, truths, strict=True))
    table = np.array([[score_case(a, t).points for t in truths] for a in answers], dtype=float)
    rng = np.random.default_rng(0)
    n = len(answers)
    dealt = np.array([rng.permutation(n) for _ in range(_DRAWS)])
    draws = table[np.arange(n), dealt].sum(axis=1)
    reached = float(np.trace(table))
    p_value = (1 + int(np.sum(draws >= reached - 1e-9))) / (1 + _DRAWS)
    nothing = [answer for answer, hidden in zip(answers, truths, strict=True) if not hidden]
    alarms = sum(bool(answer.findings) for answer in nothing)
    return RoundScore(lines, p_value, float(draws.mean()), committed, (alarms, len(nothing)))


def score_case(answer: Answer, truths: Sequence[Truth]) -> Line:
    """Score one case.

    Findings are dealt to the hidden effects so that the points are most; a finding beyond those
    counts as a confident wrong name if it names something.

    Example:
        >>> tilt = Truth("tilt", ("tilt_gravity",), ("motion",), False)
        >>> found = Answer("one", "named", ((("tilt_gravity",), ("motion",)),), True)
        >>> score_case(found, [tilt]).points, score_case(found, []).points
        (6, -6)
    """
    said = _said(answer)
    if not truths:
        points = WRONG if answer.findings else RIGHT if answer.kind in _SILENT else NONE
        remark = {RIGHT: "silent", NONE: "not sure", WRONG: "wrong name"}[points]
        return Line(answer.case, NOTHING, said, points, RIGHT, remark, (), (), answer.over_noise)
    deals = []
    places = [*range(len(truths)), *[-1] * max(0, len(answer.findings) - len(truths))]
    for deal in set(permutations(places, len(answer.findings))):
        dealt, surplus = [NONE] * len(truths), 0
        for finding, place in zip(answer.findings, deal, strict=True):
            if place >= 0:
                dealt[place] = _points(answer, finding, truths[place])
            else:
                surplus += bool(finding[0])
        deals.append((sum(dealt) + WRONG * surplus, dealt, surplus))
    total, dealt, surplus = max(deals, key=lambda found: found[0])
    hidden, most = ", ".join(truth.word for truth in truths), RIGHT * len(truths)
    remark = ", ".join([*(WORDS[points] for points in dealt), *["wrong name"] * surplus])
    located = tuple(any(_in_group(groups, t) for _, groups in answer.findings) for t in truths)
    named, noise = tuple(points >= CLASS for points in dealt), answer.over_noise
    return Line(answer.case, hidden, said, total, most, remark, located, named, noise)


def _points(answer: Answer, finding: tuple[tuple[str, ...], tuple[str, ...]], truth: Truth) -> int:
    names, groups = finding
    here = _in_group(groups, truth)
    if not names:
        if here and truth.outside and answer.kind == "located_unnamed" and answer.improves:
            return RIGHT
        if here:
            return GROUP
        return SIDE if groups and ("sensor" in groups[0]) == truth.sensor else NONE
    if not set(names) & set(truth.library):
        return WRONG
    if len(names) == 1:
        return RIGHT
    if len(names) <= LARGEST_CLASS:
        return CLASS
    return GROUP if here else NONE


def _in_group(groups: Sequence[str], truth: Truth) -> bool:
    return bool(groups) and groups[0] in truth.groups


def _said(answer: Answer) -> str:
    if not answer.findings:
        return answer.kind.replace("_", " ")
    return ", ".join(
        " or ".join(names) if names else f"something at {groups[0] if groups else 'no place'}"
        for names, groups in answer.findings
    )


def verdict_file(folder: Path, case: str) -> Path:
    """Return the file of a verdict, ``CASE/verdict.json`` or ``CASE.json``."""
    if not folder.is_dir():
        raise WorkbenchError(f"there is no folder {str(folder)!r} with verdicts")
    for path in (folder / case / "verdict.json", folder / f"{case}.json"):
        if path.is_file():
            return path
    raise WorkbenchError(
        f"folder {str(folder)!r} has no verdict of case {case}; it needs {case}/verdict.json or"
        f" {case}.json"
    )
