"""What the equations of a model say of its ports: what each moves, fills, reads and follows from.

Everything is told from symbolic expressions, sampled at a few points where signs and equalities
cannot be read from them. No name of a state or signal is needed.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import cached_property
from itertools import combinations, permutations

import casadi as ca
import numpy as np

from workbench.arrays import Vector
from workbench.model import Model, Parameter, Port, State
from workbench.model.expressions import weight
from workbench.model.quantities import Quantity, declared_unit
from workbench.model.regularisation import Expression
from workbench.model.units import SPEEDS, per, same_dimension
from workbench.physics.place import Local, Place, largest

Points = list[tuple[Vector, Vector, Vector]]
"""States, inputs and parameters at which expressions are compared."""


class Ports:
    """The ports of a model by their number in its trace, and what a law can see there.

    Args:
        ranges: Smallest and largest value along the recordings, in SI, as of `RecordedFacts`.

    Example:
        >>> from workbench.plants.servo_axis import servo_axis
        >>> found = Ports(servo_axis())
        >>> [q.name for q in found.moved[found.port_index["axis.force"]]], found.integral
        (['speed'], {'speed': 'position'})
    """

    def __init__(
        self, model: Model, ranges: Mapping[str, tuple[float, float]] | None = None
    ) -> None:
        self.model, self.trace, self.ranges = model, model.exact, ranges or {}
        self.known: dict[str, Quantity] = {
            q.name: q for q in (*model.parameters, *model.inputs, *model.states)
        }
        said = model.quantities
        self._read = {name: declared_unit(name, q.unit, said) for name, q in self.known.items()}
        self.port_index = {q.name: i for i, q in enumerate(self.trace.ports)}
        self.state_index = {q.name: i for i, q in enumerate(model.states)}
        self.parameter_index = {q.name: i for i, q in enumerate(model.parameters)}

    def of(self, name: str) -> Local:
        """Return a state, input or parameter as a law sees it."""
        q = self.known[name]
        lower, upper = getattr(q, "lower", -math.inf), getattr(q, "upper", math.inf)
        start = getattr(q, "initial", getattr(q, "nominal", 0.0))
        seen = self.ranges.get(name)
        scale = q.scale if q.sized else largest(seen) or q.scale
        read = self._read[name]
        return Local(name, q.unit, scale, lower, upper, start, seen, read=read)

    def local(self, port: Port, signal: str, origin: str, unit: str = "") -> Local:
        """Return a local signal with what is known of it; by its unit where it is no state."""
        if origin in self.known:
            of = self.of(origin)
            # A prescribed signal of a test bench has no unit of its own.
            own = of.unit if of.unit != "1" or not unit else unit
            return replace(of, source=signal, unit=own)
        own = self.trace.signal_units[self.trace.signal_names.index(origin)] if origin else unit
        alike = next((q for q in self.model.states if own and q.unit == own), None)
        if alike is None:
            return Local(signal, own or "1")
        return Local(signal, own, alike.scale, alike.lower, alike.upper, alike.initial)

    def over(self, ahead: str, behind: str, ratio: float = 1.0) -> Local:
        """Return how far one state is from another, in the unit of that."""
        first, second = self.of(ahead), self.of(behind)
        found = Local(ahead, second.unit, minus=behind, ratio=ratio)
        seen = self.ranges.get(found.apart)
        scale = largest(seen) or max(ratio * first.scale, second.scale)
        return replace(found, scale=scale, seen=seen)

    def value(self, index: int) -> ca.SX:
        """Return the signal of a port, in SI."""
        return self.trace.signals[self.trace.signal_names.index(self.trace.ports[index].name)]

    def value_at(self, place: Place) -> ca.SX:
        """Return the signal of the port of a place, in SI."""
        return self.value(self.port_index[place.name])

    def symbol_of(self, q: Parameter) -> ca.SX:
        """Return a parameter of the model, in SI."""
        return self.trace.p[self.parameter_index[q.name]]

    def local_signals(self, index: int) -> dict[str, ca.SX]:
        """Return what a port sees beside its own signal, by name, in SI."""
        port, values = self.trace.ports[index], self.trace.local_signals[index]
        return {name: values[i] for i, name in enumerate(port.signals)}

    @cached_property
    def symbols(self) -> dict[str, ca.SX]:
        """States and inputs of the model, by name, in SI."""
        t, m = self.trace, self.model
        inputs = {q.name: t.u[i] for i, q in enumerate(m.inputs)}
        return inputs | {q.name: t.x[i] for i, q in enumerate(m.states)}

    @cached_property
    def parameters(self) -> dict[str, ca.SX]:
        """Parameters of the model, by name, in SI."""
        return {q.name: self.symbol_of(q) for q in self.model.parameters}

    @cached_property
    def _plain(self) -> Model:
        return self.model.without(*(e.name for e in self.model.effects))

    def rate_of(self, name: str) -> Local:
        """Return the rate of a state, as the equations have it without an effect."""
        q, k, own = self.known[name], self.state_index[name], self._plain

        # It goes to other processes with the law, as a model does and equations do not.
        def rate(known: Mapping[str, Expression], parameters: Mapping[str, Expression]) -> ca.SX:
            t = own.exact
            now = [known[q.name] for q in (*own.states, *own.inputs)]
            now += [parameters[p.name] for p in own.parameters]
            return ca.substitute(t.rates[k], ca.vertcat(t.x, t.u, t.p), ca.vcat(now))

        return Local(f"rate of {name}", per(q.unit, "s"), q.scale / self.model.horizon, of=rate)

    def expression(self, index: int, local: Local) -> ca.SX:
        """Return what a law sees at a port, in the unit of that."""
        return ca.SX(local.value(self.local_signals(index), self.symbols, self.parameters))

    def values(self, index: int, local: Local) -> Vector:
        """Sample what a law sees at a port."""
        return self.sampled(self.expression(index, local))

    def rate(self, index: int, local: Local) -> Vector:
        """Sample its derivative with time."""
        return self.sampled(
            ca.jtimes(self.expression(index, local), self.trace.x, self.trace.rates)
        )

    def push_rate(self, index: int, local: Local) -> Vector:
        """Sample what one of the port's signal adds to its derivative with time."""
        raised = self.trace.rates_by_port[:, index]
        return self.sampled(ca.jtimes(self.expression(index, local), self.trace.x, raised))

    def slope(self, index: int, local: Local) -> Vector:
        """Sample the slope of a port's signal over what is a bare signal there; 0 of any other."""
        symbol = self.expression(index, local)
        if not (symbol.is_symbolic() or (-symbol).is_symbolic()):
            return np.zeros(1)
        sign = 1.0 if symbol.is_symbolic() else -1.0
        return sign * self.sampled(ca.jacobian(self.value(index), sign * symbol))

    def raised(self, index: int) -> Vector:
        """Sample what one of a port's signal adds to the rates of the states."""
        return self.sampled(self.trace.rates_by_port[:, index])

    @cached_property
    def by_port(self) -> ca.SX:
        """Derivatives of rates and measurements by what each port adds, in SI."""
        return ca.vertcat(self.trace.rates_by_port, self.trace.outputs_by_port)

    def whole_slope(self, k: int) -> Vector:
        """Sample the derivatives of rates and measurements by a parameter."""
        t = self.trace
        return self.sampled(ca.jacobian(ca.vertcat(t.rates, t.outputs), t.p[k]))

    def rates_of(self, index: int) -> list[int]:
        """Return the states whose rate a port changes."""
        raised = self.trace.rates_by_port[:, index]
        return [k for k in range(raised.numel()) if not raised[k].is_zero()]

    @cached_property
    def integral(self) -> dict[str, str]:
        """Name of the state whose rate is a state, by the name of that."""
        names = [q.name for q in self.model.states]
        found: dict[str, str] = {}
        for i, name in enumerate(names):
            for j, speed in enumerate(names):
                if ca.is_equal(self.trace.rates[i], self.trace.x[j], 3) and "." not in name:
                    found.setdefault(speed, name)
        return found

    @property
    def moving(self) -> set[str]:
        """Names of states that are a place, or its speed."""
        return {name for pair in self.integral.items() for name in pair}

    @cached_property
    def measured(self) -> dict[str, str]:
        """Name of the state that each output measures, by the output's name."""
        found: dict[str, str] = {}
        for i, output in enumerate(self.model.outputs):
            for j, state in enumerate(self.model.states):
                if ca.is_equal(self.trace.outputs[i], self.trace.x[j], 3):
                    found[output.name] = state.name
        return {q.name: q.name for q in self.model.outputs if q.name in self.known} | found

    @cached_property
    def moved(self) -> tuple[tuple[State, ...], ...]:
        """States of the plant whose rates the signal of each port enters at once."""
        matrix = self.trace.rates_by_port
        own = [(i, q) for i, q in enumerate(self.model.states) if "." not in q.name]
        return tuple(
            tuple(q for i, q in own if not matrix[i, j].is_zero())
            for j in range(len(self.trace.ports))
        )

    @cached_property
    def pushed(self) -> Vector:
        """Slopes of the rates by the ports at the start, shape (n_states, n_ports)."""
        matrix = self.trace.function("by_port", self.trace.rates_by_port)
        x, u = self.model.initial_state(), self.model.nominal_input
        return np.asarray(matrix(x, u, self.model.values))

    def whole(self, index: int) -> bool:
        """Tell whether the rates that a port drives are proportional to its signal."""
        moved = self.moved[index]
        if len(moved) != 1:
            return False
        i = self.state_index[moved[0].name]
        share = self.trace.rates_by_port[i, index] * self.value(index)
        return same(self.sampled(share), self.sampled(self.trace.rates[i]))

    def alone(self, index: int) -> tuple[str, float]:
        """Return the only state that a port moves, and whether more of the signal raises it.

        Returns:
            Its name, empty if there are none or several, and 1 or -1, a factor.
        """
        if len(self.moved[index]) != 1:
            return "", 1.0
        name = self.moved[index][0].name
        slope = self.pushed[self.state_index[name], index]
        return (name, float(np.sign(slope))) if slope else ("", 1.0)

    @cached_property
    def filled(self) -> tuple[tuple[State, ...], ...]:
        """States that each port fills: those it moves, if more of it raises every one of them."""
        at = self.pushed
        return tuple(
            moved if all(at[self.state_index[q.name], j] > 0 for q in moved) else ()
            for j, moved in enumerate(self.moved)
        )

    def between_bodies(self, index: int) -> bool:
        """Tell whether a port that no input enters drives one body on and another one back."""
        pushes = self.pushed[[self.state_index[q.name] for q in self.moved[index]], index]
        return not any(self.entered[index]) and bool((pushes > 0).any() and (pushes < 0).any())

    @cached_property
    def collocated(self) -> dict[int, str]:
        """Return the speed that each of several commands works on, where all move all bodies.

        Of two forces each raises the speed of the other as much as the other raises its own (E.
        Betti 1872): the inverse of a mass matrix is symmetric.
        """
        names = list(self.state_index)
        speeds = {
            i: [self.state_index[q.name] for q in self.moved[i] if q.name in self.integral]
            for i in self.commanded
        }
        found: dict[int, str] = {}
        for i, j in combinations([i for i, own in speeds.items() if len(own) > 1], 2):
            ways = [
                (a, b)
                for a, b in permutations(sorted({*speeds[i], *speeds[j]}), 2)
                if same(self.raised(i)[:, b], self.raised(j)[:, a])
            ]
            if len(ways) == 1:
                found |= {i: names[ways[0][0]], j: names[ways[0][1]]}
        return found

    def emptied(self, index: int) -> str:
        """Return the level that drives a flow and falls with it; empty if there is none."""
        value, raised = self.value(index), self.raised(index)
        for i, q in enumerate(self.model.states):
            if "." in q.name or not ca.depends_on(value, self.trace.x[i]):
                continue
            if np.nanmedian(raised[:, i]) < 0.0:
                return q.name
        return ""

    @cached_property
    def entered(self) -> tuple[tuple[bool, ...], ...]:
        """Whether each input enters the signal of each port at once."""
        ports, inputs = range(len(self.trace.ports)), range(len(self.model.inputs))
        slopes = [ca.jacobian(self.value(i), self.trace.u) for i in ports]
        return tuple(tuple(not slope[k].is_zero() for k in inputs) for slope in slopes)

    @cached_property
    def commanded(self) -> set[int]:
        """Ports that follow from inputs alone, the first of each input."""
        found: set[int] = set()
        taken: set[int] = set()
        for i in range(len(self.trace.ports)):
            if ca.depends_on(self.value(i), self.trace.x):
                continue
            slope = ca.jacobian(self.value(i), self.trace.u)
            inputs = {k for k in range(self.trace.u.numel()) if not slope[0, k].is_zero()}
            if inputs - taken:
                found.add(i)
            taken |= inputs
        return found

    def weighing(self, index: int) -> dict[str, float]:
        """Return the start, in SI, of what changes the divisor of a port's whole signal."""
        t, m = self.trace, self.model
        found = weight(ca.SX(self.value(index)), ca.vertcat(t.x, t.u))
        start = {q.name: q.nominal for q in m.inputs} | {q.name: q.initial for q in m.states}
        if found is None:
            return {}
        first = t.function("weight", found)(m.initial_state(), m.nominal_input, m.values)
        return start if float(first) and math.isfinite(float(first)) else {}

    def is_current(self, state: State) -> bool:
        """Tell whether a state is a current: in amperes, or one whose integral is a state too."""
        # A motor without inductance: its voltage is a torque, which has a port of its own.
        moves = same_dimension(state.unit, *SPEEDS)
        return not moves and (state.name in self.integral or state.unit == "A")

    def sampled(self, expression: ca.SX, points: Points | None = None) -> Vector:
        """Evaluate an expression at some points, shape (n_points, n), in its unit."""
        function = self.trace.function("sampled", ca.SX(expression))
        return np.array([np.asarray(function(*at)).ravel() for at in points or self.points])

    @cached_property
    def usual(self) -> Points:
        """Those points with the values of what is not fitted, such as the ratio of a gear."""
        fitted = np.array([q.fitted for q in self.model.parameters], dtype=bool)
        return [(x, u, np.where(fitted, p, self.model.values)) for x, u, p in self.points]

    @cached_property
    def points(self) -> Points:
        """Some states, inputs and parameters about the usual ones, by a fixed rule."""
        m, rng = self.model, np.random.default_rng(1)
        x = np.array([q.initial for q in m.states], dtype=float)

        def around(quantities: Sequence[Quantity], usual: Vector) -> Vector:
            scales = np.array([q.scale for q in quantities], dtype=float)
            return np.asarray(usual + scales * rng.uniform(0.2, 0.8, usual.size))

        return [
            (
                around(m.states, x),
                around(m.inputs, m.nominal_input),
                m.values * rng.uniform(0.9, 1.1, m.values.size),
            )
            for _ in range(3)
        ]


def same(a: Vector, b: Vector) -> bool:
    """Tell whether two samples agree wherever both are numbers, and are not nothing."""
    known = np.isfinite(a) & np.isfinite(b)
    size = np.max(np.abs(b[known]), initial=0.0)
    return bool(known.any() and size > 0.0 and np.all(np.abs(a - b)[known] <= 1e-9 * size))
