"""Angle and stiffness together, on an arm with one valve per muscle.

The torque follows from the difference of the two pressures, the stiffness from their mean. The
outer loop of the cascaded PID decides the difference; the mean is a second reference. Sample k,
with the references u of the difference, from the PID, and m of the mean, and the filtered
pressures p_i:

    f[k]   = m[k] passed through two lags of speed omega_m
    f[k]   is clipped so that f +- u / 2 lie in [p_min, p_max]
    a[k]   = f + (G - 1) (f - mean of p)
    w_1[k] = a + u / 2,  w_2[k] = a - u / 2
    o_i[k] = K (w_i[k] - p_i[k]) (V_i / V_0) (q_0 / q_i)     openings, then the inverse valve curve

Where difference and mean cannot be had together the mean gives way: the angle comes first. G lets
the mean, which no joint swings with, answer faster than the difference.
K = 2 K_inner places the pole of each pressure where the PID's inner loop places that of the
difference, because one valve moves its own pressure only. The mean stays while the difference
moves if both pressures move at the same speed. Filling is faster than venting and a short muscle
holds more gas, so each error is weighed with the muscle's volume V_i and the flow q_i of a fully
open edge at its pressure, over their values at the point of design; and where one opening is at
its limit both are reduced alike.

    q = p_s psi(p / p_s) while filling, p psi(p_a / p) while venting     (ISO 6358)
    V_i = V_0 (1 +- c (angle - angle_0))

Units: SI.

Source: the cascade is that of `controllers.pid`; Tondu and Lopez, Modeling and control of McKibben
artificial muscle robot actuators, IEEE Control Systems 20, 2000 (torque by the difference,
stiffness by the sum of the pressures).
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from controllers.arithmetic import FLOATS, Arithmetic, Number, Numbers, Told
from controllers.joint.at_one_point import UNIT
from controllers.joint.model import joint_model
from controllers.law import ClosedForm
from controllers.pid import CascadePID, PIDSpecification, PIDState, design_pid
from controllers.protocol import Command
from controllers.valve_inverse import SENSORS, joint_design
from workbench.errors import WorkbenchError, check_choice, check_range
from workbench.linearisation import LinearModel
from workbench.linearisation.state_space import linear_model

ACTUATORS = ("valve_1", "valve_2")

POLYTROPIC = 1.2
"""Exponent of the gas at the speed of the joint."""


SPECIFICATION = PIDSpecification(inner_bandwidth=150.0, reference_speed=20.0)
"""A reference slow enough that no valve is at its limit, where the mean would move."""


class AngleStiffnessState(NamedTuple):
    """What an `AngleStiffness` remembers.

    Args:
        filtered: Wanted mean after the first lag, in Pa.
        mean: Wanted mean after the second lag, in Pa.
    """

    outer: PIDState
    pressure_1: Number
    pressure_2: Number
    filtered: Number
    mean: Number


@dataclass(frozen=True)
class Air:
    """Flows through the valves and volumes of the muscles, relative to a point of design.

    Args:
        pressure: Mean gauge pressure of the design, in Pa.
        volume_slope: Relative growth c of muscle 1's volume with the angle, per rad; that of
            muscle 2 shrinks as much.
        supply: Supply pressure, gauge, in Pa.
        ambient: Ambient pressure, absolute, in Pa.
    """

    pressure: float = 3e5
    angle: float = math.radians(30.0)
    volume_slope: float = 0.0
    supply: float = 6e5
    ambient: float = 1.01325e5
    critical_ratio: float = 0.23

    def __post_init__(self) -> None:
        check_range("design pressure", self.pressure, 0.0, self.supply, "Pa")
        check_range("relative growth of the volume", self.volume_slope, -5.0, 5.0, "per rad")
        check_range("critical ratio", self.critical_ratio, 0.0, 0.9)

    def weights(
        self, pressure: Number, angle: Number, side: float, arithmetic: Arithmetic
    ) -> tuple[Number, Number]:
        """Return (V / V_0) (q_0 / q) of a muscle for filling and for venting, ratios (ISO 6358-1).

        The muscle, at a gauge pressure in Pa and an angle in rad, shortens with the angle (``side``
        1) or grows (-1).
        """
        usual = 0.5 * sum(self._flows(self.pressure, arithmetic))
        filling, venting = self._flows(pressure, arithmetic)
        grown = 1.0 + side * self.volume_slope * (angle - self.angle)
        volume = arithmetic.clip(grown, 0.3, 3.0)
        return volume * usual / filling, volume * usual / venting

    def _flows(self, pressure: Number, arithmetic: Arithmetic) -> tuple[Number, Number]:
        inside = arithmetic.clip(pressure, 0.0, self.supply) + self.ambient
        supply = self.supply + self.ambient
        return (
            supply * self._psi(inside / supply, arithmetic),
            inside * self._psi(self.ambient / inside, arithmetic),
        )

    def _psi(self, ratio: Number, arithmetic: Arithmetic) -> Number:
        z = arithmetic.clip((ratio - self.critical_ratio) / (1.0 - self.critical_ratio), 0.0, 1.0)
        # Kept from 0, where no opening would move the pressure.
        return arithmetic.clip(1.0 - z * z, 0.04, 1.0) ** 0.5


@dataclass(frozen=True, repr=False)
class AngleStiffness(ClosedForm):
    """Cascaded control of angle and mean pressure with two valves.

    Args:
        outer: Cascaded PID of the angle; its inner gain sets that of both pressures.
        mean_speed: Speed omega_m of the lags on the reference of the mean, in rad/s.
        mean_gain: Gain G on the error of the mean, relative to that on the difference.
    """

    outer: CascadePID
    air: Air = Air()
    mean_speed: float = 15.0
    mean_gain: float = 2.0
    pressure_limits: tuple[float, float] = (0.2e5, 5.8e5)
    pressure_filter: float = 0.002
    name: str = "angle and stiffness"
    sensors: tuple[str, ...] = SENSORS
    controlled: tuple[str, ...] = ("angle", "mean_pressure")
    actuators: tuple[str, ...] = ACTUATORS
    preview: int = 0

    def __post_init__(self) -> None:
        fastest = 1.0 / self.sample_time
        check_range(f"mean speed of {self.name}", self.mean_speed, 1e-3, fastest, "rad/s")
        low, high = self.pressure_limits
        check_range(f"highest pressure of {self.name}", high, low, 1e8, "Pa")

    @property
    def sample_time(self) -> float:
        """Time between steps, in s."""
        return self.outer.sample_time

    def initial_state(
        self, measurement: Numbers, arithmetic: Arithmetic = FLOATS
    ) -> AngleStiffnessState:
        """Return the state that holds the measured pressures at the measured angle."""
        _, p1, p2 = measurement
        mean = 0.5 * (p1 + p2)
        return AngleStiffnessState(
            self.outer.initial_state(measurement, arithmetic), p1, p2, mean, mean
        )

    def law(
        self,
        state: AngleStiffnessState,
        measurement: Numbers,
        reference: Numbers,
        arithmetic: Arithmetic,
    ) -> tuple[Numbers, AngleStiffnessState, Told]:
        outer, p1, p2, filtered, mean = state
        _, outer, told = self.outer.law(outer, measurement, reference[:1], arithmetic)
        half = 0.5 * told["asked_difference"]
        fresh = self.mean_speed * self.sample_time
        filtered = filtered + fresh * (reference[1] - filtered)
        mean = mean + fresh * (filtered - mean)
        # Both references of pressures inside the limits: the mean gives way, not the difference.
        low, high = self.pressure_limits
        size = arithmetic.largest(half, -half)
        kept = arithmetic.clip(mean, low + size, high - size)
        share = self.sample_time / (self.pressure_filter + self.sample_time)
        p1 = p1 + share * (measurement[1] - p1)
        p2 = p2 + share * (measurement[2] - p2)
        aim = kept + (self.mean_gain - 1.0) * (kept - 0.5 * (p1 + p2))
        openings = [
            self._opening(reference - p, p, measurement[0], side, arithmetic)
            for reference, p, side in ((aim + half, p1, 1.0), (aim - half, p2, -1.0))
        ]
        reduction = arithmetic.largest(1.0, *(end for o in openings for end in (o, -o)))
        openings = [o / reduction for o in openings]
        commands = tuple(self.outer.valve.command(o, arithmetic) for o in openings)
        following = AngleStiffnessState(outer, p1, p2, filtered, mean)
        return (
            commands,
            following,
            {
                "opening_1": openings[0],
                "opening_2": openings[1],
                "wanted_difference": 2.0 * half,
                "wanted_mean": kept,
            },
        )

    def _opening(
        self, error: Number, pressure: Number, angle: Number, side: float, arithmetic: Arithmetic
    ) -> Number:
        filling, venting = self.air.weights(pressure, angle, side, arithmetic)
        return (2.0 * self.outer.gains.at(UNIT, arithmetic).inner) * (
            arithmetic.clip(error, 0.0, 1e12) * filling
            + arithmetic.clip(error, -1e12, 0.0) * venting
        )

    def straight(self, told: Told) -> Numbers:
        """Return the voltages, in V, at which the tangents at rest give the openings."""
        return tuple(self.outer.valve.tangent(told[f"opening_{i}"]) for i in (1, 2))

    @property
    def rest_command(self) -> Command:
        """Commands that shut both valves, in V."""
        return (self.outer.valve.centre,) * 2

    def linear_command(self, command: Command) -> Command:
        """Return the commands that give a linear model the same openings."""
        return tuple(self.outer.valve.linear_command(voltage) for voltage in command)


def design_angle_stiffness(
    linear: LinearModel, specification: PIDSpecification | None = None
) -> AngleStiffness:
    """Design the controller from a linear model of the arm with two valves.

    The two valves driven in opposite directions are one valve for both muscles: the cascaded PID
    is designed on that model.

    Args:
        linear: Linear model from the voltages ``valve_1`` and ``valve_2`` to the sensors.
        specification: What the angle's loop is to reach; `SPECIFICATION` by default.

    Raises:
        WorkbenchError: If the linear model lacks a signal, or no bandwidth meets the limits.
    """
    linear = linear_model(linear)
    one = opposed(linear)
    outer = design_pid(one, specification or SPECIFICATION)
    low, high = AngleStiffness.pressure_limits
    outer = replace(outer, difference_limit=min(outer.difference_limit, high - low))
    joint = joint_model(one)
    measurements = dict(zip(linear.output_names, linear.y0.tolist(), strict=True))
    mean = 0.5 * (measurements["pressure_1"] + measurements["pressure_2"])
    known = {q.name: q.value for q in linear.operating_point.model.parameters}
    ambient = known.get("ambient_pressure", Air.ambient)
    air = Air(
        pressure=mean,
        angle=measurements["angle"],
        # Both pressures answer a speed by p' = -+ n p V'/V, between isothermal and adiabatic.
        volume_slope=joint.e / (2.0 * POLYTROPIC * (mean + ambient)),
        supply=known.get("supply_pressure", Air.supply),
        ambient=ambient,
    )
    return AngleStiffness(outer, air)


def opposed(linear: LinearModel) -> LinearModel:
    """Return a linear model whose one input ``valve`` drives both valves in opposite directions."""
    for actuator in ACTUATORS:
        check_choice("actuator of the linear model", actuator, linear.input_names)
    one, two = (linear.input_names.index(actuator) for actuator in ACTUATORS)
    rest = float(linear.u0[one])
    if abs(rest - float(linear.u0[two])) > 0.2:
        raise WorkbenchError(
            f"the inputs rest at {rest:g} and {linear.u0[two]:g}, at different slopes of the valve;"
            " linearise at an angle and a mean pressure that both nearly shut valves hold"
        )
    return replace(
        linear,
        B=np.asarray(linear.B)[:, [one]] - np.asarray(linear.B)[:, [two]],
        D=np.asarray(linear.D)[:, [one]] - np.asarray(linear.D)[:, [two]],
        input_names=("valve",),
        u0=np.array([rest]),
        verdict=None,
    )


ANGLE_STIFFNESS = joint_design(
    name="angle-stiffness",
    family="angle and stiffness",
    summary="cascaded PID of the angle and of the mean pressure, with one valve per muscle",
    function=design_angle_stiffness,
    specification=PIDSpecification,
    actuators=ACTUATORS,
)
