"""All checks of a recording, in the order in which one corrects for the next."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from typing import Any, cast

from workbench.errors import WorkbenchError, check_choice
from workbench.recordings.aligned_table import aligned_table
from workbench.recordings.checks.check import Check, Outcome, Result
from workbench.recordings.checks.clipping import check_clipping
from workbench.recordings.checks.constant import check_constant
from workbench.recordings.checks.delay import Delay, check_delay
from workbench.recordings.checks.excitation import Directions, Occupancy, check_excitation
from workbench.recordings.checks.expected import Expected, expectations
from workbench.recordings.checks.gaps import check_gaps
from workbench.recordings.checks.gauge import check_gauge
from workbench.recordings.checks.loop import check_loop
from workbench.recordings.checks.noise import NoiseFloor, check_noise
from workbench.recordings.checks.quantisation import check_quantisation
from workbench.recordings.checks.signs import check_signs
from workbench.recordings.checks.stuck import check_stuck
from workbench.recordings.checks.time_base import check_time_base
from workbench.recordings.checks.uniformity import check_uniformity
from workbench.recordings.checks.units import check_units
from workbench.recordings.recording import Recording

CheckFunction = Callable[[Recording, Expected], Outcome]

# Each of these makes the recording fit for those after it; without them nothing else is defined.
_FOUNDATIONS: tuple[CheckFunction, ...] = (check_time_base, check_gaps, check_constant)
_OTHERS: tuple[CheckFunction, ...] = (
    check_clipping, check_stuck, check_units, check_gauge, check_quantisation, check_noise,
    check_uniformity, check_loop, check_delay, check_signs, check_excitation,
)  # fmt: skip


@dataclass(frozen=True, eq=False)
class CheckReport:
    """What the checks found in a recording.

    Args:
        name: Name of the recording.
        checks: The checks, in order.
        recording: The corrected recording.
        original: The recording as it was read.
    """

    name: str
    checks: tuple[Check, ...]
    recording: Recording
    original: Recording

    @property
    def fit(self) -> bool:
        """Whether the recording can be judged."""
        return all(check.result != "unfit" for check in self.checks)

    @property
    def result(self) -> Result:
        """The worst result of all checks."""
        results = {check.result for check in self.checks}
        for result in ("unfit", "corrected"):
            if result in results:
                return cast("Result", result)
        return "pass"

    @property
    def noise(self) -> dict[str, NoiseFloor]:
        """Noise floors by measured signal, in SI; empty if the recording is unfit."""
        return dict(self._values("noise floor").get("floors", {}))

    @property
    def loop(self) -> str:
        """``open``, ``closed`` or ``unknown``."""
        return str(self._values("loop").get("loop", "unknown"))

    @property
    def delays(self) -> tuple[Delay, ...]:
        """Delays from every command to every measured signal."""
        return tuple(self._values("delay").get("delays", ()))

    @property
    def steps(self) -> dict[str, float]:
        """Steps of the converters by signal, in SI; 0 where none shows."""
        return dict(self._values("quantisation").get("steps", {}))

    @property
    def occupancy(self) -> dict[str, Occupancy]:
        """Where each signal has been."""
        return dict(self._values("excitation").get("occupancy", {}))

    @property
    def directions(self) -> dict[str, Directions]:
        """How each motion divides between its directions."""
        return dict(self._values("excitation").get("directions", {}))

    def _values(self, name: str) -> Mapping[str, Any]:
        return next((c.values for c in self.checks if c.name == name), {})

    def check(self, name: str) -> Check:
        """Return a check by name.

        Args:
            name: Name such as ``gaps``.

        Raises:
            WorkbenchError: If there is no such check; names the nearest spelling.
        """
        check_choice("check", name, [c.name for c in self.checks])
        return next(c for c in self.checks if c.name == name)

    def require_fit(self) -> Recording:
        """Return the corrected recording.

        Raises:
            WorkbenchError: If a check found it unfit; the text says why.
        """
        for check in self.checks:
            if check.result == "unfit":
                raise WorkbenchError(f"recording {self.name} is unfit ({check.name}): {check.note}")
        return self.recording

    def as_data(self) -> list[dict[str, str]]:
        """Return one entry per check, as a verdict lists them."""
        return [
            {"recording": self.name, "check": c.name, "result": c.result, "note": c.note}
            for c in self.checks
        ]

    def __str__(self) -> str:
        rows = [(c.name, c.result, c.note) for c in self.checks]
        return f"{self.name}: {self.result}\n" + aligned_table(("check", "result", "note"), rows)


def check_recording(
    recording: Recording,
    *,
    model: Any = None,
    required: Iterable[str] | None = None,
    ranges: Mapping[str, tuple[float, float]] | None = None,
    signs: Mapping[tuple[str, str], int] | None = None,
) -> CheckReport:
    """Judge whether a recording is fit, and correct what can be corrected.

    The checks: time base, gaps, constant signals, clipping, stuck samples, units, gauge pressure,
    quantisation, noise floor, uniformity, loop, delay, signs, excitation. If the time base or
    the gaps are unfit, or a required signal is constant, the others do not run.

    Args:
        recording: The recording as it was read.
        model: Model whose inputs and outputs are required, with their limits; None without.
        required: Names of the signals that must be fit; by default those of the model, else those
            whose column states a unit or stands in a mapping file.
        ranges: Plausible ranges by signal, in SI.
        signs: Sign of the response by (cause, response); by default those of the arm.

    Returns:
        The report with the corrected recording.

    Raises:
        WorkbenchError: If a required signal is not in the recording.

    Example:
        >>> import numpy as np
        >>> from workbench.recordings import Signal
        >>> time = np.arange(1000) * 0.002
        >>> noise = np.random.default_rng(0).normal(0.0, 1e-3, 1000)
        >>> trial = Recording("trial", time, (Signal("angle", np.sin(time) + noise, "rad"),))
        >>> report = check_recording(trial)
        >>> report.result, round(report.noise["angle"].floor, 4)
        ('pass', 0.001)
    """
    expected = expectations(recording, model=model, required=required, ranges=ranges, signs=signs)
    checks: list[Check] = []
    current = recording
    for group in (_FOUNDATIONS, _OTHERS):
        for function in group:
            outcome = function(current, expected)
            checks.append(outcome.check)
            current = outcome.recording
            if outcome.check.result == "unfit" and group is _FOUNDATIONS:
                return CheckReport(recording.name, tuple(checks), current, recording)
    return CheckReport(recording.name, tuple(checks), current, recording)
