"""What every controller does before its feedback: where the joint shall be, where it is, its model.

A feedback law gets a `Context` and does not care how it was made: along planned moves over the
whole range (`JointTracking`, here), or around one point (`controllers.joint.at_one_point`).

At sample k, from the angle y, the pressures p1 and p2 and the reference r:

    (theta_r, omega_r, alpha_r, j_r)   planned reference (`controllers.reference.planned`)
    dp, pm                             filtered pressure difference and mean pressure
    (theta, omega, w)                  observer of the joint as a double integrator driven by the
                                       acceleration  b (dp - dp0(theta, pm)) - a1 omega + w
    alpha = b (dp - dp0) - a1 omega + w

and the inverse model along the plan, the feedforward:

    dp_r = dp0(theta_r, pm) + (alpha_r + a1 omega_r) / b
    o_r  = o0 + [(j_r' + a1 alpha_r' + a0 omega_r') / b + e omega_r'] / g

where ' is the plan as it will be when the opening has arrived, a lead later, and o0 holds the
pressures there in a valve that leaks.

With a known latency T between measurement and valve, a command meets the joint T later. The front
end remembers the openings that are on their way, lets the joint model go on under them over T,

    d2theta/dt2 = alpha,   d(dp)/dt = g (o - o0) - e omega - d (dp - dp0)

and tells the feedback where joint and plan will be then: the loop is that without latency, as far
as the model is right (a state predictor). A known lag tau of the pressure sensors is undone by the
same model, dp + tau d(dp)/dt, without differences of what is measured.

What is fed forward brakes with the inertia that is there, and loses what the hysteresis takes. Both
are learned in motion (`controllers.joint.learning`): b is divided by the one, what is lost is
multiplied by the other. The feedback keeps the b that its margins were found with.

A feedback that tolerates much integrates slowly. Where plan and joint rest, friction damps the
joint more than any model of its motion says, and the feedforward may integrate at a speed rho,

    d(held)/dt = rho (a0 / b) (theta_r - theta),   dp_r = ... + held

faded in over a time at rest and out with speed: margins are those of the joint in motion. Its rate
is fed forward too, so that the pressures follow at once.

What else than o0 holds the joint at rest is learned there, m, at a speed sigma: the centre of the
valve lies elsewhere than known. Its curve is bent, so that an opening asked for around a wrong
centre is wrong by far more than m; with the valve's curve f, the voltage for an opening o is

    f(o - m) + f(o0 + m) - f(o0)

which is f(o) at rest, where o = o0 + m: what is learned moves nothing there, and is no integrator.

w collects friction, muscle hysteresis and wrong loads. It is an acceleration, so the observer is
the same for every angle and load: what the map knows enters with the acceleration.

Units: SI.

Source: disturbance observer: Ohnishi, Shibata and Murakami, IEEE/ASME Trans. Mechatronics 1, 1996;
feedforward by the inverse model: Åström and Wittenmark, Computer-Controlled Systems, 1997, 6.3;
prediction over a delay: Manitius and Olbrot, IEEE Trans. AC-24, 1979.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, fields, replace
from typing import Any, NamedTuple, Protocol

from controllers.arithmetic import FLOATS, Arithmetic, Number, Numbers, Told
from controllers.joint.hysteresis_compensation import HysteresisCompensation
from controllers.joint.learning import Learned, MotionLearning
from controllers.joint.model import JointModel
from controllers.joint.observer import kalman_correction
from controllers.joint.schedule import JointSchedule
from controllers.reference.planned import Plan, Planner, PlannerState
from controllers.specification import Checked, number
from controllers.valve_inverse import ValveInverse, ValveLaw
from workbench.errors import check_range


class Context(NamedTuple):
    """What a feedback law is told at one sample.

    Args:
        angle: Measured angle, in rad.
        speed: Estimated speed, in rad/s.
        acceleration: Estimated acceleration, in rad/s2.
        unexplained: Estimated acceleration that the model does not explain, in rad/s2.
        reference_difference: Pressure difference of the feedforward, in Pa.
        opening: Opening of the feedforward, a fraction.
    """

    plan: Plan
    joint: JointModel
    angle: Number
    speed: Number
    acceleration: Number
    unexplained: Number
    difference: Number
    reference_difference: Number
    opening: Number


class Start(NamedTuple):
    """Rest, as a front end takes it.

    Args:
        holding: Acceleration by the measured pressure difference that something unknown withstands,
            in rad/s2, or the difference itself where the model knows nothing of inertia.
    """

    state: Any
    joint: JointModel
    holding: Number


class Tracking(Protocol):
    """The front end of a controller: plan, estimate, model."""

    def start(self, measurement: Numbers, arithmetic: Arithmetic = FLOATS) -> Start:
        """Take angle in rad and two gauge pressures in Pa as those of a joint at rest."""

    def context(
        self, state: Any, measurement: Numbers, reference: Number, arithmetic: Arithmetic
    ) -> tuple[Context, Any]:
        """Plan and estimate one sample; return what the feedback is told and the next state."""

    def sent(self, state: Any, opening: Number, arithmetic: Arithmetic = FLOATS) -> Any:
        """Remember an opening, a fraction, that is on its way, if it counts."""
        return state

    def command(
        self, valve: ValveInverse, state: Any, opening: Number, arithmetic: Arithmetic = FLOATS
    ) -> Number:
        """Return the voltage, in V, for an opening, a fraction: that of the valve's curve."""
        return valve.command(opening, arithmetic)


