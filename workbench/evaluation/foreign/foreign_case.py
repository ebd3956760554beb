"""Cases of foreign machines: which are made, how they are diagnosed, and how answers are judged.

The machines take turns, a quarter of the cases hides nothing, some hide two effects.

Units: SI.
"""

from __future__ import annotations

import tomllib
from collections import defaultdict
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

from workbench.display import aligned_table
from workbench.evaluation.answer_key import Names, Truth
from workbench.evaluation.blind_round import (
    LARGEST_RATIO,
    Line,
    answer_of,
    names_of,
    over_limit,
    score_case,
)
from workbench.evaluation.foreign.machine import Array, Concealed, Machine, Parameters, State
from workbench.evaluation.foreign.newcomer import circuit, crane, drive, tank
from workbench.evaluation.foreign.truths import CIRCUIT, CRANE, DRIVE, TANK
from workbench.evaluation.kept_answers import diagnosed, version
from workbench.evaluation.rates import Rate, reliability_lines, told
from workbench.files import picked
from workbench.model import Model
from workbench.physics.library import library
from workbench.recordings import Recording, Signal

MACHINES: tuple[tuple[Machine, Callable[[], Model]], ...] = (
    (DRIVE, drive),
    (CIRCUIT, circuit),
    (TANK, tank),
    (CRANE, crane),
)
"""Each machine with a newcomer's model of it."""

FIRST_SEED = 7000
"""Seed of the first case unless another is given."""

_SILENT_EVERY, _PAIR_EVERY = 4, 5
_START_SAMPLES = 3


@dataclass(frozen=True)
class Case:
    """One case: a machine with what it hides, determined by its seed."""

    seed: int
    machine: Machine
    build: Callable[[], Model]
    hidden: tuple[Concealed, ...]

    @property
    def name(self) -> str:
        """Name of the case."""
        return f"foreign-{self.seed}"

    @property
    def title(self) -> str:
        """What it hides, in a few words."""
        return f"{self.machine.name}: {'+'.join(e.name for e in self.hidden) or 'nothing'}"

    def parameters(self) -> Parameters:
        """Return the true parameters."""
        return self.machine.parameters(np.random.default_rng(self.seed), self.hidden)

    def recordings(self) -> dict[str, Recording]:
        """Record the machine: two recordings to fit on, two to judge on."""
        rng, m, p = np.random.default_rng([self.seed, 1]), self.machine, self.parameters()
        made = {}
        for name, excitation in m.excitations.items():
            commands, measurements = m.record(excitation(rng, m.samples, m.sample_time), p, rng)
            columns = [
                Signal(n, commands[:, i], unit, role="command")
                for i, (n, unit) in enumerate(m.inputs)
            ]
            columns += [
                Signal(c.name, measurements[:, i], c.unit) for i, c in enumerate(m.channels)
            ]
            time = m.sample_time * np.arange(m.samples, dtype=np.float64)
            made[name] = Recording(name, time, tuple(columns))
        return made

    def limit(self, held_out: list[Recording]) -> dict[str, float]:
        """Return the errors that the truth itself would make, root mean square by output.

        It runs with its true parameters along the recorded commands, from rest but for the states
        that the first measurements tell.
        """
        m, p, squares = self.machine, self.parameters(), []
        for recording in held_out:
            commands = recording.matrix([n for n, _ in m.inputs])
            seen = recording.matrix([c.name for c in m.channels])
            start = self._read_start(commands, seen, p)
            _, exact = m.record(commands, p, None, replayed=True, start=start)
            squares.append(np.mean((exact - seen) ** 2, axis=0))
        errors = np.sqrt(np.mean(squares, axis=0))
        return {c.name: float(e) for c, e in zip(m.channels, errors, strict=True)}

    def _read_start(self, commands: Array, seen: Array, p: Parameters) -> State:
        m, n = self.machine, _START_SAMPLES
        _, exact = m.record(commands[:n], p, None, replayed=True)
        start = m.initial(p)
        for channel, off in zip(m.channels, (seen[:n] - exact).mean(axis=0), strict=True):
            start[channel.state] += float(off)
        return start

    def truths(self) -> tuple[Truth, ...]:
        """Return what it hides, as a blind round is scored by it."""
        offered, none, found = library(self.build()), Names({}, {}), []
        for effect in self.hidden:
            laws, ports = synonyms()[effect.physics], set(effect.ports)
            names = tuple(h.name for h in offered if set(h.ports) & ports and h.law in laws)
            groups = tuple(dict.fromkeys(none.group(port) for port in effect.ports))
            found.append(Truth(effect.name, names, groups, effect.physics.startswith("sensor_")))
        return tuple(found)


