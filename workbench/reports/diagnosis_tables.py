"""Tables of a diagnosis: errors, parameters, scores, what could not be seen, checks."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import partial

import numpy as np

from workbench.diagnosis.comparison import ErrorRow
from workbench.diagnosis.estimation.refit_result import Estimate
from workbench.diagnosis.location.isolability import Isolability
from workbench.diagnosis.nonparametric.result import Argument, NonparametricTerm
from workbench.diagnosis.selection.candidate import Candidate
from workbench.diagnosis.selection.score import COLLINEAR, Score, Scores
from workbench.diagnosis.stages import Diagnosis
from workbench.diagnosis.verdict import Verdict
from workbench.model import Model
from workbench.model.units import readably, written_unit
from workbench.physics.parameter_laws import along_curve
from workbench.recordings.checks.check import CHECKS, USUAL_FIX
from workbench.reports.figures.diagnosis import titled
from workbench.reports.tables import Cell, Table, interval, number, plain, plus_minus

_SHOWN_SCORES = 12


def errors_table(errors: Sequence[ErrorRow], extended: bool) -> Table:
    """Build the table of free-run errors on all held-out recordings."""
    wanted = ("nominal", "refitted", "extended") if extended else ("nominal", "refitted")
    labels = [label for label in wanted if any(label in row.rmse for row in errors)]

    def error(label: str, row: ErrorRow) -> Cell:
        beside = f"{number(100 * row.normalised(label))} % of the spread"
        return Cell(
            number(row.rmse[label]), reason=f"{beside}, {number(row.over_noise(label))} × noise"
        )

    return Table.of(
        "Errors of free runs over all held-out recordings",
        errors,
        {
            "output": lambda row: titled(row.output, written_unit(row.unit) or "1"),
            **{label: partial(error, label) for label in labels},
            "sensor's noise": lambda row: number(row.noise),
        },
        "Root mean square; nominal: before any fit; refitted: nominal equations, with the"
        " parameters that run closest" + ("; extended: with what was found." if extended else "."),
    )


def parameters_table(diagnosis: Diagnosis) -> Table:
    """Build the table of parameters before the data, refitted and in the extended model.

    Values that are wrong stand first where that is the verdict; ordinates of a curve
    without a name stand last.
    """
    before = {e.name: e for e in diagnosis.refitted.refit.as_read}
    after = {e.name: e for e in diagnosis.extended.refit.as_read} if diagnosis.improved else {}
    for candidate, _ in diagnosis.accepted if after else ():
        effect = diagnosis.extended.model.effect(candidate.name)
        curve = list(along_curve(diagnosis.extended.model, effect).values())
        if curve and (subject := after.get(effect.about.subject)):
            # What is a curve now stands with its value in the middle of what was seen.
            after[subject.name] = replace(subject, value=curve[1])
    wrong = diagnosis.verdict.kind == "parameter"
    added = [n for n in after if n not in before]
    names = [*added, *before] if diagnosis.accepted else [*before, *added]
    if wrong:
        held = {name for name, _ in diagnosis.nominal.traits.held}
        names.sort(key=lambda name: not (before[name].on_bound or name in held))
    ordinates = _ordinates(diagnosis)
    rows: list[tuple[Cell | str, ...]] = []
    for name in names:
        one = before.get(name) or after[name]
        new = name not in before
        mean, std, unit = one.read(one.prior.mean, one.prior.std)
        words = ordinates.get(name) or plain(name.replace(".", ", "))
        shown = words if unit == "1" else f"{words} in {unit}"
        cells: list[Cell | str] = [
            shown + (" (new)" if new else ""),
            "" if new else plus_minus(mean, std),
            _estimate(before.get(name), one, wrong=wrong),
        ]
        if after:
            cells.append(_estimate(after.get(name), one))
        cells.append(_moved(before.get(name), after.get(name)) if not new else "")
        rows.append(tuple(cells))
    headings = ["parameter", "before the data", "refitted"]
    headings += ["extended", "distance"] if after else ["distance"]
    return Table(
        "Values with their standard deviations",
        tuple(headings),
        tuple(rows),
        "Distance: from the value before the data, in standard deviations of what was known"
        + (", refitted and extended. True physics lets the others return." if after else "."),
    )


def _ordinates(diagnosis: Diagnosis) -> dict[str, str]:
    """Say of the ordinates of a term without a name where on the curve they are."""
    term = diagnosis.nonparametric
    if term is None:
        return {}
    named = {}
    for curve in term.curves.values():
        knots, unit = readably(np.array(curve.knots), curve.unit, term.read_in(curve.argument))
        for short, knot in zip(curve.names, knots, strict=True):
            # A knot at the end of the data may miss zero by a rounding error.
            near = abs(knot) < 1e-3 * (knots[-1] - knots[0])
            where = f"{number(0.0 if near else float(knot))} {unit}".removesuffix(" 1")
            argument = plain(curve.argument)
            named[f"{term.effect_name}.{short}"] = (
                f"nonparametric term, curve at {argument} {where},"
            )
    return named


def _estimate(estimate: Estimate | None, first: Estimate, *, wrong: bool = False) -> Cell:
    """Write an estimate in the unit of the first in its row."""
    if estimate is None:
        return Cell("")
    value, std, _ = first.read(estimate.value, estimate.std)
    text = plus_minus(value, std, 4)
    if wrong and estimate.on_bound:
        return Cell(text, "missed", "on the bound of what is plausible")
    return Cell(text, reason="on its bound" if estimate.on_bound else "")


def _moved(before: Estimate | None, after: Estimate | None) -> str:
    said = [
        number(abs(e.value - e.prior.mean) / e.prior.std, 2)
        for e in (before, after)
        if e is not None and e.prior.std > 0
    ]
    return " → ".join(said)


def scores_table(
    title: str,
    model: Model,
    scores: Scores,
    candidates: Sequence[Candidate],
    taken_back: Mapping[str, str] | None = None,
) -> Table:
    """Build the table of scores, refits and confusion with the best effect."""
    names = [score.entry.name for score in scores.scores]
    tried = {c.entry.name: c for c in candidates}
    reference = candidates[0].entry.name if candidates else (names[0] if names else "")
    row = names.index(reference) if reference in names else 0
    listed = [n for n in tried if n in names]
    listed += [n for n in names if n not in tried][: max(0, _SHOWN_SCORES - len(listed))]
    own = {score.entry.name: score for score in scores.scores}
    columns: dict[str, Callable[[str], Cell | str]] = {
        "effect": plain,
        "acts at": lambda name: plain(", ".join(dict.fromkeys(own[name].entry.ports))),
        "expected gain": lambda name: number(own[name].gain),
        "expected size": lambda name: _size(own[name], model),
        "collinear": lambda name: f"{100 * own[name].collinearity:.0f} %",
    }
    # Without a refit there is nothing to compare with, and no outcome.
    compared: dict[str, Callable[[str], Cell | str]] = {
        f"alike {plain(reference)}": lambda name: (
            "–" if name == reference else f"{scores.confusion[row, names.index(name)]:.2f}"
        ),
        "gain when refitted": lambda name: _fitted(tried.get(name)),
        "gain on held-out recordings": lambda name: _held_out(tried.get(name)),
        "outcome": lambda name: _outcome(tried.get(name), taken_back or {}),
    }
    more = len(names) - len(listed)
    return Table.of(
        title,
        listed,
        columns | (compared if candidates else {}),
        "Gains in units of log likelihood." + (f" The other {more} score less." if more else ""),
    )


def weights_table(verdict: Verdict) -> Table:
    """Tabulate how likely each of the sets of effects is that were compared."""
    return Table.of(
        "How likely each set of effects is",
        verdict.weights,
        {"effects": lambda w: plain(str(w)), "weight": lambda w: f"{w.weight:.2f}"},
        "Share of the posterior over all sets that were refitted to the end, averaged over blocks"
        " of the recordings drawn with replacement. What spoils free runs is none of them.",
    )


def _size(score: Score, model: Model) -> str:
    entry = score.entry
    unit, factor = model.reading(entry.unit, *entry.effect.places, size=score.size)
    return f"{number(factor * score.size)} {unit}".removesuffix(" 1")


def _fitted(candidate: Candidate | None) -> str:
    if candidate is None or not math.isfinite(candidate.gain):
        return ""
    return number(round(candidate.gain))


def _held_out(candidate: Candidate | None) -> str:
    if candidate is None or not math.isfinite(candidate.held_out[1]):
        return ""
    gain, low, high = (number(round(value)) for value in candidate.held_out)
    return f"{gain} ({low} … {high})"


def _outcome(candidate: Candidate | None, taken_back: Mapping[str, str]) -> Cell:
    if candidate is None:
        return Cell("scored only")
    if candidate.refused:
        return Cell(candidate.refused)
    if candidate.entry.name in taken_back:
        return Cell("taken back", reason=taken_back[candidate.entry.name])
    return Cell("accepted")


def unseen_table(verdict: Verdict) -> Table:
    """Build the table of effects that these recordings could not have shown."""
    return Table.of(
        "What these recordings could not have shown",
        verdict.not_testable,
        {"effect": lambda item: plain(item["effect"]), "why": lambda item: item["reason"]},
        f"Collinear beyond {100 * COLLINEAR:.0f} %, or too small at every plausible size.",
    )


def checks_table(verdict: Verdict) -> Table:
    """Build the table of checks that did not simply pass."""
    passed = sum(row.get("result") == "pass" for row in verdict.data)
    remarks = [row for row in verdict.data if row.get("result") != "pass"]
    return Table.of(
        "Checks of the recordings",
        sorted(remarks, key=lambda row: row["result"] != "unfit"),
        {
            "recording": lambda row: row["recording"],
            "check": lambda row: row["check"],
            "result": lambda row: Cell(row["result"], "missed" if row["result"] == "unfit" else ""),
            "note": lambda row: row["note"],
        },
        f"{passed} checks passed without remark.",
    )


def unfit_sentences(verdict: Verdict) -> tuple[str, ...]:
    """Say which checks found recordings unfit, and what usually helps."""
    return tuple(
        f"{row['recording']} fails the check of {row['check']}: {row['note'].rstrip('.')}."
        f" Usual fix: {check.fix if check else USUAL_FIX}."
        for row in verdict.data
        if row.get("result") == "unfit"
        for check in (CHECKS.members().get(row["check"]),)
    )


_SENSORS = 3


def isolability_table(found: Isolability, located: Sequence[str] = ()) -> Table:
    """Build the table of groups of ports that the recorded outputs can tell apart.

    Args:
        located: Ports at which something was located; their groups come first.
    """
    rows: list[tuple[Cell | str, ...]] = []
    groups = sorted(found.groups, key=lambda group: not set(group) & set(located))
    for group in groups:
        near = found.nearest.get(group[0])
        beside = "" if near is None else f"{near[0]}, {number(math.degrees(near[1]), 2)}° apart"
        # The port that was located stands first in its group.
        named = plain(", ".join(sorted(group, key=lambda port: port not in located)))
        here = "located here" if set(group) & set(located) else ""
        rows.append((Cell(named, reason=here), plain(beside)))
    if found.unseen:
        rows.append((plain(", ".join(found.unseen)), "cannot be seen at all"))
    return Table(
        "What these sensors can tell apart",
        ("ports that cannot be told apart", "hardest to tell from"),
        tuple(rows),
        _isolability_note(found, located),
    )


def _isolability_note(found: Isolability, located: Sequence[str]) -> str:
    text = (
        "From the equations alone, with the recorded outputs; the angle is that between the"
        " directions in which signals there move the measurements, 90° at most. Within a group only"
        " the form of the signal tells, not its place."
    )
    own = [group for group in found.groups if len(group) > 1 and set(group) & set(located)]
    if not own:
        return text
    left: dict[str, int] = {}
    for sensor in found.sensors_that_split(own[0]):
        with_it = [part for part in sensor.splits[0] if set(part) & set(located)]
        left[plain(sensor.text)] = sum(map(len, with_it))
    # The fewer ports remain with the located one, the better.
    apart = sorted((name for name in left if left[name] < len(own[0])), key=left.__getitem__)
    if not apart:
        return text
    few = ", ".join(apart[:_SENSORS])
    return f"{text} The group that was located would be split by measuring {few}."


def likenesses_table(term: NonparametricTerm) -> Table:
    """Build the table of shapes that stood in the place of the curve."""
    return Table.of(
        "Shapes of the library in the place of the curve",
        term.likenesses,
        {
            "shape of": lambda k: plain(k.law) if k.law else "the curve itself",
            "gain when refitted": lambda k: number(k.gain, 5),
            "less its penalty": lambda k: number(k.penalised, 5),
        },
        "Gains in units of log likelihood; every parameter has its penalty. law.py holds the first"
        " of them as a law of your own, ready for --effects.",
    )


def arguments_table(term: NonparametricTerm) -> Table:
    """Build the table of the arguments of a term."""

    def name(a: Argument) -> str:
        unit = hull(term, a)[1]
        return plain(a.name) + (f" in {unit}" if unit != "1" else "")

    def described(a: Argument) -> str:
        terms = ", ".join(str(t) for t in a.terms)
        return terms.replace("^2", "²").replace("^3", "³") or "–"

    return Table.of(
        "Arguments of the term without a name",
        term.arguments,
        {
            "argument": name,
            "p-value": lambda a: number(a.p_value),
            "share": lambda a: f"{100 * a.share:.0f} %",
            "data hull": lambda a: interval(*hull(term, a)[0]),
            "described by": described,
        },
        "p-value: chance of as strong a dependence on a signal shifted in time. Share: of the"
        " missing signal, predicted across blocks of time beyond the arguments above it. Described"
        " by: simple terms in x, the argument in SI units, with how often they are chosen when the"
        " curve scatters as its uncertainty says; they describe, they do not name a cause.",
    )


def hull(term: NonparametricTerm, argument: Argument) -> tuple[tuple[float, float], str]:
    """Return the range of an argument as people read it, and its unit.

    An end beside which the range is large is 0.
    """
    ends, unit = readably(np.array(argument.hull), argument.unit, term.read_in(argument.name))
    low, high = np.where(np.abs(ends) < 1e-3 * np.ptp(ends), 0.0, ends).tolist()
    return (low, high), unit