class TrackedLaw(ValveLaw):
    """A law along what its front end plans and estimates, which decides the valve's opening."""

    tracking: Tracking

    def feedback(
        self, state: Any, now: Context, arithmetic: Arithmetic
    ) -> tuple[Number, Any, Told]:
        """Compute one sample behind the front end.

        Returns:
            Opening, a fraction within -1..1; the next state, but for that of the front end; and
            what is told beside opening and plan.
        """
        raise NotImplementedError

    def law(
        self, state: Any, measurement: Numbers, reference: Numbers, arithmetic: Arithmetic
    ) -> tuple[Numbers, Any, Told]:
        front = self.tracking
        now, seen = front.context(state.tracking, measurement, reference[0], arithmetic)
        opening, following, told = self.feedback(state, now, arithmetic)
        seen = front.sent(seen, opening, arithmetic)
        command = front.command(self.valve, seen, opening, arithmetic)
        info = {"opening": opening, "plan": now.plan.angle, **told}
        return (command,), following._replace(tracking=seen), info


class AtRest(NamedTuple):
    """What a `JointTracking` knows from rest.

    Args:
        time: For how long plan and joint have rested, in s.
        held: Pressure difference that was integrated, in Pa.
        opening: Opening that holds the joint, beside that of the map, a fraction.
        known: Opening of the map at the measured angle, a fraction.
    """

    time: Number = 0.0
    held: Number = 0.0
    opening: Number = 0.0
    known: Number = 0.0


class TrackingState(NamedTuple):
    """What a `JointTracking` remembers.

    Args:
        angle: Predicted angle, in rad.
        speed: Predicted speed, in rad/s.
        unexplained: Acceleration that the model does not explain, in rad/s2.
        mean: Filtered mean pressure, in Pa.
        turn: Position in the loop of the compensated hysteresis, -1..1.
        sent: Openings that are on their way, fractions, the oldest first.
        rest: What is known from rest; None if nothing is learned there.
        learned: What is known from motion; None if nothing is learned there.
    """

    plan: PlannerState
    angle: Number
    speed: Number
    unexplained: Number
    difference: Number
    mean: Number
    turn: Number
    sent: Numbers = ()
    rest: AtRest | None = None
    learned: Learned | None = None


@dataclass(frozen=True, kw_only=True)
class TrackingOptions:
    """What a front end is told beside plan, model and observer.

    Args:
        lead: Time by which the opening of the feedforward leads the plan, in s: the lag of spool
            and sample, so that the move goes where it is planned.
        latency: Known time between measurement and valve that is predicted over, in s.
        sensor_lag: Known lag of the pressure sensors, in s.
        rest_integration: Speed of an integration where plan and joint rest, in 1/s; 0 for none.
        centring: Speed at which the valve's centre is learned where plan and joint rest, in 1/s; 0
            for none.
        hysteresis: Hysteresis of the muscles that is compensated along planned moves, whether it
            was fitted or is what such muscles have; None for none.
        learning: How inertia and hysteresis are learned in motion; None for not.
        sample_time: Time between steps, in s.
    """

    lead: float = number(0.0, 0.0, 0.1, "s", "lead of the feedforward")
    latency: float = 0.0
    sensor_lag: float = number(0.0, 0.0, 0.1, "s", "known lag of the pressure sensors")
    rest_integration: float = number(0.0, 0.0, 1e2, "1/s", "speed of the integration at rest")
    centring: float = number(0.0, 0.0, 1e2, "1/s", "speed of the valve's centring")
    hysteresis: HysteresisCompensation | None = None
    learning: MotionLearning | None = None
    sample_time: float = number(0.002, 1e-6, 1.0, "s")


