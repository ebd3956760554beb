"""Work is counted the same by machine code, by the interpreter and by other processes."""

from __future__ import annotations

import numpy as np
import pytest

from workbench.computing.counted import UNITS, add, count, done, in_words, since, together
from workbench.computing.machine_code import compiler
from workbench.computing.processes import in_order
from workbench.diagnosis.estimation.refit import refit
from workbench.diagnosis.estimation.simulated_recordings import simulated_axis
from workbench.plants.servo_axis import servo_axis
from workbench.simulation import equations, integrators, simulate


def _simulated() -> dict[str, int]:
    before = done()
    force = np.where(np.arange(400) % 200 < 100, 80.0, -80.0)[:, None]
    simulate(servo_axis(), force, sample_time=0.005, tolerance=1e-6, check=False)
    return {unit: n for unit, n in since(before).items() if unit != "compilations"}


def test_the_work_of_a_small_simulation_is_bounded() -> None:
    work = _simulated()
    # It takes 422 steps, of which every sample needs one, and 3331 evaluations: a tenth more is
    # a regression that no noise hides.
    assert 400 <= work["integrator_steps"] <= 464
    assert 6 * work["integrator_steps"] < work["model_evaluations"] <= 3660


def test_the_interpreter_counts_as_machine_code_does(monkeypatch: pytest.MonkeyPatch) -> None:
    machine_code = _simulated()
    caches = compiler, equations._library, integrators.integrator_library
    with monkeypatch.context() as patch:
        patch.setenv("WORKBENCH_CC", "none")
        for cache in caches:
            cache.cache_clear()
        assert _simulated() == machine_code
    for cache in caches:
        cache.cache_clear()


def test_the_work_of_a_small_refit_is_bounded() -> None:
    runs = [simulated_axis(seed) for seed in (0, 1)]
    before = done()
    refit(servo_axis(), runs)
    work = since(before)
    # Eight runs of the filter along both recordings of 400 samples, 6400; one more is too many.
    assert 400 <= work["filtered_samples"] <= 6400


def _counting(amount: int) -> int:
    count("solver_iterations", amount)
    return amount


@pytest.mark.parametrize("jobs", [1, 2])
def test_what_other_processes_do_is_added_up(jobs: int) -> None:
    before = done()
    assert in_order([(_counting, (n,)) for n in (30, 4)], jobs=jobs) == [30, 4]
    assert since(before)["solver_iterations"] == 34


def test_work_adds_up() -> None:
    before = done()
    add({"filtered_samples": 7})
    assert since(before) == {unit: 7 * (unit == "filtered_samples") for unit in UNITS}
    both = together({"filtered_samples": 7}, {"filtered_samples": 1, "compilations": 2})
    assert in_words(both) == "8 filtered samples, 2 compilations"
