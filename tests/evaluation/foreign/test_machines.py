"""Foreign machines: truth and first model agree, every effect shows, cases repeat."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from workbench.evaluation.foreign.foreign_case import MACHINES, plan, synonyms
from workbench.evaluation.foreign.machine import Concealed, Machine, Parameters
from workbench.model import Model
from workbench.simulation import simulate

EACH = pytest.mark.parametrize(
    ("machine", "build"), MACHINES, ids=[machine.name for machine, _ in MACHINES]
)
RECORDED = "hold_1"


def plain(machine: Machine) -> Parameters:
    """Nominal parameters with nothing hidden."""
    return {n: v for n, (v, _) in machine.background.items()} | {
        effect.name: 0.0 for effect in machine.concealed
    }


@EACH
def test_the_truth_without_effects_is_the_newcomers_model(
    machine: Machine, build: Callable[[], Model]
) -> None:
    model, p = build(), plain(machine)
    excitation = machine.excitations[RECORDED](np.random.default_rng(5), 200, machine.sample_time)
    commands, measurements = machine.record(excitation, p, None)
    initial = dict(zip([q.name for q in model.states], machine.initial(p), strict=False))
    run = simulate(model, commands, sample_time=machine.sample_time, start=initial)
    for i, channel in enumerate(machine.channels):
        spread = max(float(np.ptp(measurements[:, i])), channel.noise)
        # Two integrators with different steps, the truth's at a fixed one.
        assert np.max(np.abs(run[channel.name][:200] - measurements[:, i])) < 1e-4 * spread


@EACH
def test_every_effect_shows(machine: Machine, build: Callable[[], Model]) -> None:
    names = {port.name for port in build().ports}
    assert len(machine.concealed) == 10
    noise = np.array([channel.noise for channel in machine.channels])
    # Jumps come in the middle of a recording.
    count = round(0.6 * machine.samples)
    before = {}
    for name, excitation in machine.excitations.items():
        driven = excitation(np.random.default_rng(5), machine.samples, machine.sample_time)[:count]
        before[name] = machine.record(driven, plain(machine), None)

    def shown(effect: Concealed, recording: str) -> bool:
        commands, without = before[recording]
        p = plain(machine) | dict(effect.others) | {effect.name: least(effect)}
        _, measurements = machine.record(commands, p, None, replayed=True)
        return bool(np.max(np.sqrt(np.mean((measurements - without) ** 2, axis=0)) / noise) > 3.0)

    for effect in machine.concealed:
        assert set(effect.ports) <= names and effect.physics in synonyms()
        assert any(shown(effect, recording) for recording in before), effect.name


def least(effect: Concealed) -> float:
    """The size at which it shows least: a limit cuts less the larger it is."""
    return effect.size[effect.name.endswith(("_top", "_limit"))]


def test_any_beginning_of_the_plan_is_a_fair_sample() -> None:
    cases = plan(60)
    assert len({case.name for case in cases}) == 60
    assert sum(not case.hidden for case in cases) == 15
    assert sum(len(case.hidden) == 2 for case in cases) == 8
    for machine, _ in MACHINES:
        own = [case for case in cases if case.machine is machine]
        assert len(own) == 15
        assert len({e.name for case in own for e in case.hidden}) >= 9
    assert [case.title for case in plan(8)] == [case.title for case in cases[:8]]
    assert plan(8, 8000)[0].name == "foreign-8000"


def test_a_case_is_determined_by_its_seed() -> None:
    case = plan(1)[0]
    one, two = case.recordings(), case.recordings()
    assert list(one) == ["fit_1", "fit_2", "hold_1", "hold_2"]
    for name, recording in one.items():
        assert np.array_equal(recording.matrix(recording.names), two[name].matrix(recording.names))
    limit = case.limit([one["hold_1"]])
    for channel in case.machine.channels:
        # The truth misses by little more than the noise and the step of the sensor.
        floor = np.hypot(channel.noise, channel.step / np.sqrt(12))
        assert floor * 0.9 < limit[channel.name] < 2.0 * floor
