"""The verb ``evaluate``: how good is the diagnosis."""

from __future__ import annotations

import inspect
import os
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from workbench.cli.as_json import tell
from workbench.cli.plant import options_of
from workbench.errors import WorkbenchError

if TYPE_CHECKING:
    from workbench.evaluation.kept import Answer, Case

evaluate = typer.Typer(no_args_is_help=True)

Answers = Annotated[Path, typer.Argument(help="Folder of the answers.", metavar="OUT")]
Seeds = Annotated[int | None, typer.Option(help="Seed of the first case.")]
Part = Annotated[str, typer.Option(help="K/N: every Nth case from the Kth on.")]
Only = Annotated[
    list[str] | None,
    typer.Option(help="Name of a case, such as own-2003, or of a machine; several times."),
]
Jobs = Annotated[int, typer.Option(help="Processes of one diagnosis.", min=1)]
Side = Annotated[int, typer.Option(help="Cases that are diagnosed side by side.", min=1)]
Cluster = Annotated[
    str | None,
    typer.Option(
        help="Let a Dask cluster diagnose: address of its scheduler, such as tcp://host:8786.",
        metavar="ADDRESS",
    ),
]


@dataclass(frozen=True)
class Campaign:
    """Which cases of a plan are answered, by how many processes, and where answers are kept."""

    out: Path
    part: str
    only: list[str] | None
    jobs: int
    dask: str | None

    def run(
        self,
        cases: Sequence[Case],
        answer: Answer,
        line_of: Callable[[Mapping[str, Any]], str],
    ) -> int:
        """Answer the cases and print a line for each."""
        from workbench.evaluation.kept import run_cases

        _one_thread()
        part, only = part_of(self.part), self.only or ()
        kept = self.out, answer, line_of
        for line in run_cases(cases, *kept, part=part, only=only, jobs=self.jobs, dask=self.dask):
            typer.echo(line)
        return 0


_CAMPAIGN: dict[str, tuple[Any, Any]] = {
    "out": (Answers, inspect.Parameter.empty),
    "part": (Part, "1/1"),
    "only": (Only, None),
    "jobs": (Side, 1),
    "dask": (Cluster, None),
}
with_campaign = options_of("campaign", _CAMPAIGN, Campaign)


def blind(
    verdicts: Annotated[
        Path,
        typer.Argument(
            help="Folder with CASE/verdict.json or CASE.json for each case.", metavar="VERDICTS"
        ),
    ],
    key: Annotated[Path, typer.Option(help="JSON file with the answers.")],
    commitments: Annotated[
        Path | None,
        typer.Option(help="Text file with the SHA-256 of each answer, to check them."),
    ] = None,
    names: Annotated[
        Path | None,
        typer.Option(help="TOML file on how further words of the key are to be read."),
    ] = None,
    out: Annotated[Path | None, typer.Option(help="JSON file for the score.")] = None,
) -> int:
    """Score the verdicts of a blind round against the answers.

    Prints points per case, rates, and the p-value against random answers. Example:
    'workbench evaluate blind verdicts --key key.json --commitments commitments.txt'.
    """
    from workbench.evaluation.blind_round import score_verdicts

    found = score_verdicts(verdicts, key, commitments=commitments, names=names)
    typer.echo(str(found))
    if out is not None:
        tell(found.as_data(), as_json=False, file=out)
    return 0


@with_campaign
def own_cases(
    campaign: Campaign,
    count: Annotated[
        int | None, typer.Option(help="First cases of the plan; all by default.", min=1)
    ] = None,
    seeds: Seeds = None,
    baselines: Annotated[bool, typer.Option(help="Whether the baselines answer too.")] = True,
) -> int:
    """Make cases of the arm on a second simulator, diagnose them and keep the answers.

    Finished cases are kept in OUT, one JSON file each: an interrupted run goes on where it stopped,
    and several processes, or a cluster, share the work. 'workbench evaluate report OUT' makes the
    tables.
    """
    from workbench.evaluation.own_cases import run

    answer = run.answer if baselines else run.answer_alone
    return campaign.run(run.cases(count, seeds, campaign.only or ()), answer, run.line_of)


def experiments(
    out: Answers,
    count: Annotated[int, typer.Option(help="Cases that are to end as classes.", min=1)] = 10,
    seeds: Seeds = None,
    part: Part = "1/1",
    only: Only = None,
    jobs: Jobs = 1,
) -> int:
    """Play what a diagnosis proposes on the machine of poorly recorded cases, and judge again.

    Cases of the arm on a second simulator, recorded in closed loop only, are diagnosed until COUNT
    of them ended as classes of look-alikes; each of these gets one more experiment of 20 s. The
    last lines say how many became names. Finished cases are kept in OUT as with own-cases.
    """
    _one_thread()
    from workbench.evaluation.own_cases.experiments import run_experiments

    share = part_of(part)
    for line in run_experiments(out, count, seeds, part=share, only=only or (), jobs=jobs):
        typer.echo(line)
    return 0