@cache
def synonyms() -> dict[str, tuple[str, ...]]:
    """Return the laws of the library that mean each physics of a concealed effect."""
    text = Path(__file__).with_name("synonyms.toml").read_text(encoding="utf-8")
    return {word: tuple(starts) for word, starts in tomllib.loads(text)["physics"].items()}


def plan(count: int, first_seed: int | None = None) -> tuple[Case, ...]:
    """Return the first cases of a plan; any beginning is a fair sample.

    The machines take turns. Every fourth case of a machine hides nothing; the others hide its
    effects in an order of their own, every fifth of them two at once.

    Args:
        first_seed: Seed of the first case; None for `FIRST_SEED`.
    """
    first, cases = FIRST_SEED if first_seed is None else first_seed, []
    orders = [
        np.random.default_rng([first, i]).permutation(len(machine.concealed)).tolist()
        for i, (machine, _) in enumerate(MACHINES)
    ]
    for k in range(count):
        i, turn = k % len(MACHINES), k // len(MACHINES)
        machine, build = MACHINES[i]
        hidden: tuple[Concealed, ...] = ()
        if (turn + i) % _SILENT_EVERY != _SILENT_EVERY - 1:
            done = sum((t + i) % _SILENT_EVERY != _SILENT_EVERY - 1 for t in range(turn))
            picked = [orders[i][done % len(orders[i])]]
            if done % _PAIR_EVERY == _PAIR_EVERY - 1:
                picked.append(orders[i][(done + 3) % len(orders[i])])
            hidden = tuple(machine.concealed[j] for j in picked)
        cases.append(Case(first + k, machine, build, hidden))
    return tuple(cases)


SCHEMA = "foreign_case/1"


def answer(case: Case, jobs: int) -> dict[str, Any]:
    """Diagnose one case; returns what is kept of it."""
    made = case.recordings()
    held_out = [r for name, r in made.items() if name.startswith("hold")]
    row: dict[str, Any] = {
        "schema": SCHEMA,
        **picked(case, "case=name title machine=machine.name"),
        "hidden": [vars(t) for t in case.truths()],
        "true": case.parameters(),
        "limit": case.limit(held_out),
        "version": version(),
    }
    fit_on = [r for name, r in made.items() if name.startswith("fit")]
    return diagnosed(row, case.build(), fit_on, held_out, jobs=jobs)


def judge(row: Mapping[str, Any]) -> Line:
    """Score a kept case by the rules of a blind round."""
    truths = [
        Truth(t["word"], tuple(t["library"]), tuple(t["groups"]), t["sensor"])
        for t in row["hidden"]
    ]
    return score_case(answer_of(row["verdict"], row["case"], Names({}, {})), truths)


def refused_right(row: Mapping[str, Any]) -> list[str]:
    """Return right names that gained on held-out recordings and are not in the verdict."""
    right = {name for truth in row["hidden"] for name in truth["library"]}
    said = {name for f in row["verdict"]["findings"] for name in (f["effect"], *f["class"])}
    return [] if right & said else [
        f"{r['effect']} ({r['reason']})"
        for r in row["verdict"].get("refused", ())
        if r["effect"] in right and (r["held_out_gain"][1] or 0.0) > 0.0
    ]  # fmt: skip


