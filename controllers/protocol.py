"""What every controller offers: one pure step at a fixed sample time."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Protocol, runtime_checkable

from workbench.errors import TIMES_S, WorkbenchError, check_range

Measurement = tuple[float, ...]
"""Measurements of the controller's `Controller.sensors`, in their order, in SI."""

Reference = tuple[float, ...]
"""References of the controlled outputs now, then those of each previewed sample, in SI."""

Command = tuple[float, ...]
"""Values for the controller's actuators, in their order, in SI."""

Info = Mapping[str, float | str]
"""What a step tells about itself, by name: never needed to go on."""


@runtime_checkable
class Controller(Protocol):
    """A sampled control law.

    A controller is a frozen set of gains. Everything that changes from sample to sample is in the
    state that `step` takes and returns, so that a run can be repeated, branched and exported. It
    knows the plant through linear models and through the measurements of its sensors only, and the
    same object runs on a linear model, on the full plant and on the rig.

    Time: the measurement of sample k is taken at t = k h, the command computed from it is held
    over [k h, (k + 1) h).
    """

    @property
    def name(self) -> str:
        """Name under which results are reported."""

    @property
    def sample_time(self) -> float:
        """Time between steps, in s."""

    @property
    def sensors(self) -> tuple[str, ...]:
        """Names of the outputs that it reads."""

    @property
    def controlled(self) -> tuple[str, ...]:
        """Names of the outputs that have a reference."""

    @property
    def actuators(self) -> tuple[str, ...]:
        """Names of the inputs that it commands."""

    @property
    def preview(self) -> int:
        """Number of future samples of the reference that it wants."""

    def initial_state(self, measurement: Measurement) -> Any:
        """Return the state from which the controller starts without a bump."""

    def step(
        self, state: Any, measurement: Measurement, reference: Reference
    ) -> tuple[Command, Any, Info]:
        """Compute the command of one sample, without side effects.

        Returns:
            The command in SI, the next state, and information about the step.
        """

    def linear_command(self, command: Command) -> Command:
        """Return the command to which a linear model responds as the plant to ``command``.

        A controller that inverts a static curve of the actuator hands the plant a command bent by
        that inverse; the linear model has the straight line at rest instead.
        """


def check_controller(found: Any, what: str = "the controller") -> None:
    """Check that something has every member of a controller.

    Raises:
        WorkbenchError: If it is none.
    """
    if isinstance(found, type):
        raise WorkbenchError(f"{what} is the class {found.__name__}; give an object of it")
    members = [name for name in vars(Controller) if not name.startswith("_")]
    lacking = [name for name in members if not hasattr(found, name)]
    if lacking:
        system = hasattr(found, "ninputs") or hasattr(found, "to_ss")
        made = "; transfer_controller in controllers.plain.transfer_law makes one of it"
        raise WorkbenchError(
            f"{what} is a {type(found).__name__}, which is no controller: it has no"
            f" {', '.join(lacking)}{made if system else ''}"
        )
    for name in ("sensors", "controlled", "actuators"):
        names = getattr(found, name)
        if isinstance(names, str) or not all(isinstance(n, str) for n in names):
            raise WorkbenchError(
                f'{name} of {what} is {names!r}; give a tuple of names, such as ("angle",)'
            )
    check_range(f"sample_time of {what}", found.sample_time, *TIMES_S)
