"""Threads: results in order, errors as in one thread, nothing lost in a fork or a worker."""

from __future__ import annotations

import os
import subprocess
import sys
import threading
from typing import Any

import control as ct
import numpy as np
import pytest

from controllers.plain.limits import LoopLimits, LoopSpecification
from controllers.plain.measured_outputs import designed_for
from workbench.computing import _thread_counts, processes
from workbench.computing.processes import in_order, side_by_side
from workbench.diagnosis.estimation.prediction_error import PredictionError, disturbances
from workbench.diagnosis.estimation.simulated_recordings import simulated_axis
from workbench.linearisation import linear_model
from workbench.plants.servo_axis import servo_axis


def test_results_come_in_order_from_several_threads(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(processes, "threads", lambda: 3)
    both = threading.Barrier(2, timeout=10)

    def name(number: int) -> tuple[int, str]:
        if number < 2:
            both.wait()
        return number, threading.current_thread().name

    found = side_by_side([(name, (number,)) for number in range(3)])
    assert [number for number, _ in found] == [0, 1, 2]
    assert len({name for _, name in found[:2]}) == 2


def test_the_first_error_is_raised(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(processes, "threads", lambda: 3)
    with pytest.raises(ZeroDivisionError):
        side_by_side([(abs, (1,)), (divmod, (1, 0)), (int, ("x",))])


def test_a_worker_has_one_thread() -> None:
    assert in_order([(processes.threads, ()), (processes.threads, ())], jobs=2) == [1, 1]


def test_recordings_are_filtered_side_by_side_as_one_by_one() -> None:
    axis = servo_axis()
    seen = [simulated_axis(seed, samples=1000) for seed in (1, 2, 3)]
    filter_ = PredictionError(axis, seen[0], ("mass",), disturbances(axis, 1.0))
    for one, together in zip(
        [filter_.run(observed, axis.values) for observed in seen],
        filter_.along(seen, axis.values),
        strict=True,
    ):
        np.testing.assert_array_equal(one.whitened, together.whitened)
        np.testing.assert_array_equal(one.jacobian, together.jacobian)


@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="threads are counted in /proc")
@pytest.mark.parametrize(("given", "threads"), [({}, 1), ({"OPENBLAS_NUM_THREADS": "3"}, 3)])
def test_a_verb_has_one_thread_of_linear_algebra_or_as_many_as_the_user_says(
    given: dict[str, str], threads: int
) -> None:
    program = "import os, workbench.cli, numpy.linalg; print(len(os.listdir('/proc/self/task')))"
    usual = {k: v for k, v in os.environ.items() if not k.endswith("_NUM_THREADS")}
    done = subprocess.check_output([sys.executable, "-c", program], env=usual | given)
    assert int(done) <= threads
    assert os.cpu_count() == 1 or int(done) > 1 or threads == 1


@pytest.mark.skipif(not _thread_counts(), reason="NumPy brings no OpenBLAS here")
def test_a_design_keeps_linear_algebra_to_one_thread() -> None:
    # A notebook has loaded NumPy by then, with a thread for each core.
    before = [count() for count, _ in _thread_counts()]
    try:
        for _, set_count in _thread_counts():
            set_count(2)
        seen: list[int] = []

        def design(limits: LoopLimits) -> Any:
            seen.extend(count() for count, _ in _thread_counts())
            return limits

        # Linear equations: there are none on which a finished law is tried.
        linear = linear_model(ct.tf([1.0], [1.0, 1.0]))
        designed_for(LoopSpecification(), linear, design, lambda *_: False)
        assert seen == [1] * len(before)
        assert [count() for count, _ in _thread_counts()] == [2] * len(before)
    finally:
        for (_, set_count), number in zip(_thread_counts(), before, strict=True):
            set_count(number)


@pytest.mark.skipif(sys.platform == "win32", reason="there is no fork")
def test_a_fork_has_threads_of_its_own() -> None:
    program = (
        "import os\n"
        "from workbench.computing import processes\n"
        "processes.threads = lambda: 2\n"
        "calls = [(max, (1, 2)), (min, (1, 2))]\n"
        "processes.side_by_side(calls)\n"
        "child = os.fork()\n"
        "found = processes.side_by_side(calls)\n"
        "if not child:\n"
        "    os._exit(found != [2, 1])\n"
        "raise SystemExit(os.waitpid(child, 0)[1])\n"
    )
    done = subprocess.run([sys.executable, "-W", "ignore", "-c", program], timeout=30, check=False)
    assert done.returncode == 0
