"""What the page of a diagnosis says where something is missing that has no name."""

from __future__ import annotations

import numpy as np

from workbench.diagnosis.location.isolability import Isolability
from workbench.diagnosis.location.missing_signal import MissingSignal
from workbench.diagnosis.nonparametric.result import Argument, NonparametricTerm
from workbench.diagnosis.stages import Diagnosis
from workbench.model.units import readably
from workbench.reports.figures.diagnosis import diagnosis_nonparametric
from workbench.reports.page import Block, Words
from workbench.reports.pictures import Picture
from workbench.reports.tables import Cell, Table, interval, number, plain


def accepted_term(diagnosis: Diagnosis) -> NonparametricTerm | None:
    """Return the term without a name that stands in the improved model; None if there is none."""
    term = diagnosis.nonparametric
    return term if term is not None and term.accepted and not diagnosis.accepted else None


def hull_sentence(term: NonparametricTerm) -> str:
    """Say where a fitted curve holds."""
    ranges = []
    for a in term.arguments:
        (low, high), unit = _hull(term, a)
        ends = f"{number(low)} to {number(high)} {unit}".removesuffix(" 1")
        ranges.append(f"{plain(a.name)} from {ends}")
    curves = "curve is" if len(ranges) == 1 else "curves are"
    return f"The {curves} empirical: valid inside its data hull, {' and '.join(ranges)}.".replace(
        "are empirical: valid inside its", "are empirical: valid inside their"
    )


def _hull(term: NonparametricTerm, argument: Argument) -> tuple[tuple[float, float], str]:
    """Return the range of an argument as people read it; an end beside which it is large is 0."""
    ends, unit = readably(np.array(argument.hull), argument.unit, term.read_in(argument.name))
    low, high = np.where(np.abs(ends) < 1e-3 * np.ptp(ends), 0.0, ends).tolist()
    return (low, high), unit


def outside_sentence(term: NonparametricTerm, located: MissingSignal) -> str:
    """Say, after a blank, how much of the recordings lies where the curve is only continued.

    It is empty if all of them lie inside, or another quantity was drawn.
    """
    own = [a for a in term.arguments if located.argument.startswith(a.name)]
    if not own:
        return ""
    low, high = own[0].hull
    x = located.argument_values
    share = float(np.mean((x < low) | (x > high)))
    if share < 0.01:
        return ""
    return (
        f" {100 * share:.0f} % of these samples lie outside the data hull, where the curve is only"
        " continued."
    )


def nonparametric_blocks(term: NonparametricTerm) -> list[Block]:
    """Show the curves of a term on what was measured, and the evidence for their arguments."""
    place = plain(", ".join(term.ports))
    over = " and ".join(plain(a.name) for a in term.arguments)
    form = (
        f"The term changes {place} by a fraction that is a curve over {over}"
        if term.relative
        else f"The term adds to {place} a curve over {over}"
    )
    loop = ", with a loop that remembers the direction of the motion" if term.loop else ""
    rest = " each less what the other takes," if len(term.arguments) > 1 else ""
    blocks: list[Block] = [
        Words(
            f"{form}{loop}. Below is what the fitting recordings say,{rest} in classes of the"
            " argument, and the curve that was fitted to it in the equations of motion."
        )
    ]
    for i, argument in enumerate(term.arguments):
        if argument.bins is None:
            continue
        blocks.append(
            Picture(
                f"nonparametric-{i + 1}",
                diagnosis_nonparametric(
                    argument,
                    place=", ".join(term.ports),
                    unit=term.unit,
                    shown=term.read_in(),
                    argument_shown=term.read_in(argument.name),
                ),
                f"What is missing at {place} over {plain(argument.name)}: means of classes with"
                " the scatter within each in grey, and the fitted curve.",
                f"missing signal at {place} over {plain(argument.name)} with the fitted curve",
            )
        )
    blocks.append(arguments_table(term))
    if term.likenesses:
        blocks.append(likenesses_table(term))
    return blocks


def likenesses_table(term: NonparametricTerm) -> Table:
    """Build the table of shapes that stood in the place of the curve."""
    rows = tuple(
        (plain(k.law) if k.law else "the curve itself", number(k.gain, 5), number(k.penalised, 5))
        for k in term.likenesses
    )
    return Table(
        "Shapes of the library in the place of the curve",
        ("shape of", "gain when refitted", "less its penalty"),
        rows,
        "Gains in units of log likelihood; every parameter has its penalty. law.py holds the first"
        " of them as a law of your own, ready for --effects.",
    )


def arguments_table(term: NonparametricTerm) -> Table:
    """Build the table of the arguments of a term."""
    rows: list[tuple[Cell | str, ...]] = []
    for a in term.arguments:
        (low, high), unit = _hull(term, a)
        like = ", ".join(str(t) for t in a.terms).replace("^2", "²").replace("^3", "³")
        rows.append(
            (
                plain(a.name) + (f" in {unit}" if unit != "1" else ""),
                number(a.p_value),
                f"{100 * a.share:.0f} %",
                interval(low, high),
                like or "–",
            )
        )
    return Table(
        "Arguments of the term without a name",
        ("argument", "p-value", "share", "data hull", "described by"),
        tuple(rows),
        "p-value: chance of as strong a dependence on a signal shifted in time. Share: of the"
        " missing signal, predicted across blocks of time beyond the arguments above it. Described"
        " by: simple terms in x, the argument in SI units, with how often they are chosen when the"
        " curve scatters as its uncertainty says; they describe, they do not name a cause.",
    )


def taken_back(diagnosis: Diagnosis) -> dict[str, str]:
    """Say why effects that had been accepted were taken back."""
    kept = {candidate.entry.name for candidate, _ in diagnosis.accepted}
    return {c.entry.name: why for c, why in diagnosis.withdrawn if c.entry.name not in kept}


def refusals(diagnosis: Diagnosis) -> list[Block]:
    """Say what was found and taken back, and why a term without a name was refused."""
    blocks: list[Block] = [
        Words(f"Taken back: {plain(name)}; {reason}.", "note")
        for name, reason in taken_back(diagnosis).items()
    ]
    term = diagnosis.nonparametric
    if term is not None and term.reason:
        reason = plain(term.reason)
        blocks.append(
            Words(
                f"A law without a name at {plain(', '.join(term.ports))} was tried and refused:"
                f" {reason}.",
                "note",
            )
        )
    return blocks


def group_sentence(told: Isolability | None, ports: tuple[str, ...]) -> str:
    """Say with which other ports the located ones could be confused.

    Args:
        told: What the recorded outputs can tell apart; None if that is not known.
    """
    if told is None or not ports:
        return ""
    alike = [p for group in told.groups if set(group) & set(ports) for p in group]
    others = ", ".join(p for p in alike if p not in ports)
    here = ", ".join(ports)
    if not others:
        return f"With these sensors, a signal at {plain(here)} looks like one at no other place."
    return f"With these sensors, a signal at {plain(here)} looks like one at {plain(others)}."
