"""The benchmarks: what is timed, against what, and the figure to reach."""

from __future__ import annotations

import math
import subprocess
import sys
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import casadi as ca
import numpy as np
import numpy.typing as npt

from workbench.linearisation import linearise
from workbench.linearisation.operating_map import operating_map
from workbench.model import Model
from workbench.operating_point import operating_point
from workbench.plants.arm import arm
from workbench.simulation import simulate

Vector = npt.NDArray[np.float64]

_REPEATS = 3
_SAMPLE_TIME = 0.002
_TIGHT = 1e-9


@dataclass(frozen=True)
class Timing:
    """One line of the table.

    Args:
        what: What was timed.
        value: The figure, in ``unit``.
        unit: Unit of the figure; ``x`` for a ratio.
        reach: The figure to reach, in ``unit``.
        larger_is_better: Whether the figure should be above ``reach``.

    Example:
        >>> print(Timing("open loop", 520.0, "x real time", 500.0))
        open loop                                                    520 x real time       reach 500
    """

    what: str
    value: float
    unit: str
    reach: float
    larger_is_better: bool = True

    @property
    def reached(self) -> bool:
        """Whether the figure is reached."""
        return self.value >= self.reach if self.larger_is_better else self.value <= self.reach

    def __str__(self) -> str:
        """Return one aligned line."""
        line = f"{self.what:<52} {self.value:>11.4g} {self.unit:<17} reach {self.reach:g}"
        return line if self.reached else f"{line}  MISSED"


@dataclass(frozen=True)
class Benchmarks:
    """All timings of one run.

    Args:
        timings: The lines of the table.

    Example:
        >>> print(Benchmarks((Timing("import", 0.1, "s", 0.5, False),)))
        import                                                       0.1 s                 reach 0.5
    """

    timings: tuple[Timing, ...]

    def __str__(self) -> str:
        """Return the table."""
        return "\n".join(str(timing) for timing in self.timings)


def _fastest(work: Callable[[], object], repeats: int = _REPEATS) -> float:
    """Return the shortest of several times, in s of processor time: others may be at work."""
    times = []
    for _ in range(repeats):
        began = time.process_time()
        work()
        times.append(time.process_time() - began)
    return max(min(times), 1e-9)


def _pulses(seconds: float) -> Vector:
    t = _SAMPLE_TIME * np.arange(round(seconds / _SAMPLE_TIME))
    return np.asarray(5.0 + 0.9 * np.where((t % 4.0) < 2.0, 1.0, -1.0))


def _sine(seconds: float) -> Vector:
    """Return a sine in small steps: at a pulse CVODES over a grid gives up."""
    t = _SAMPLE_TIME * np.arange(round(seconds / _SAMPLE_TIME))
    return np.asarray(5.0 + 0.5 * np.sin(math.pi * t))


def _open_loop(plant: Model, voltage: Vector, tolerance: float) -> float:
    seconds = len(voltage) * _SAMPLE_TIME

    def work() -> None:
        simulate(plant, voltage, sample_time=_SAMPLE_TIME, tolerance=tolerance, check=False)

    work()
    return _fastest(work) / seconds


def _cvodes(plant: Model, seconds: float) -> float:
    """Time CasADi's CVODES over a grid with piecewise constant inputs, in s per simulated s."""
    traced = plant.exact
    voltage = _sine(seconds)
    scale = np.array([q.scale for q in plant.states])
    z = ca.SX.sym("z", len(scale))
    rates = ca.substitute(traced.rates, traced.x, z * scale) / scale
    integrator = ca.integrator(
        "grid",
        "cvodes",
        {"x": z, "u": traced.u, "p": traced.p, "ode": rates},
        0.0,
        [_SAMPLE_TIME * (i + 1) for i in range(len(voltage))],
        {"abstol": 1e-8, "reltol": 1e-8},
    )
    start = plant.initial_state() / scale
    return _fastest(lambda: integrator(x0=start, u=voltage[None, :], p=plant.values), 1) / seconds


