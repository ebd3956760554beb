"""What a search works on, and what it refits more than once."""

from __future__ import annotations

import contextlib
import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from itertools import chain

import numpy as np

from workbench.arrays import Vector
from workbench.diagnosis.estimation.filter import Innovations
from workbench.diagnosis.estimation.prediction_error import Observed, filter_of
from workbench.diagnosis.estimation.priors import Prior
from workbench.diagnosis.estimation.process_noise import (
    ProcessNoiseFit,
    blocks_of_cost,
    extended_start,
    fit_with_process_noise,
    ranges_along,
    start_values,
)
from workbench.diagnosis.location.by_refits import located_by_refits
from workbench.diagnosis.location.locate import Location
from workbench.diagnosis.location.missing_signal import occurrence
from workbench.diagnosis.location.periods import period_of, stride_of
from workbench.diagnosis.location.unknown_input import unknown_input
from workbench.diagnosis.selection.moments import absent_from
from workbench.diagnosis.selection.selected import Accepted, Selected
from workbench.diagnosis.selection.simulation_error import closest_runs
from workbench.errors import NumericalError
from workbench.model import Model
from workbench.model.units import per, same_dimension
from workbench.physics.library import Hypothesis, Law, library
from workbench.physics.recorded_facts import RecordedFacts

MOST_FINDINGS = 3
"""Effects that are searched for, one after the other."""

_BRIEF, _MOSTLY = 0.35, 0.5
"""Part of a recording up to which an episode may last, and share of what is lacking that it has."""

Progress = Callable[[str], None]

Shorter = tuple[ProcessNoiseFit, tuple[Prior, ...]] | None
"""A model without one of its effects, with its free parameters; None if it cannot be fitted."""


