"""The page of a diagnosis: what is missing, and the proof."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from workbench.computing.counted import in_words
from workbench.diagnosis.comparison import Proof
from workbench.diagnosis.location.isolability import Isolability
from workbench.diagnosis.location.missing_signal import MissingSignal
from workbench.diagnosis.nonparametric.result import NonparametricTerm
from workbench.diagnosis.stages import Diagnosis
from workbench.diagnosis.verdict import Verdict
from workbench.reports import diagnosis_tables as tables
from workbench.reports.diagnosis_answers import KINDS, accepted_term, diagnosis_answers, worst_run
from workbench.reports.figure import figures_of
from workbench.reports.figure import sections as own_sections
from workbench.reports.figures import diagnosis as figures
from workbench.reports.page import Block, Commands, Method, Page, Section, Words, methods
from workbench.reports.pictures import Picture
from workbench.reports.tables import plain


def diagnosis_page(
    diagnosis: Diagnosis, proof: Proof, *, name: str, commands: Sequence[str] = ()
) -> Page:
    """Build the page of a diagnosis."""
    verdict = diagnosis.verdict
    sections = []
    if diagnosis.runs:
        sections += [
            _held_out(diagnosis, proof, verdict),
            _where(diagnosis, proof, verdict),
            _numbers(diagnosis, verdict),
            _alternatives(diagnosis, verdict),
            _limits(diagnosis, verdict),
        ]
    if verdict.kind == "parameter":
        # The wrong value is the finding, so it comes before everything else.
        sections.sort(key=lambda section: section.name != "parameters")
    sections += own_sections(figures_of("diagnosis"), diagnosis)
    sections.append(_recordings(verdict, commands))
    return Page(
        f"Diagnosis of {name}",
        "" if diagnosis.runs else f"{plain(verdict.sentence).rstrip('.')}.",
        tuple(section for section in sections if section.blocks),
        facts=_facts(diagnosis, verdict),
        first=_first(diagnosis, proof, verdict) if diagnosis.runs else (),
    )


def _first(diagnosis: Diagnosis, proof: Proof, verdict: Verdict) -> tuple[Block, ...]:
    """Return the answers and the picture that carries them."""
    answers = diagnosis_answers(diagnosis, proof, verdict)
    runs = {n: run for n, run in diagnosis.runs["refitted"].items() if run.finite}
    if not runs:
        return (answers,)
    title, before = worst_run(runs)
    located = max(proof.located, key=_agreed, default=None)
    noise = verdict.fit.get("noise_floor", {})
    held_out = figures.held_out_runs(diagnosis, title)
    drawn = figures.diagnosis_answer(diagnosis.nominal, held_out, noise, located)
    caption = f"{_plain_title(title)}, held out: {plain(before.used[0])}, and its error"
    caption += " (green: no larger than the sensor's noise)"
    caption += f"; the signal that is missing at {located.port}." if located else "."
    return (answers, Picture("answer", drawn, caption, "measured and simulated, before and after"))


def _agreed(located: MissingSignal) -> float:
    """Return how much of what is missing at a port was found, dimensionless; -inf if nothing."""
    return located.explained if math.isfinite(located.explained) else -math.inf


def _plain_title(title: str) -> str:
    return plain(title.split("/")[-1])


def _facts(diagnosis: Diagnosis, verdict: Verdict) -> tuple[tuple[str, str], ...]:
    return (
        ("verdict", KINDS[verdict.kind]),
        ("model", diagnosis.nominal.name),
        *([("computed in", f"{verdict.seconds:.0f} s")] if math.isfinite(verdict.seconds) else []),
        *([("work", in_words(verdict.work))] if verdict.work else []),
    )


def _held_out(diagnosis: Diagnosis, proof: Proof, verdict: Verdict) -> Section:
    extended = diagnosis.runs.get("extended", {}) if diagnosis.improved else {}
    anew = next((run.restarts for run in diagnosis.runs["refitted"].values() if run.restarts), "")
    how = anew or "it gets the input and the first measurements, never a later one"
    blocks: list[Block] = [
        Words(
            f"Neither model has seen these recordings. Each runs freely: {how}. Both have their"
            " parameters fitted to the same other recordings, so the difference is the physics and"
            " not the tuning."
            if extended
            else f"The model has not seen these recordings. It runs freely: {how}."
        )
    ]
    noise = verdict.fit.get("noise_floor", {})
    for i, title in enumerate(diagnosis.runs["refitted"]):
        runs, name = figures.held_out_runs(diagnosis, title), _plain_title(title)
        files = f"runs-{i + 1}", f"residuals-{i + 1}"
        blocks += figures.run_pictures(diagnosis.nominal, runs, noise, name, files)
    blocks.append(tables.errors_table(proof.errors, bool(extended)))
    return Section("held-out", "On recordings that were held out", tuple(blocks))


def _where(diagnosis: Diagnosis, proof: Proof, verdict: Verdict) -> Section:
    blocks: list[Block] = []
    before = verdict.location.get("before", {})
    after = verdict.location.get("after", {}) if diagnosis.improved else {}
    term = accepted_term(diagnosis)
    if before and max(*before.values(), *after.values(), 0.0) < 1.0:
        blocks.append(
            Words(
                "An unknown signal at a single group of equations would not make the recordings"
                " likelier than small disturbances at all of them do."
            )
        )
    elif before:
        blocks.append(
            Picture(
                "location",
                figures.diagnosis_location(before, after or None),
                "How much likelier the recordings become when an unknown signal may act on one"
                " group of equations. Long bars: the equations there leave something out."
                + (" After the extension nothing may be left." if after else ""),
                "gain of an unknown input by group of ports",
            )
        )
    if diagnosis.accepted and any(c.entry.group == "sensor" for c, _ in diagnosis.accepted):
        blocks.append(
            Words(
                "Sensors have no bar of their own: what a sensor does wrong looks like an unknown"
                " signal at the equations that its measurements correct. Only the refits below tell"
                " them apart.",
                "note",
            )
        )
    if term is not None:
        blocks += _nonparametric_blocks(term)
    if proof.located:
        what, law = ("term", "curve that") if term else ("effect", "effect, whose law")
        blocks.append(
            Words(
                f"Below, the {what} is taken out of the extended model again, and the held-out"
                " recordings tell what signal is then missing at its place; no law is assumed for"
                f" that. Beside it stands the {law} was fitted to the other recordings."
                if term is not None or diagnosis.accepted
                else "Below is what the refitted nominal model lacks at that place: a signal"
                " estimated from all recordings, without assuming any law."
            )
        )
    for i, located in enumerate(proof.located):
        blocks += [
            Picture(
                f"law-{i + 1}",
                figures.diagnosis_law(located),
                _law_caption(located) + (_outside_sentence(term, located) if term else ""),
                f"located signal at {located.port} against {located.argument.name}",
            ),
            Picture(
                f"signal-{i + 1}",
                figures.diagnosis_signal(located),
                f"The same signal at {located.port} over time, with twice its standard deviation"
                " in grey: where the grey is wide, the measurements do not tell.",
                f"located signal at {located.port} over time",
            ),
        ]
    if proof.note and not proof.located and proof.ports:
        blocks.append(Words(f"The located signal cannot be shown: {proof.note}.", "note"))
    if proof.isolability is not None:
        if verdict.kind in ("located_unnamed", "unexplained") and proof.ports:
            blocks.append(Words(_group_sentence(proof.isolability, proof.ports)))
        blocks.append(tables.isolability_table(proof.isolability, proof.ports))
    title = "Where it acts and what it looks like" if diagnosis.accepted else "Is anything left?"
    if verdict.kind in ("located_unnamed", "unexplained"):
        title = "Where something is missing"
    return Section("where", title, tuple(blocks))


def _nonparametric_blocks(term: NonparametricTerm) -> list[Block]:
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
                figures.diagnosis_nonparametric(
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
    blocks.append(tables.arguments_table(term))
    if term.likenesses:
        blocks.append(tables.likenesses_table(term))
    return blocks


def _outside_sentence(term: NonparametricTerm, located: MissingSignal) -> str:
    """Say, after a blank, how much of the recordings lies where the curve is only continued.

    It is empty if all of them lie inside, or another quantity was drawn.
    """
    own = next((a for a in term.arguments if located.argument.name.startswith(a.name)), None)
    if own is None:
        return ""
    x = located.argument.values
    share = 100.0 * np.mean((x < own.hull[0]) | (x > own.hull[1]))
    outside = "of these samples lie outside the data hull, where the curve is only continued."
    return f" {share:.0f} % {outside}" if share >= 1.0 else ""


def _group_sentence(told: Isolability, ports: tuple[str, ...]) -> str:
    """Say with which other ports the located ones could be confused."""
    alike = [p for group in told.groups if set(group) & set(ports) for p in group]
    others = ", ".join(p for p in alike if p not in ports) or "no other place"
    here = ", ".join(ports)
    return f"With these sensors, a signal at {plain(here)} looks like one at {plain(others)}."


def _law_caption(located: MissingSignal) -> str:
    what = (
        f"The signal at {located.port} against {located.argument.name.replace('_', ' ')}, at times"
        " at which the measurements tell it to half its size or better"
    )
    law = f"; and {located.law_name}" if located.law is not None else ""
    if law and located.explained > 0:
        law += f", which takes away {100 * located.explained:.0f} % of the signal's mean square"
    return f"{what}{law}."


def _numbers(diagnosis: Diagnosis, verdict: Verdict) -> Section:
    blocks: list[Block] = []
    if diagnosis.nominal.traits.held:
        held = ", ".join(plain(name.replace("_", " ")) for name, _ in diagnosis.nominal.traits.held)
        blocks.append(
            Words(
                f"The plant holds {held}. Refitted, it explains more than any effect beside the"
                " value that was held.",
                "note",
            )
        )
    elif verdict.kind == "parameter":
        blocks.append(
            Words(
                "The refit wants a value beyond what is plausible. The model follows the recordings"
                " with it, so its equations are complete; the value on the bound, or one that goes"
                " with it in the notes of the experiment, is wrong.",
                "note",
            )
        )
    blocks.append(tables.parameters_table(diagnosis))
    title = "The value that is wrong" if verdict.kind == "parameter" else "Parameters"
    return Section("parameters", title, tuple(blocks), folded=verdict.kind != "parameter")


def _alternatives(diagnosis: Diagnosis, verdict: Verdict) -> Section:
    blocks: list[Block] = []
    gone = taken_back(diagnosis)
    for i, (scores, candidates) in enumerate(diagnosis.rounds):
        title = _round_title(i, len(diagnosis.accepted))
        blocks.append(tables.scores_table(title, diagnosis.nominal, scores, candidates, gone))
    if blocks:
        count = len(diagnosis.rounds[0][0].scores)
        tried = "effect of the library was" if count == 1 else "effects of the library were"
        blocks[:0] = [
            Words(
                f"{count} {tried} tried on an equal footing; to be accepted, one has to pay for"
                " the size of the library, and to improve the held-out recordings beyond chance."
            ),
            *refusals(diagnosis),
            *([tables.weights_table(verdict)] if verdict.weights else ()),
        ]
    named = bool(diagnosis.accepted) or not diagnosis.rounds
    title = "Alternatives" if named else "What was tried, and why it was refused"
    return Section("alternatives", title, tuple(blocks), folded=True)


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
        said = f"A law without a name at {', '.join(term.ports)} was tried and refused"
        blocks.append(Words(plain(f"{said}: {term.reason}."), "note"))
    return blocks


def _round_title(number: int, found: int) -> str:
    if number < found:
        return "What else it could be" if number == 0 else "What else the next could be"
    if found:
        return "What is left after that"
    return "What the library would explain" + (", with that of before" if number else "")


def _limits(diagnosis: Diagnosis, verdict: Verdict) -> Section:
    blocks: list[Block] = []
    if verdict.not_testable:
        blocks.append(tables.unseen_table(verdict))
    elif diagnosis.rounds:
        blocks.append(Words("Every effect of the library would have shown at a plausible size."))
    return Section("limits", "What could not be seen", tuple(blocks), folded=True)


def _recordings(verdict: Verdict, commands: Sequence[str]) -> Section:
    blocks: list[Block] = []
    remarks = [row for row in verdict.data if row.get("result") != "pass"]
    blocks += [Words(text, "note") for text in tables.unfit_sentences(verdict)]
    if remarks:
        blocks.append(tables.checks_table(verdict))
    elif verdict.data:
        blocks.append(Words(f"All {len(verdict.data)} checks of the recordings passed."))
    unfit = verdict.kind == "data_unfit"
    if not unfit:
        blocks.append(Method(methods("diagnosis")))
    if commands:
        blocks.append(Commands(tuple(commands)))
    title = "Which check failed" if unfit else "Recordings and methods"
    return Section("recordings", title, tuple(blocks), folded=not unfit)
