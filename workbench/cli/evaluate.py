"""The verb ``evaluate``: how good is the diagnosis."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import KW_ONLY, dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from workbench.cli.options import Positive, VerbCommand, parameters_of, read_as, taking
from workbench.cli.options import summary as about
from workbench.cli.running import tell
from workbench.errors import WorkbenchError
from workbench.files import json_text, write_whole

if TYPE_CHECKING:
    from workbench.evaluation.kept_answers import Answer, Case

evaluate = typer.Typer(no_args_is_help=True)


@dataclass(frozen=True)
class Campaign:
    """Which cases of a plan are answered, by how many processes, and where answers are kept.

    Args:
        out (OUT): Folder of the answers.
        part: K/N: every Nth case from the Kth on.
        only: Name of a case, such as own-2003, or of a machine; several times.
        jobs: Cases that are diagnosed side by side.
        dask (ADDRESS): Let a Dask cluster diagnose: address of its scheduler, such as
            tcp://host:8786.
    """

    out: Path
    _: KW_ONLY
    part: str = "1/1"
    only: list[str] | None = None
    jobs: Positive = 1
    dask: str | None = None

    def run(
        self, cases: Sequence[Case], answer: Answer, line_of: Callable[[Mapping[str, Any]], str]
    ) -> None:
        """Answer the cases and print a line for each."""
        from workbench.evaluation.kept_answers import answered, chosen_cases

        chosen = chosen_cases(cases, part_of(self.part), self.only or ())
        for row in answered(chosen, self.out, answer, jobs=self.jobs, dask=self.dask):
            typer.echo(line_of(row))


with_campaign = taking("campaign", Campaign)


def blind(
    verdicts: Path,
    *,
    key: Path,
    commitments: Path | None = None,
    names: Path | None = None,
    out: Path | None = None,
) -> None:
    """Score the verdicts of a blind round against the answers.

    Prints points per case, rates, and the p-value against random answers. Example:
    'workbench evaluate blind verdicts --key key.json --commitments commitments.txt'.

    Args:
        verdicts (VERDICTS): Folder with CASE/verdict.json or CASE.json for each case.
        key: JSON file with the answers.
        commitments: Text file with the SHA-256 of each answer, to check them.
        names: TOML file on how further words of the key are to be read.
        out: JSON file for the score.
    """
    from workbench.evaluation.blind_round import score_verdicts

    found = score_verdicts(verdicts, key, commitments=commitments, names=names)
    typer.echo(str(found))
    if out is not None:
        tell(found.as_data(), as_json=False, file=out)


@with_campaign
def own_cases(
    campaign: Campaign,
    *,
    count: Annotated[int | None, typer.Option(min=1)] = None,
    seeds: int | None = None,
    baselines: bool = True,
) -> None:
    """Make cases of the arm on a second simulator, diagnose them and keep the answers.

    Finished cases are kept in OUT, one JSON file each: an interrupted run goes on where it stopped,
    and several processes, or a cluster, share the work. 'workbench evaluate report OUT' makes the
    tables.

    Args:
        count: First cases of the plan; all by default.
        seeds: Seed of the first case.
        baselines: Whether the baselines answer too.
    """
    from workbench.evaluation.own_cases import own_case

    answer = partial(own_case.answer, baselines=baselines)
    campaign.run(own_case.cases(count, seeds, campaign.only or ()), answer, own_case.line_of)


@with_campaign
def experiments(campaign: Campaign, *, count: Positive = 10, seeds: int | None = None) -> None:
    """Play what a diagnosis proposes on the machine of poorly recorded cases, and judge again.

    Cases of the arm on a second simulator, recorded in closed loop only, are diagnosed until COUNT
    of them ended as classes of look-alikes; each of these gets one more experiment of 20 s. The
    last lines say how many became names. Finished cases are kept in OUT as with own-cases.

    Args:
        count: Cases that are to end as classes.
        seeds: Seed of the first case.
    """
    from workbench.evaluation.own_cases.experiments import run_experiments

    part = part_of(campaign.part)
    shared: dict[str, Any] = {"jobs": campaign.jobs, "dask": campaign.dask}
    for line in run_experiments(campaign.out, count, seeds, part, campaign.only or (), **shared):
        typer.echo(line)


@with_campaign
def foreign(campaign: Campaign, *, count: Positive = 60, seeds: int | None = None) -> None:
    """Diagnose machines that the workbench does not know, on first models of a newcomer.

    A drive, a circuit, a tank and a crane of a second simulator, with one effect, two or nothing
    concealed. Finished cases are kept in OUT as with own-cases.

    Args:
        count: Cases of the plan.
        seeds: Seed of the first case.
    """
    from workbench.evaluation.foreign.foreign_case import answer, line_of, plan

    campaign.run(plan(count, seeds), answer, line_of)


@with_campaign
def machines(campaign: Campaign, *, data: Path | None = None) -> None:
    """Diagnose recordings of real machines, each from the first model that comes to mind.

    A line per machine: what was named, the error on held-out recordings before and after, and what
    it lacks against what is published.

    Args:
        data: Folder with the recordings; WORKBENCH_DATA, or fetched, without it.
    """
    from workbench.evaluation.machines import real_machine

    every = [real_machine.Machine(name, data) for name in real_machine.table()]
    campaign.run(every, real_machine.answer, real_machine.line_of)


@with_campaign
def left_out(campaign: Campaign) -> None:
    """Leave out one piece of the arm's physics after the other and look for it.

    A line per piece; finished ones are kept in OUT as with own-cases.
    """
    from workbench.evaluation.left_out import PLAN, answer, line_of

    campaign.run(PLAN, answer, line_of)


def cases(out: Path, *, count: Positive = 20, seeds: int | None = None) -> None:
    """Write cases of the arm as folders that any method can read, with the answers beside them.

    Each folder has case.toml and its recordings; OUT/key.json says what they hide.

    Args:
        out (OUT): Folder of the benchmark.
        count: Cases of the plan.
        seeds: Seed of the first case.
    """
    from workbench.evaluation.benchmark.cases import write_cases

    for line in write_cases(out, count, seeds):
        typer.echo(line)


def baselines(cases: Path, out: Path, *, only: list[str] | None = None) -> None:
    """Let simple methods answer cases: OUT receives one folder of verdicts per method.

    Refit only, greedy selection, SINDy on the residual, a Kalman filter with states that walk at
    random, and a neural network in the equations.

    Args:
        cases (CASES): Folder of case folders.
        out (OUT): Folder of the answers.
        only: Name of a method, such as greedy; several times.
    """
    from workbench.evaluation.benchmark.baselines import run_baselines

    for line in run_baselines(cases, out, only or ()):
        typer.echo(line)


def benchmark(cases: Path, verdicts: list[Path], *, out: Path | None = None) -> None:
    """Score the verdicts of one method or several on the same cases, a line per method.

    Example: 'workbench evaluate benchmark cases my_method answers/greedy answers/sindy'.

    Args:
        cases: Folder with key.json, and names.toml if it needs one.
        verdicts (VERDICTS...): Folder with CASE.json or CASE/verdict.json for each case; one per
            method.
        out: JSON file for the scores.
    """
    from workbench.evaluation.benchmark.cases import compared, table

    scores = compared(cases, verdicts)
    typer.echo(table(scores))
    if out is not None:
        tell({"methods": [score.as_data() for score in scores]}, as_json=False, file=out)


def report(
    out: Path, *, figure: Path | None = None, summary: Path | None = None, cases: bool = False
) -> None:
    """Tabulate the answers that 'own-cases' or 'foreign' kept.

    Args:
        out (OUT): Folder of the answers.
        figure: PNG file to draw, of own cases.
        summary: JSON file of the numbers.
        cases (--cases/--no-cases): One line per case too.
    """
    from workbench.evaluation.foreign import foreign_case
    from workbench.evaluation.kept_answers import read_kept
    from workbench.evaluation.own_cases import report as own

    rows = read_kept(out)
    is_foreign = rows[0].get("schema") == foreign_case.SCHEMA
    of = foreign_case if is_foreign else own
    if summary:
        write_whole(summary, json_text(of.summary(rows)))
    if figure:
        if is_foreign:
            raise WorkbenchError("foreign cases have no figure; leave --figure away")
        own.figure(rows, figure)
    if cases:
        lines = map(foreign_case.line_of, rows) if is_foreign else [own.cases(rows)]
        typer.echo("\n".join(lines) + "\n")
    typer.echo(of.tables(rows))


def part_of(text: str) -> tuple[int, int]:
    """Read ``K/N``: part K of N, counted from 1."""
    try:
        k, n = (int(word) for word in text.split("/"))
    except ValueError:
        k, n = 0, 0
    if not 1 <= k <= n:
        raise WorkbenchError(f"part {text!r} must be K/N with K from 1 to N, such as 1/2")
    return k, n


for _verb in (
    blind,
    own_cases,
    experiments,
    foreign,
    machines,
    left_out,
    cases,
    baselines,
    benchmark,
    report,
):
    evaluate.command(help=about(_verb), cls=VerbCommand)(read_as(_verb, parameters_of(_verb)))
