"""The physical limit: the time-optimal move of a plant, which no controller can beat.

No controller settles faster than the plant allows. The limit is the time-optimal move between two
positions of the full plant, found by direct collocation on the regularised equations with free
durations T of the move and S of the stay after it:

    minimise T   subject to   dx/dt = f(x, u),  u in its range, held over each interval
                              x(0) = rest at the first position
                              lower stop <= position <= upper stop
                              |position - target| <= band                   from T to T + S
                              speed = 0, acceleration = 0, jerk next to none at T + S

From T on the plant is within the band of a settling time for good, for it comes to rest there and
its forces balance. The stops may not be used as brakes. T is the lower bound of the settling time
itself.

Each interval is a polynomial through Radau points; states are counted in their scales, times in
that in which a command that is held at an end of its range moves the plant half the way. Inputs are
held over an interval, which makes the time found too long, by about two intervals.

Source: Betts, Practical Methods for Optimal Control and Estimation Using Nonlinear Programming,
2010, chapters 4 (collocation) and 3.7 (phases); Waechter and Biegler, Mathematical Programming 106,
2006 (the interior-point solver).
"""

from __future__ import annotations

import hashlib
import io
import math
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import casadi as ca
import numpy as np
import scipy

from workbench.arrays import Vector
from workbench.computing.machine_code import cache_folder
from workbench.errors import TIMES_S, NumericalError, WorkbenchError, check_choice, check_range
from workbench.files import write_whole
from workbench.model import Model
from workbench.model.units import from_si, in_time
from workbench.operating_point import OperatingPoint, operating_point
from workbench.simulation.stepper import Stepper
from workbench.verification.repeated_equations import RepeatedEquations, program
from workbench.verification.responses import BAND

_FORMULATION = "3"
_SHORTEST, _LONGEST = 0.05, 100.0
"""Bounds of both phases, in times that a held command takes for half the move."""

_JERK = 1e-3
"""Jerk that counts as none, in lengths of the move over that time cubed; on the way it is more."""

_COLDEST, _HOTTEST = 0.5, 4.0
"""What a temperature may become, in that at the start, so that a search stays among real gases."""

_BISECTIONS = 8


@dataclass(frozen=True)
class PhysicalLimit:
    """The fastest move of a plant between two resting positions.

    Args:
        seconds: The limit: time until the plant is within the band for good, in s.
        begin: Position at the start, in ``unit``.
        end: Position at the end, in ``unit``.
        band: Half-width of the band about the final position, in ``unit``.
        time: Ends of the intervals from 0 to the end of the last phase, shape (n + 1,), in s.
        states: States there, shape (n + 1, n_states), in SI.
        inputs: Inputs held over each interval, shape (n, n_inputs), in SI.
        position_error: Largest distance of the position on the exact plant, driven by the same
            inputs, from ``states``, in ``unit``.
        end_error: Distance of the position at the end on the exact plant from that in ``states``,
            in ``unit``.
        end_speed: Speed left at the end on the exact plant, in ``unit`` per second.
    """

    seconds: float
    begin: float
    end: float
    band: float
    time: Vector
    states: Vector
    inputs: Vector
    status: str
    iterations: int
    position_error: float
    end_error: float
    end_speed: float
    unit: str

    def __str__(self) -> str:
        unit = "deg" if self.unit == "rad" else self.unit

        def shown(value: float) -> float:
            return float(from_si(value, unit))

        rows = [
            ("inside for good", in_time(self.seconds, 4)),
            ("band", f"+-{shown(self.band):.3g} {unit}"),
            ("solver", f"{self.status}, {self.iterations} iterations"),
            ("exact plant, off the path by", f"{shown(self.position_error):.2g} {unit}"),
            ("exact plant, off the end by", f"{shown(self.end_error):.2g} {unit}"),
            ("exact plant, speed at the end", f"{shown(self.end_speed):.2g} {unit}/s"),
        ]
        head = f"physical limit, {shown(self.begin):g} to {shown(self.end):g} {unit}"
        return "\n".join([head, *(f"  {name:<32} {value}" for name, value in rows)])