def _lsoda(plant: Model, seconds: float) -> float:
    """Time SciPy's LSODA, restarted at every sample, in s per simulated s."""
    from scipy.integrate import solve_ivp

    function, values = plant.exact.rates_function, plant.values
    scale = np.array([q.scale for q in plant.states])
    voltage = _sine(seconds)

    def rates(_: float, z: Vector, u: float) -> Vector:
        result: Vector = np.asarray(function(z * scale, u, values), dtype=float).ravel() / scale
        return result

    def work() -> None:
        z = plant.initial_state() / scale
        for u in voltage:
            z = solve_ivp(
                rates, (0.0, _SAMPLE_TIME), z, "LSODA", args=(u,), rtol=1e-8, atol=1e-8
            ).y[:, -1]

    return _fastest(work, 1) / seconds


def _closed_loop(plant: Model) -> tuple[float, tuple[float, float]]:
    """Time the PID loop, in s per simulated s, and the solves of the MPC, in s."""
    from controllers.mpc.whole_model import design_mpc
    from controllers.pid import design_pid
    from workbench.verification import step_scenario, verify

    point = operating_point(plant.without("bearing_friction"), {"angle": math.radians(30.0)})
    linear = linearise(point, verdict=False)
    pid, mpc = design_pid(linear), design_mpc(linear)
    scenario = step_scenario("angle", 15, 45, unit="deg")
    seconds = float(verify(pid, plant, scenario, tolerance=1e-5).time[-1])
    per_second = _fastest(lambda: verify(pid, plant, scenario, tolerance=1e-5)) / seconds
    solve = verify(mpc, plant, scenario, tolerance=1e-5).info("solve_time")
    median, slow = np.nanquantile(solve, [0.5, 0.99])
    return per_second, (float(median), float(slow))


def run_benchmarks(*, progress: Callable[[str], None] = lambda text: None) -> Benchmarks:
    """Measure everything once.

    Args:
        progress: Called with a line of text before each measurement.

    Returns:
        The table; times are processor time, so that other work on the machine counts little.
    """
    plant = arm(load_kg=3)
    found: list[Timing] = []
    progress("open loop")
    ours = _open_loop(plant, _pulses(60.0), 1e-7)
    tight = _open_loop(plant, _pulses(60.0), _TIGHT)
    found.append(Timing("open loop, arm, 60 s, tolerance 1e-7", 1 / ours, "x real time", 500))
    found.append(Timing("open loop, arm, 60 s, tolerance 1e-9", 1 / tight, "x real time", 500))
    progress("open loop with other integrators")
    same = _open_loop(plant, _sine(8.0), 1e-8)
    found.append(Timing("  against CasADi CVODES over a grid", _cvodes(plant, 8.0) / same, "x", 10))
    found.append(Timing("  against SciPy LSODA per sample", _lsoda(plant, 2.0) / same, "x", 50))
    progress("closed loop")
    loop, (median, slow) = _closed_loop(plant)
    found.append(Timing("closed loop, PID at 500 Hz", 1 / loop, "x real time", 100))
    found.append(Timing("linear MPC solve, median", 1e3 * median, "ms", 0.5, False))
    found.append(Timing("linear MPC solve, 99 % of all below", 1e3 * slow, "ms", 2.0, False))
    progress("linear models")
    found += _linear_models(plant)
    found.append(Timing("import workbench", _import_seconds(), "s", 0.5, False))
    return Benchmarks(tuple(found))


def _linear_models(plant: Model) -> Sequence[Timing]:
    point = operating_point(plant, {"angle": math.radians(30.0), "mean_pressure": 3e5})
    linearise(point)
    single = _fastest(lambda: linearise(point), 10)
    angles = np.radians(np.arange(61.0))

    def batch() -> object:
        return operating_map(plant, {"angle": angles, "load": [3.0], "mean_pressure": [3e5]})

    batch()
    return (
        Timing("one linear model with its kinks", 1e3 * single, "ms", 2.0, False),
        Timing("linear models at 61 angles", 1e3 * _fastest(batch), "ms", 100.0, False),
    )


def _import_seconds() -> float:
    code = "import time; t = time.perf_counter(); import workbench; print(time.perf_counter() - t)"
    runs = [
        subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
        for _ in range(_REPEATS)
    ]
    return min(float(run.stdout) for run in runs)
