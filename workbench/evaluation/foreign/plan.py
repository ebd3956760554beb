"""Which cases are made: machines in turn, a quarter with nothing hidden, some with two effects.

Units: SI.
"""

from __future__ import annotations

import tomllib
from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from pathlib import Path

import numpy as np

from workbench.evaluation.answer_key import Names, Truth
from workbench.evaluation.foreign.circuit import CIRCUIT
from workbench.evaluation.foreign.crane import CRANE
from workbench.evaluation.foreign.drive import DRIVE
from workbench.evaluation.foreign.machine import Array, Concealed, Machine, Parameters, State
from workbench.evaluation.foreign.newcomer import circuit, crane, drive, tank
from workbench.evaluation.foreign.tank import TANK
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
        offered, none = library(self.build()), Names({}, {})
        return tuple(
            Truth(
                effect.name,
                tuple(
                    h.name
                    for h in offered
                    if set(h.ports) & set(effect.ports) and h.law in synonyms()[effect.physics]
                ),
                tuple(dict.fromkeys(none.group(port) for port in effect.ports)),
                effect.physics.startswith("sensor_"),
            )
            for effect in self.hidden
        )


@cache
def synonyms() -> dict[str, tuple[str, ...]]:
    """Return the laws of the library that mean each physics of a concealed effect."""
    text = Path(__file__).with_name("synonyms.toml").read_text(encoding="utf-8")
    return {word: tuple(starts) for word, starts in tomllib.loads(text)["physics"].items()}


def plan(count: int, first_seed: int = FIRST_SEED) -> tuple[Case, ...]:
    """Return the first cases of a plan; any beginning is a fair sample.

    The machines take turns. Every fourth case of a machine hides nothing; the others hide its
    effects in an order of their own, every fifth of them two at once.
    """
    cases = []
    orders = [
        np.random.default_rng([first_seed, i]).permutation(len(machine.concealed)).tolist()
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
        cases.append(Case(first_seed + k, machine, build, hidden))
    return tuple(cases)