@dataclass(frozen=True)
class Task:
    """What a search works on.

    Args:
        nominal: The model that the recordings were observed with.
        location: Where the refitted nominal model lacks something; None if unknown.
        entries: Effects that may be missing; the whole library if None.
        extra: Laws and hypotheses that may be missing beside the library.
        shorter: Models that were refitted without one of their effects, by identity and effect.
        refitted: Models that were refitted to free runs, by identity and whether with heavy tails.
        say: Called with a line of text before each step.
        complete: Names of recordings that lack nothing, to which no event comes.
    """

    nominal: Model
    base: ProcessNoiseFit
    fitting: tuple[Observed, ...]
    judging: tuple[Observed, ...]
    priors: tuple[Prior, ...]
    location: Location | None = None
    entries: tuple[Hypothesis, ...] | None = None
    jobs: int = 1
    say: Progress = lambda text: None
    extra: tuple[Law | Hypothesis, ...] = ()
    tries: Callable[[Hypothesis], bool] = lambda _: True
    complete: tuple[str, ...] = ()
    shorter: dict[tuple[int, str], tuple[ProcessNoiseFit, Shorter]] = field(default_factory=dict)
    refitted: dict[tuple[int, bool], tuple[ProcessNoiseFit, ProcessNoiseFit]] = field(
        default_factory=dict
    )

    @cached_property
    def one_place(self) -> tuple[Location, ProcessNoiseFit] | None:
        """Where an unknown input alone explains as much as one everywhere; None if nowhere.

        The laws that act there were tried in a first search; that two effects hide each other at
        different places is no reason for another one.
        """
        return located_by_refits(self.base, self.fitting, self.priors)

    def tried(self, model: Model) -> list[Hypothesis]:
        """Return the effects that may be missing from a model."""
        entries = self.entries
        given = {effect.name for effect in self.nominal.effects}
        attached = {effect.name for effect in model.effects}
        if entries is None:
            longest = max(self.fitting, key=lambda r: len(r.outputs))
            entries = library(
                model,
                RecordedFacts(
                    longest.used,
                    longest.sample_time * (len(longest.outputs) - 1),
                    longest.sample_time,
                    self._period,
                    self._episode,
                    any(r.diverges for r in self.fitting),
                    self._strides,
                    self._ranges,
                ),
                extra=self.extra,
                more_of=self._more_of,
                found=attached - given,
            )
        without = [r for r in self.fitting if r.name in self.complete]
        tried = (e for e in entries if e.name not in attached and self.tries(e))
        return [absent_from(e, without) for e in tried]

    def closest(self, fit: ProcessNoiseFit, *, robust: bool = False) -> ProcessNoiseFit:
        """Return a fit as it runs closest to the recordings."""
        key = id(fit), robust
        if key not in self.refitted:
            # The fit is kept with it: its identity must not become that of another.
            found = closest_runs(fit, self.nominal, self.fitting, self.judging, robust=robust)
            self.refitted[key] = fit, found
        return self.refitted[key][1]

    def longer(self, model: Model) -> float:
        """Return how much longer a filter takes with what was found, dimensionless, 1 or more."""
        return max(1.0, len(model.states) / max(len(self.base.model.states), 1)) ** 2

    def without(self, state: Selected, found: Accepted) -> Shorter:
        """Refit the extended model without one effect; None if it cannot be fitted without it."""
        name, full = found.candidate.entry.effect.name, state.extended
        key = id(full), name
        if key not in self.shorter:
            # The model is kept with it: its identity must not become that of another.
            self.shorter[key] = full, self._refitted_without(full, name, state.free)
        return self.shorter[key][1]

    def _refitted_without(
        self, full: ProcessNoiseFit, name: str, known: Sequence[Prior]
    ) -> Shorter:
        begun = full.passed or full
        model = begun.model.without(name)
        recordings = self.started(self.fitting, model)
        found: list[tuple[ProcessNoiseFit, tuple[Prior, ...]]] = []
        # Values from before the others were found may lead elsewhere than those with them.
        for fit in (begun, full) if begun is not full else (full,):
            known_values = fit.refit.values.items()
            values = {k: v for k, v in known_values if not k.startswith(f"{name}.")}
            free = tuple(p for p in known if p.name in values)
            # A model that cannot be fitted without the effect needs it.
            with contextlib.suppress(Exception):
                shorter = fit_with_process_noise(
                    model, recordings, free, start=values, noise_scale=begun.noise_scale
                )
                found.append((shorter, free))
        return min(found, key=lambda each: each[0].cost, default=None)

    @cached_property
    def off_bounds(self) -> Model:
        """The refitted model with parameters off their bounds, where they reproduce something."""
        off = self.base.with_values(start_values(self.base.refit, self.priors))
        try:
            blocks_of_cost(off, self.fitting)
        except NumericalError:
            return self.base.model
        return off.model

    @cached_property
    def _ranges(self) -> dict[str, tuple[float, float]]:
        try:
            return ranges_along(self.base, self.fitting)
        except NumericalError:
            return {}

    @cached_property
    def _filtered(self) -> list[tuple[Observed, Innovations]]:
        model = self.off_bounds
        try:
            return [
                (seen, filter_of(model, seen, self.base.noise_scale).run(seen, model.values))
                for seen in self.started(self.fitting, model)
            ]
        except (NumericalError, np.linalg.LinAlgError):
            return []

    @cached_property
    def _lacking(self) -> list[list[tuple[Vector, Vector]]]:
        """Signals that the refitted model lacks by recording, with their times in s.

        Where it was located, and its errors.
        """
        model, left = self.off_bounds, []
        ports = self.location.ports(model) if self.location else ()
        try:
            for seen, run in self._filtered:
                parts = [(seen.time, error) for error in np.nan_to_num(run.whitened).T]
                if ports:
                    found = unknown_input(model, seen, ports)
                    parts = [*((found.time, signal) for signal in found.signal.T), *parts]
                left.append(parts)
        except (NumericalError, np.linalg.LinAlgError):
            return []
        return left

    def _lacking_alone(self) -> Iterator[list[tuple[Vector, Vector]]]:
        """Yield what each port alone lacks where what is missing may be, as the model runs closest.

        What acts for a while may have spoiled the values with which each sample is foretold best.
        """
        model = self.closest(self.base, robust=True).model
        for port in self.location.likely(model) if self.location else ():
            with contextlib.suppress(NumericalError, np.linalg.LinAlgError):
                found = [unknown_input(model, seen, (port,)) for seen, _ in self._filtered]
                yield [(one.time, one.signal[:, 0]) for one in found]

    @cached_property
    def _period(self) -> float:
        """Period of what the refitted model lacks, in s; 0 if it does not repeat."""
        # What seems to repeat by chance costs a law that is refused.
        for beside in (False, True):
            for same in zip(*self._lacking, strict=True):
                times = [(r.name, time) for r, (time, _) in zip(self.fitting, same, strict=True)]
                lacking = np.concatenate([signal for _, signal in same])
                period = period_of(times, lacking, beside_course=beside)
                if math.isfinite(period):
                    return period
        return 0.0

    @cached_property
    def _episode(self) -> tuple[float, float] | None:
        """From when to when most of what the refitted model lacks acts, in s; None if always."""
        for same in chain(zip(*self._lacking, strict=True), self._lacking_alone()):
            times = [(r.name, time) for r, (time, _) in zip(self.fitting, same, strict=True)]
            signal = np.concatenate([signal for _, signal in same])
            spans = occurrence("", "1", times, signal, 0.0 * signal, ()).spans
            # In each recording it may come once.
            most = {span.recording: span for span in reversed(spans)}.values()
            brief = all(s.end - s.begin < _BRIEF * dict(times)[s.recording][-1] for s in most)
            if brief and sum(span.share for span in most) > _MOSTLY:
                return spans[0].begin, spans[0].end
        return None

    @cached_property
    def _strides(self) -> dict[str, float]:
        """How much of a command passes until what is lacking repeats, by port.

        In its unit times s, of commands of one sign. And how far a state goes, by name, that is the
        integral of another one.
        """
        found = self._ways
        for i, q in enumerate(self.base.model.inputs):
            inputs = [r.inputs[:, i] for r in self.fitting]
            if not q.commanded or not all(np.all(u >= 0.0) or np.all(u <= 0.0) for u in inputs):
                continue
            for same in zip(*self._lacking, strict=True):
                ways, signals = [], []
                for seen, u, (time, signal) in zip(self.fitting, inputs, same, strict=True):
                    held = seen.sample_time * np.concatenate([[0.0], np.cumsum(np.abs(u))[:-1]])
                    way = np.interp(time, seen.time, held)
                    even = np.linspace(way[0], way[-1], len(way))
                    ways.append((seen.name, even))
                    signals.append(np.interp(even, way, signal))
                stride = period_of(ways, np.concatenate(signals))
                if math.isfinite(stride):
                    found[f"{q.name}.command"] = stride
                    break
        return found

    @property
    def _ways(self) -> dict[str, float]:
        found, states = {}, self.base.model.states
        for i, q in enumerate(states):
            if not any(same_dimension(other.unit, per(q.unit, "s")) for other in states):
                continue
            for same in zip(*self._lacking, strict=True):
                ways = [
                    np.interp(time, seen.time, run.states[:, i])
                    for (seen, run), (time, _) in zip(self._filtered, same, strict=True)
                ]
                signals = [signal for _, signal in same]
                stride = stride_of(np.concatenate(ways), np.concatenate(signals))
                if math.isfinite(stride):
                    found[q.name] = stride
                    break
        return found

    @cached_property
    def _more_of(self) -> set[str]:
        """Effects of the nominal model of which the refit would take more than is plausible."""
        full = [e.name for e in self.base.refit.estimates if e.on_bound and e.value > e.prior.mean]
        return {name.split(".")[0] for name in full if "." in name}

    def started(self, recordings: Sequence[Observed], model: Model) -> list[Observed]:
        """Return recordings with a start for a model with effects attached."""
        return [extended_start(r, self.nominal, model) for r in recordings]
