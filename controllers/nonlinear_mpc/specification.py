"""What a nonlinear MPC is asked for."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

from controllers.reference.planned import Planner
from workbench.errors import check_range


@dataclass(frozen=True)
class NonlinearMPCSpecification:
    """What a `NonlinearMPC` is designed for.

    Args:
        angle_scale: Angle error that weighs 1, in rad.
        speed_scale: Error of the speed that weighs 1, in rad/s. A larger one settles faster, and
            overshoots more where the load is not the one that the model has.
        move_scale: Change of the opening from stage to stage that weighs 1, a fraction.
        stages: Number N of stages of the horizon.
        stage_time: Length of a stage, in s.
        steps: Runge-Kutta steps per stage; next to the supply a full opening answers within 1 ms.
        opening_limit: Largest opening, a fraction.
        pressure_limits: Lowest and highest gauge pressure, in Pa. An upper limit next to the supply
            costs accuracy where holding needs nearly all of it; by default it is above.
        softness: Cost of a pressure 1 bar out of its limits (dimensionless).
        torque_walk: Random walk of the disturbing torque on the joint over one second, in N m.
        disturbances: Other states whose rates are disturbed, each with its random walk over one
            second, in the state's SI unit per second. With the torque as many as sensors: no
            offset.
        sensor_noise: Noise rms of angle (rad) and pressures (Pa).
        state_noise: Random walk of every state over one second, as a fraction of its scale.
        reference_speed: Speed omega_r of the reference's lags, in rad/s; not used with preview or
            a planner.
        planner: Planner of the reference in place of the lags; not used with preview.
        preview: Whether the future reference over the horizon is used.
        sample_time: Time between steps, in s.
    """

    angle_scale: float = 0.01
    speed_scale: float = 0.16
    move_scale: float = 0.15
    stages: int = 20
    stage_time: float = 0.02
    steps: int = 8
    opening_limit: float = 1.0
    pressure_limits: tuple[float, float] = (0.1e5, 6.2e5)
    softness: float = 1e4
    torque_walk: float = 40.0
    disturbances: Mapping[str, float] = field(
        default_factory=lambda: {"pressure_1": 1e7, "pressure_2": 1e7}
    )
    sensor_noise: tuple[float, ...] = (2e-5, 600.0, 600.0)
    state_noise: float = 0.1
    reference_speed: float = 40.0
    planner: Planner | None = None
    preview: bool = False
    sample_time: float = 0.002

    def __post_init__(self) -> None:
        h = check_range("sample time", self.sample_time, 1e-6, 1.0, "s")
        check_range("stage time", self.stage_time, h, 10.0, "s")
        check_range("number of stages", self.stages, 2, 200)
        check_range("Runge-Kutta steps per stage", self.steps, 1, 1000)
        check_range("opening limit", self.opening_limit, 1e-3, 1.0)
        for name in (
            "angle_scale",
            "speed_scale",
            "move_scale",
            "softness",
            "torque_walk",
            "reference_speed",
        ):
            check_range(name.replace("_", " "), getattr(self, name), 1e-9, 1e9)
        low, high = self.pressure_limits
        check_range("highest pressure", high, low, 1e8, "Pa", fix="it lies above the lowest")

    @property
    def stride(self) -> int:
        """Samples per stage."""
        return max(1, round(self.stage_time / self.sample_time))