@with_campaign
def foreign(
    campaign: Campaign,
    count: Annotated[int, typer.Option(help="Cases of the plan.", min=1)] = 60,
    seeds: Seeds = None,
) -> int:
    """Diagnose machines that the workbench does not know, on first models of a newcomer.

    A drive, a circuit, a tank and a crane of a second simulator, with one effect, two or nothing
    concealed. Finished cases are kept in OUT as with own-cases.
    """
    from workbench.evaluation.foreign import plan, run

    first = plan.FIRST_SEED if seeds is None else seeds
    return campaign.run(plan.plan(count, first), run.answer, run.line_of)


@with_campaign
def machines(
    campaign: Campaign,
    data: Annotated[
        Path | None,
        typer.Option(help="Folder with the recordings; WORKBENCH_DATA, or fetched, without it."),
    ] = None,
) -> int:
    """Diagnose recordings of real machines, each from the first model that comes to mind.

    A line per machine: what was named, the error on held-out recordings before and after, and what
    it lacks against what is published.
    """
    from workbench.evaluation.machines import run

    return campaign.run([run.Machine(name, data) for name in run.table()], run.answer, run.line_of)


@with_campaign
def left_out(campaign: Campaign) -> int:
    """Leave out one piece of the arm's physics after the other and look for it.

    A line per piece; finished ones are kept in OUT as with own-cases.
    """
    from workbench.evaluation.left_out import plan, run

    return campaign.run(plan.PLAN, run.answer, run.line_of)


def cases(
    out: Annotated[Path, typer.Argument(help="Folder of the benchmark.", metavar="OUT")],
    count: Annotated[int, typer.Option(help="Cases of the plan.", min=1)] = 20,
    seeds: Seeds = None,
) -> int:
    """Write cases of the arm as folders that any method can read, with the answers beside them.

    Each folder has case.toml and its recordings; OUT/key.json says what they hide.
    """
    from workbench.evaluation.benchmark.cases import write_cases

    for line in write_cases(out, count, seeds):
        typer.echo(line)
    return 0


def baselines(
    cases: Annotated[Path, typer.Argument(help="Folder of case folders.", metavar="CASES")],
    out: Annotated[Path, typer.Argument(help="Folder of the answers.", metavar="OUT")],
    only: Annotated[
        list[str] | None, typer.Option(help="Name of a method, such as greedy; several times.")
    ] = None,
) -> int:
    """Let simple methods answer cases: OUT receives one folder of verdicts per method.

    Refit only, greedy selection, SINDy on the residual, a Kalman filter with states that walk at
    random, and a neural network in the equations.
    """
    _one_thread()
    from workbench.evaluation.benchmark.baselines import run_baselines

    for line in run_baselines(cases, out, only or ()):
        typer.echo(line)
    return 0


def benchmark(
    cases: Annotated[
        Path, typer.Argument(help="Folder with key.json, and names.toml if it needs one.")
    ],
    verdicts: Annotated[
        list[Path],
        typer.Argument(
            help="Folder with CASE.json or CASE/verdict.json for each case; one per method.",
            metavar="VERDICTS...",
        ),
    ],
    out: Annotated[Path | None, typer.Option(help="JSON file for the scores.")] = None,
) -> int:
    """Score the verdicts of one method or several on the same cases, a line per method.

    Example: 'workbench evaluate benchmark cases my_method answers/greedy answers/sindy'.
    """
    from workbench.evaluation.benchmark.compare import compared, table

    scores = compared(cases, verdicts)
    typer.echo(table(scores))
    if out is not None:
        tell({"methods": [score.as_data() for score in scores]}, as_json=False, file=out)
    return 0


def report(
    out: Answers,
    figure: Annotated[Path | None, typer.Option(help="PNG file to draw, of own cases.")] = None,
    summary: Annotated[Path | None, typer.Option(help="JSON file of the numbers.")] = None,
    cases: Annotated[bool, typer.Option(help="One line per case too.")] = False,
) -> int:
    """Tabulate the answers that 'own-cases' or 'foreign' kept."""
    from workbench.evaluation.report import report as tabulate

    typer.echo(tabulate(out, figure_file=figure, summary_file=summary, each=cases))
    return 0


def part_of(text: str) -> tuple[int, int]:
    """Read ``K/N``: part K of N, counted from 1."""
    try:
        k, n = (int(word) for word in text.split("/"))
    except ValueError:
        k, n = 0, 0
    if not 1 <= k <= n:
        raise WorkbenchError(f"part {text!r} must be K/N with K from 1 to N, such as 1/2")
    return k, n


def _one_thread() -> None:
    """Leave the cores to the processes: threads of linear algebra would only get in their way."""
    for name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
        os.environ.setdefault(name, "1")


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
    evaluate.command()(_verb)