@dataclass(frozen=True)
class JointTracking(TrackingOptions, Tracking):
    """Planner, observer and schedule of a joint.

    Args:
        schedule: Joint model over angle and mean pressure.
        correction: Gains of the observer for angle, speed and unexplained acceleration, in SI.
    """

    schedule: JointSchedule
    planner: Planner
    correction: tuple[float, float, float]
    pressure_filter: float = 0.002

    @property
    def on_their_way(self) -> int:
        """Number of openings between measurement and valve."""
        return round(self.latency / self.sample_time)

    def start(self, measurement: Numbers, arithmetic: Arithmetic = FLOATS) -> Start:
        angle, p1, p2 = measurement
        mean = 0.5 * (p1 + p2)
        joint = self.schedule.at(angle, mean, arithmetic)
        holding = joint.b * (p1 - p2 - joint.difference)
        state = TrackingState(
            self.planner.start(angle),
            angle,
            0.0,
            -holding,
            p1 - p2,
            mean,
            turn=0.0,
            sent=(0.0,) * self.on_their_way,
            rest=AtRest() if self.rest_integration or self.centring else None,
            learned=None
            if self.learning is None
            else self.learning.start(angle, p1 - p2 - joint.difference),
        )
        return Start(state, joint, holding)

    def context(
        self, state: TrackingState, measurement: Numbers, reference: Number, arithmetic: Arithmetic
    ) -> tuple[Context, TrackingState]:
        h = self.sample_time
        angle, p1, p2 = measurement
        plan, planner = self.planner.plan(state.plan, reference, arithmetic)
        fresh = h / (self.pressure_filter + h)
        filtered = state.difference + fresh * (p1 - p2 - state.difference)
        mean = state.mean + fresh * (0.5 * (p1 + p2) - state.mean)

        residual = angle - state.angle
        theta = state.angle + self.correction[0] * residual
        omega = state.speed + self.correction[1] * residual
        w = state.unexplained + self.correction[2] * residual
        if math.isfinite(self.planner.renewal):
            plan, planner = self.planner.renewed(planner, plan, angle, omega, arithmetic)
        joint = self.schedule.at(angle, mean, arithmetic)
        # What is not learned is that of the design: made for a heavier load it brakes that too.
        inertia, share, b = 1.0, 1.0, joint.b
        if state.learned is not None:
            inertia, share = state.learned.inertia, state.learned.hysteresis
            b = joint.b / inertia
        difference = filtered
        if self.sensor_lag:
            arrived = state.sent[0] if state.sent else 0.0
            difference = filtered + self.sensor_lag * joint.difference_rate(
                arrived, omega, filtered
            )
        alpha = b * (difference - joint.difference) - joint.a1 * omega + w
        if state.rest is not None:
            # What friction takes accelerates nothing, and is not compensated twice.
            alpha = alpha - b * state.rest.held
        now = plan
        if state.sent:
            now = self.planner.ahead(planner, plan, self.latency, arithmetic)
        planned = self.schedule.at(now.angle, mean, arithmetic)
        planned = planned._replace(b=planned.b / inertia)
        forward = planned.difference + (now.acceleration + planned.a1 * now.speed) / planned.b
        turn, losing = state.turn, 0.0
        if self.hysteresis is not None:
            turn = self.hysteresis.turned(turn, now.speed, h, arithmetic)
            lost = share * self.hysteresis.difference(turn, mean)
            losing = (lost - share * self.hysteresis.difference(state.turn, mean)) / h
            forward = forward + lost
            alpha = alpha - b * lost
        learned = None
        if state.learned is not None and self.learning is not None:
            learned = self.learning.step(
                state.learned,
                angle,
                difference - joint.difference,
                (plan.speed, mean),
                joint,
                self.hysteresis,
                arithmetic,
            )
        following = (
            theta + h * omega + 0.5 * h * h * alpha,
            omega + h * alpha,
            w,
            filtered,
            mean,
        )
        for opening in state.sent:
            angle = angle + h * omega + 0.5 * h * h * alpha
            rate = joint.difference_rate(opening, omega, difference)
            omega = omega + h * alpha
            alpha = alpha + h * (b * rate - joint.a1 * alpha - joint.a0 * omega)
            difference = difference + h * rate
        rest = None
        if state.rest is not None:
            rest = self._rest(state.rest, plan, measurement[0], following[1], joint, arithmetic)
            forward = forward + state.rest.held
            losing = losing + (rest.held - state.rest.held) / h
        then = now
        if self.lead:
            lead = self.latency + self.lead if state.sent else self.lead
            then = self.planner.ahead(planner, plan, lead, arithmetic)
        rate = (
            then.jerk + planned.a1 * then.acceleration + planned.a0 * then.speed
        ) / planned.b + (planned.e * then.speed + losing)
        opening = planned.opening + rate / planned.g
        context = Context(now, joint, angle, omega, alpha, w, difference, forward, opening)
        return context, TrackingState(planner, *following, turn, state.sent, rest, learned)

    def _rest(
        self,
        state: AtRest,
        plan: Plan,
        angle: Number,
        speed: Number,
        joint: JointModel,
        arithmetic: Arithmetic,
    ) -> AtRest:
        """Return for how long joint and plan have rested, and what was integrated meanwhile."""
        h = self.sample_time
        moving = arithmetic.largest(speed, -speed) + arithmetic.largest(plan.speed, -plan.speed)
        calm = arithmetic.clip(1.0 - moving / REST_SPEED, 0.0, 1.0)
        time = arithmetic.where(calm > 0.0, arithmetic.clip(state.time + h, 0.0, REST_TIME), 0.0)
        rate = self.rest_integration * calm * state.time / REST_TIME * joint.a0 / joint.b
        held = state.held + h * rate * (plan.angle - angle)
        held = arithmetic.clip(held, -HELD_LIMIT, HELD_LIMIT)
        return AtRest(time, held, state.opening, joint.opening)

    def sent(
        self, state: TrackingState, opening: Number, arithmetic: Arithmetic = FLOATS
    ) -> TrackingState:
        """Remember an opening, a fraction, that is on its way, and learn from it at rest."""
        if self.centring and state.rest is not None:
            rest = state.rest
            rate = self.sample_time * self.centring * rest.time / REST_TIME
            learned = rest.opening + rate * (opening - rest.known - rest.opening)
            learned = arithmetic.clip(learned, -LEARNED_LIMIT, LEARNED_LIMIT)
            state = state._replace(rest=rest._replace(opening=learned))
        if not state.sent:
            return state
        return state._replace(sent=(*state.sent[1:], opening))

    def command(
        self,
        valve: ValveInverse,
        state: TrackingState,
        opening: Number,
        arithmetic: Arithmetic = FLOATS,
    ) -> Number:
        """Return the voltage, in V, for an opening, a fraction, around the learned centre."""
        if not self.centring or state.rest is None:
            return valve.command(opening, arithmetic)
        learned, known = state.rest.opening, state.rest.known
        moved = valve.command(known + learned, arithmetic) - valve.command(known, arithmetic)
        voltage = valve.command(opening - learned, arithmetic) + moved
        reach = valve.full_stroke
        return arithmetic.clip(voltage, valve.centre - reach, valve.centre + reach)