def physical_limit(
    model: Model,
    begin: float,
    end: float,
    *,
    intervals: int = 64,
    degree: int = 3,
    coordinate: str = "",
) -> PhysicalLimit:
    """Find the fastest move of a plant between two resting positions.

    The result is kept on disk, by the content of the equations, the parameters and the arguments.

    Args:
        begin: Position at rest before the move, in SI.
        end: Position after it, in SI.
        intervals: Number of intervals of the move; the stay has a quarter as many.
        degree: Radau points per interval, 2 to 5.
        coordinate: Name of the state that moves, the rate of which is a state, or of the output
            that shows it; the first output that does by default.

    Raises:
        NumericalError: If the solver does not converge.
    """
    names = [q.name for q in model.states]
    shown = (shown_state(model, q.name) for q in model.outputs)
    coordinate = coordinate or next((name for name in shown if name), names[0])
    coordinate = shown_state(model, coordinate) or coordinate
    check_choice("coordinate", coordinate, names)
    velocity = velocity_of(model, coordinate)
    if velocity is None:
        raise WorkbenchError(
            f"the rate of {coordinate!r} is no state of the plant, so there is no move between"
            " positions at rest; name a coordinate that has a speed"
        )
    check_range("number of intervals", intervals, 8, 1000)
    check_range("number of Radau points", degree, 2, 5)
    distance = abs(float(end) - float(begin))
    if not distance > 1e-9 * max(abs(float(begin)), abs(float(end))):
        raise WorkbenchError(
            f"the move from {begin:g} to {end:g} goes nowhere; give two different positions"
        )
    start = operating_point(model, {coordinate: begin})
    problem = _Problem(
        model,
        start,
        float(end),
        BAND * distance,
        (int(intervals), int(intervals) // 4),
        int(degree),
        names.index(coordinate),
        names.index(velocity),
    )
    path = cache_folder() / f"limit-{problem.key()}.npz"
    found = _read(path)
    if found is None:
        found = problem.solve()
        _write(path, found)
    return problem.validated(found)


def shown_state(model: Model, name: str) -> str | None:
    """Return the state of a name, or the one that the output of that name shows as it is."""
    states, outputs = [q.name for q in model.states], [q.name for q in model.outputs]
    if name in states or name not in outputs:
        return name if name in states else None
    traced = model.exact
    expression = traced.outputs[outputs.index(name)]
    same = (s for i, s in enumerate(states) if ca.is_equal(expression, traced.x[i]))
    return next(same, None)


def velocity_of(model: Model, coordinate: str) -> str | None:
    """Return the state that is the rate of another one, or None."""
    names = [q.name for q in model.states]
    if coordinate not in names:
        return None
    traced = model.exact
    slope = ca.jacobian(traced.rates[names.index(coordinate)], traced.x)
    columns = slope.sparsity().get_col()
    if len(columns) != 1 or not slope.nonzeros()[0].is_one():
        return None
    return str(names[columns[0]])


@dataclass(frozen=True)
class _Problem:
    """One time-optimal move, written as a nonlinear program in scaled variables."""

    model: Model
    start: OperatingPoint
    target: float
    band: float
    intervals: tuple[int, int]
    degree: int
    coordinate: int
    velocity: int

    @property
    def scale(self) -> Vector:
        return np.array([q.scale for q in self.model.states])

    @property
    def ends(self) -> Vector:
        """Ends of the inputs, shape (n_inputs, 2), in SI; what nobody commands stays as it is."""
        return np.array(
            [
                (q.lower, q.upper) if q.commanded else (u, u)
                for q, u in zip(self.model.inputs, self.start.u, strict=True)
            ]
        )

    def key(self) -> str:
        """Return a hash of everything that the result depends on."""
        digest = hashlib.sha256()
        for part in (
            _FORMULATION,
            ca.CasadiMeta.version(),
            self.model.regularised.rates_function.serialize(),
            self.model.values.tobytes(),
            self.start.x.tobytes(),
            repr(self.ends.tolist()),
            repr((self.target, self.band, self.intervals, self.degree)),
            repr((self.coordinate, self.velocity)),
            self.scale.tobytes(),
        ):
            digest.update(part if isinstance(part, bytes) else part.encode())
        return digest.hexdigest()[:32]

    @cached_property
    def pace(self) -> float:
        """Time in which a command held at an end of its range covers half the move, in s."""
        ends = self.ends
        sizes = np.array([q.scale for q in self.model.inputs])
        held = np.tile(self.start.u, (2 * len(ends), 1))
        for i, (low, high) in enumerate(ends):
            held[2 * i, i] = low if np.isfinite(low) else self.start.u[i] - sizes[i]
            held[2 * i + 1, i] = high if np.isfinite(high) else self.start.u[i] + sizes[i]
        c, way = self.coordinate, 0.5 * (self.target - self.start.x[self.coordinate])

        def covered(time: float) -> bool:
            stepper = Stepper(self.model, time)
            reached = [stepper.run_as_far(self.start.x, u[None, :]) for u in held]
            moved = [(x[-1, c] - self.start.x[c]) / way for x in reached if len(x)]
            return not moved or max(moved) >= 1.0

        low, high = TIMES_S[0], 2.0 * TIMES_S[0]
        while not covered(high) and high < 0.5 * TIMES_S[1]:
            low, high = high, 2.0 * high
        for _ in range(_BISECTIONS):
            middle = math.sqrt(low * high)
            low, high = (low, middle) if covered(middle) else (middle, high)
        return high

    def _functions(self) -> tuple[ca.Function, ca.Function]:
        """Return the rates, and (speed, acceleration, jerk), as functions of (z, u).

        States are in their scales, times in `pace`, motions in lengths of the move.
        """
        traced = self.model.regularised
        size = self.scale
        z = ca.SX.sym("z", len(size))
        rates = ca.substitute(
            ca.vertcat(traced.rates),
            ca.vertcat(traced.x, traced.p),
            ca.vertcat(z * size, self.model.values),
        )
        acceleration = rates[self.velocity]
        jerk = ca.jtimes(acceleration, z, rates / size)
        motion = ca.vertcat(z[self.velocity] * size[self.velocity], acceleration, jerk)
        unit = np.abs(self.target - self.start.x[self.coordinate])
        motion = motion * ca.DM(self.pace ** np.arange(1, 4) / unit)
        scaled = ca.cse(self.pace * rates / size)
        return (
            ca.Function("rates", [z, traced.u], [scaled]),
            ca.Function("motion", [z, traced.u], [ca.cse(motion)]),
        )

    def _program(self) -> tuple[dict[str, Any], dict[str, ca.Function]]:
        """Return the program, whose variables are times, ends, points and inputs of intervals."""
        rates, motion = self._functions()
        n_x, n_u, d = len(self.scale), len(self.model.inputs), self.degree
        n_t, total = len(self.intervals), sum(self.intervals)
        nodes, points = n_t, n_t + n_x * (total + 1)
        inputs = points + n_x * d * total
        size = inputs + n_u * total
        derivative, end, _ = ca.collocation_coeff(ca.collocation_points(d, "radau"))
        # One interval: the collocation equations of states at its points, and its end.
        z, u, h = ca.SX.sym("z", n_x, 1 + d), ca.SX.sym("u", n_u), ca.SX.sym("h")
        slopes = z @ derivative
        defects = [slopes[:, j] - h * rates(z[:, 1 + j], u) for j in range(d)]
        k = np.arange(total)[:, None]
        parts = [nodes + n_x * k + np.arange(n_x), points + n_x * d * k + np.arange(n_x * d)]
        parts += [inputs + n_u * k + np.arange(n_u)]
        # The step of an interval is its part of the time of a phase.
        phases = np.repeat(np.arange(n_t), self.intervals)[:, None]
        columns = np.hstack([*parts, phases])
        factors = np.ones(columns.shape)
        factors[:, -1] = 1.0 / np.repeat(self.intervals, self.intervals)
        n_r = n_x * (1 + d)
        interval = RepeatedEquations(
            ca.vertcat(ca.vec(z), u, h),
            ca.vertcat(*defects, z @ end),
            columns,
            factors,
            n_r * k + np.arange(n_r),
        )
        # It ends at rest.
        there = np.r_[nodes + n_x * total + np.arange(n_x), parts[2][-1]][None]
        resting = n_r * total + np.arange(3)[None]
        z, u = ca.SX.sym("z", n_x), ca.SX.sym("u", n_u)
        rest = RepeatedEquations(
            ca.vertcat(z, u), motion(z, u), there, np.ones(there.shape), resting
        )
        # Each interval ends where the next one begins; the stay is no longer than half the move.
        linear = scipy.sparse.lil_matrix((n_r * total + 4, size))
        ends = (n_r * k + n_x * d + np.arange(n_x)).ravel()
        linear[ends, nodes + n_x + np.arange(n_x * total)] = -1.0
        linear[-1, :2] = [-0.5, 1.0]
        variables = ca.MX.sym("variables", size)
        # A little of the stay, so that its length is determined.
        least = ca.dot(ca.DM([1.0, 1e-3]), variables[:n_t])
        return program(variables, least, (interval, rest), linear)

    def solve(self) -> dict[str, Any]:
        """Solve the program and return what is kept on disk."""
        problem, derivatives = self._program()
        guess, lower, upper = self._guess_and_bounds()
        # The jerk of a plant whose input is a force rests with the acceleration: as an equation it
        # would say the same twice.
        limit = np.zeros(problem["g"].numel())
        limit[-2] = _JERK
        floor = -limit
        # A short stay: the band is kept at the points only, and long intervals would leave it.
        floor[-1] = -np.inf
        # The first is faster, the second gets through where the first runs in circles.
        for strategy in ("adaptive", "monotone"):
            solver = ca.nlpsol("limit", "ipopt", problem, _options(strategy) | derivatives)
            result = solver(x0=guess, lbx=lower, ubx=upper, lbg=floor, ubg=limit)
            stats = solver.stats()
            status = str(stats["return_status"])
            if stats["success"]:
                break
        else:
            raise NumericalError(
                f"the time-optimal move did not converge ({status} after"
                f" {stats['iter_count']} iterations); take more intervals, a move that keeps clear"
                " of the stops, or a plant without effects of memory such as hysteresis"
            )
        x = np.asarray(result["x"]).ravel()
        n_x, n_u, total = len(self.scale), len(self.model.inputs), sum(self.intervals)
        n_t, n_z = len(self.intervals), n_x * (total + 1)
        return {
            "times": self.pace * x[:n_t],
            "states": x[n_t : n_t + n_z].reshape(total + 1, n_x) * self.scale,
            "inputs": x[len(x) - n_u * total :].reshape(total, n_u),
            "status": status,
            "iterations": int(stats["iter_count"]),
        }

    def _guess_and_bounds(self) -> tuple[Vector, ...]:
        model, size, d = self.model, self.scale, self.degree
        move, total = self.intervals[0], sum(self.intervals)
        x0, c = self.start.x, self.coordinate
        low = np.array([q.lower for q in model.states]) / size
        high = np.array([q.upper for q in model.states]) / size
        states = [q.name for q in model.states]
        # On a fast move a state may pass what holds it at rest, a stop it may not.
        for name, least, most in model.traits.limits:
            i = states.index(name)
            low[i] = 0.9 * model.bound(least) / size[i]
            high[i] = 1.2 * model.bound(most) / size[i]
        for i, q in enumerate(model.states):
            if q.unit == "K":
                low[i] = max(q.lower, _COLDEST * x0[i]) / size[i]
                high[i] = min(q.upper, _HOTTEST * x0[i]) / size[i]
        for name, least, most in model.traits.stops:
            i = states.index(name)
            low[i] = min(model.bound(least), x0[i]) / size[i]
            high[i] = max(model.bound(most), x0[i]) / size[i]
        band = (np.array([-1.0, 1.0]) * self.band + self.target) / size[c]
        # Nodes and points in order of time: (node, points of its interval), then the last node.
        nodes_low, nodes_high = np.tile(low, (total + 1, 1)), np.tile(high, (total + 1, 1))
        points_low, points_high = np.tile(low, (d * total, 1)), np.tile(high, (d * total, 1))
        nodes_low[0] = nodes_high[0] = x0 / size
        nodes_low[move:, c], nodes_high[move:, c] = band
        points_low[d * move :, c], points_high[d * move :, c] = band
        times = np.array([4.0, 1.0])
        s = np.minimum(np.arange(total + 1) / move, 1.0)
        path = s**3 * (10 - 15 * s + 6 * s**2)
        reach = self.target - x0[c]
        nodes = np.tile(x0 / size, (total + 1, 1))
        nodes[:, c] = (x0[c] + reach * path) / size[c]
        slope = 30 * s**2 * (1 - s) ** 2 * reach / (self.pace * times[0])
        nodes[:, self.velocity] = slope / size[self.velocity]
        points = np.repeat(nodes[1:], d, axis=0)
        u_low, u_high = self.ends.T
        rest = np.clip(self.start.u, u_low, u_high)
        wave = np.zeros(total)
        wave[:move] = np.where(np.arange(move) < 0.5 * move, 1.0, -1.0) * np.sign(reach)
        usual = np.array([q.scale for q in model.inputs])
        span = np.where(np.isfinite(u_high - u_low), 0.25 * (u_high - u_low), usual)
        u = rest + wave[:, None] * span
        guess = (times, nodes, points, u)
        lower = (np.full(2, _SHORTEST), nodes_low, points_low, np.tile(u_low, total))
        upper = (np.full(2, _LONGEST), nodes_high, points_high, np.tile(u_high, total))
        return tuple(np.concatenate([p.ravel() for p in parts]) for parts in (guess, lower, upper))

    def validated(self, found: dict[str, Any]) -> PhysicalLimit:
        """Drive the exact plant with the found inputs and measure how far it strays."""
        c, v = self.coordinate, self.velocity
        parts, steps = [self.start.x[None, :]], [0.0]
        for seconds, count in zip(found["times"], self.intervals, strict=True):
            step, done = float(seconds) / count, len(steps) - 1
            stepper = Stepper(self.model, step, tolerance=1e-8)
            parts.append(stepper.run(parts[-1][-1], found["inputs"][done : done + count]))
            steps += [step] * count
        driven = np.vstack(parts)
        stray = np.abs(driven[:, c] - found["states"][:, c])
        return PhysicalLimit(
            seconds=float(found["times"][0]),
            begin=float(self.start.x[c]),
            end=self.target,
            band=self.band,
            time=np.cumsum(steps),
            states=found["states"],
            inputs=found["inputs"],
            status=str(found["status"]),
            iterations=int(found["iterations"]),
            position_error=float(stray.max()),
            end_error=float(stray[-1]),
            end_speed=float(abs(driven[-1, v])),
            unit=self.model.states[c].unit,
        )


def _options(strategy: str) -> dict[str, Any]:
    own = {"print_level": 0, "sb": "yes", "max_iter": 500, "tol": 1e-6, "mu_strategy": strategy}
    return {"error_on_fail": False, "print_time": False, "ipopt": own}


def _read(path: Path) -> dict[str, Any] | None:
    try:
        with np.load(path, allow_pickle=False) as stored:
            return {n: stored[n] for n in ("times", "states", "inputs", "status", "iterations")}
    except (OSError, ValueError, KeyError, EOFError):
        # Not there, or not readable: it is computed anew.
        return None


def _write(path: Path, found: dict[str, Any]) -> None:
    buffer = io.BytesIO()
    np.savez_compressed(buffer, **found)
    write_whole(path, buffer.getvalue())