def line_of(row: Mapping[str, Any]) -> str:
    """Return one line about a kept case."""
    line, failure = judge(row), row["verdict"].get("failure", "")
    error = over_limit(row["verdict"], row["limit"])
    tail = "; ".join([*refused_right(row), *([failure] if failure else [])])
    outside = " (outside the library)" if any(not t["library"] for t in row["hidden"]) else ""
    return (
        f"{row['case']} {row['title']:<40} {line.said:<44} {line.points:>3} of {line.most:<3}"
        f" {line.remark}{outside}; {error:.3g} of the limit, {row['seconds']:.0f} s"
        + (f"; {tail}" if tail else "")
    )


def tables(rows: Sequence[Mapping[str, Any]]) -> str:
    """Return bars, machines and effects as text."""
    rates = rates_of(rows)
    machines = {
        name: rates_of([r for r in rows if r["machine"] == name])
        for name in dict.fromkeys(r["machine"] for r in rows)
    }
    shown = ("false names", "right name or class", WITHIN)
    lines = [
        f"{len(rows)} cases, versions {', '.join(sorted({r['version'] for r in rows}))}",
        "",
        aligned_table(("", "reached", "wanted"), [(n, rates[n], bar) for n, bar in BARS.items()]),
        "",
        aligned_table(
            ("machine", *shown),
            [(name, *(own[rate] for rate in shown)) for name, own in machines.items()],
        ),
    ]
    weighed = [
        pair
        for row in rows
        for pair in told(row["verdict"], [name for t in row["hidden"] for name in t["library"]])
    ]
    lines += ["", *reliability_lines(weighed)]
    by_effect: dict[str, list[str]] = defaultdict(list)
    for row in rows:
        by_effect[row["title"]].append(judge(row).remark)
    told_of = [(title, "; ".join(said)) for title, said in sorted(by_effect.items())]
    return "\n".join([*lines, "", aligned_table(("hidden", "said"), told_of, width=None)])


WITHIN = f"held-out error within {LARGEST_RATIO} of the truth"
BARS = {
    "false names": "0",
    "right name or class": "at least 85 %",
    "right name or class, what the library has": "",
    "right place": "",
    "wrong name": "",
    WITHIN: "at least 85 %",
    "gains but is refused": "0",
    "diagnosis failed": "0",
}
"""What is counted, and what is wanted."""


def rates_of(rows: Sequence[Mapping[str, Any]]) -> dict[str, Rate]:
    """Return the rates that the bars are about, with their intervals."""
    judged = [(row, judge(row)) for row in rows]
    clean = [(r, j) for r, j in judged if not r["hidden"]]
    faulty = [(r, j) for r, j in judged if r["hidden"]]
    named = [(t, right) for r, j in faulty for t, right in zip(r["hidden"], j.named, strict=True)]
    return {
        "false names": Rate.of(bool(names_of(r["verdict"])) for r, _ in clean),
        "right name or class": Rate.of(right for _, right in named),
        "right name or class, what the library has": Rate.of(r for t, r in named if t["library"]),
        "right place": Rate.of(right for _, j in faulty for right in j.located),
        "wrong name": Rate.of("wrong name" in j.remark for _, j in faulty),
        WITHIN: Rate.of(over_limit(r["verdict"], r["limit"]) <= LARGEST_RATIO for r in rows),
        "gains but is refused": Rate.of(bool(refused_right(r)) for r, _ in faulty),
        "diagnosis failed": Rate.of(r["verdict"]["verdict"] == "failed" for r in rows),
    }


def summary(rows: Sequence[Mapping[str, Any]]) -> dict[str, Any]:
    """Return the rates and a line per case as plain data."""
    return {
        "schema": "foreign_cases/1",
        "cases": len(rows),
        "versions": sorted({r["version"] for r in rows}),
        "rates": {name: rate.as_data() for name, rate in rates_of(rows).items()},
        "each": [
            judge(row).as_data()
            | {"hidden": row["title"], "refused": refused_right(row)}
            | {"over_limit": over_limit(row["verdict"], row["limit"])}
            for row in rows
        ],
    }