def arrived_opening(there: Number, asked: Number, lag: float, sample_time: float) -> Number:
    """Return the opening, a fraction, that has arrived behind the lag one sample later.

    With dl/dt = (o - l) / tau and d(dp)/dt = g l, the pressure difference dp + tau g l, what is
    there and what is on its way, follows the opening o without the lag. A law that feeds it back in
    place of dp does not ask again for what is on its way (a predictor after Smith).

    Args:
        there: Opening l that has arrived, a fraction.
        asked: Opening o asked for now, a fraction.
        lag: Lag tau, in s; 0 for none.

    Source:
        Åström and Wittenmark, Computer-Controlled Systems, 1997, section 4.7 (predictors).

    Example:
        >>> round(arrived_opening(0.0, 1.0, 0.004, 0.002), 3)
        0.393
    """
    if lag <= 0.0:
        return 0.0 * asked
    fade = math.exp(-sample_time / lag)
    return fade * there + (1.0 - fade) * asked


REST_SPEED = 0.05
"""Speed from which a joint does not rest, in rad/s."""

REST_TIME = 0.05
"""Time at rest after which the integration at rest is whole, in s."""

LEARNED_LIMIT = 0.008
"""Largest opening that is learned as an offset of the valve, a fraction: 0.3 V."""

HELD_LIMIT = 1.5e5
"""Largest pressure difference from the integration at rest, in Pa."""

PRESSURE_RESERVE = 2.8e5
"""Pressure difference for accelerating along a planned move, in Pa."""

SHORTEST = 0.05
"""Shortest planned move, in s."""


@dataclass(frozen=True, kw_only=True)
class TrackingSpecification(Checked, TrackingOptions):
    """How moves are planned and the joint is observed: what every scheduled design is asked.

    Args:
        jerk_share: Share of the valve's opening that a planned move may use, a ratio.
        jerk_limit: Largest planned jerk, in rad/s3, whatever the joint could do: what feedforward
            for a light joint gets wrong if its load is heavier than known must stay within what
            feedback corrects.
        renewal: Duration from which a move is planned anew half way, from where the joint is, in
            s; 0 for never.
        reference_bandwidth: Bandwidth of the filter of a rough reference (quantised, held,
            noisy), in rad/s; 0 for a smooth one.
        reference_jump: Smallest step of a rough reference that is planned as a move, in rad.
        mean_pressure: Mean gauge pressure of the design, in Pa.
        angle_noise: Noise rms of the measured angle, in rad.
        acceleration_noise: Noise rms of the acceleration from the pressures, in rad/s2.
        acceleration_walk: Random walk of the unexplained acceleration, rms over 1 s, in rad/s2.
        unexplained_bandwidth: Bandwidth up to which the unexplained acceleration is believed, in
            rad/s, in the place of what the noises say; 0 for that. A load that swings on its own
            is unexplained too, and must not be compensated where its phase is unknown.
    """

    jerk_share: float = number(0.7, 0.01, 1.0, words="share of the opening for a planned move")
    jerk_limit: float = 1800.0
    renewal: float = number(0.0, 0.0, 1e3, "s", "duration of a renewed move")
    reference_bandwidth: float = 0.0
    reference_jump: float = 0.02
    mean_pressure: float = 3.8e5
    angle_noise: float = 2e-5
    acceleration_noise: float = 0.5
    acceleration_walk: float = 100.0
    unexplained_bandwidth: float = number(0.0, 0.0, 1e3, "rad/s", "believed bandwidth")

    def __post_init__(self) -> None:
        super().__post_init__()
        check_range("known latency", self.latency, 0.0, 50 * self.sample_time, "s")

    def planner(self, schedule: JointSchedule) -> Planner:
        """Return the planner of a joint.

        The planned jerk is a share of what the fully open valve does at the slowest angle, below
        a limit for light joints; the planned acceleration is what a reserve of pressure difference
        does.
        """
        models = schedule.models(self.mean_pressure)
        return Planner(
            jerk=min(self.jerk_limit, self.jerk_share * min(m.opening_to_jerk for m in models)),
            acceleration=PRESSURE_RESERVE * min(m.b for m in models),
            speed=self.jerk_share * min(m.g / m.e for m in models),
            shortest=SHORTEST,
            sample_time=self.sample_time,
            bandwidth=self.reference_bandwidth,
            renewal=self.renewal or math.inf,
            jump=self.reference_jump,
        )

    def tracking(self, schedule: JointSchedule) -> JointTracking:
        """Return planner and Kalman filter of a joint."""
        correction = kalman_correction(
            angle_noise=self.angle_noise,
            acceleration_noise=self.acceleration_noise,
            acceleration_walk=self.acceleration_walk,
            sample_time=self.sample_time,
        )
        if self.unexplained_bandwidth:
            # Speed follows at once; what is left of the residual turns into w at this rate.
            correction = (*correction[:2], self.unexplained_bandwidth * correction[1])
        told = {field.name: getattr(self, field.name) for field in fields(TrackingOptions)}
        told["learning"] = self.learning and replace(self.learning, sample_time=self.sample_time)
        return JointTracking(schedule, self.planner(schedule), correction, **told)
