"""The model: named quantities and equations with ports, to which effects attach."""

from __future__ import annotations

import copy
from collections.abc import Callable, Collection, Hashable, Iterable, Mapping, Sequence
from dataclasses import dataclass, fields, replace
from functools import cached_property
from operator import attrgetter
from typing import TypeVar

import casadi as ca
import numpy as np
import numpy.typing as npt

from workbench.arrays import Vector
from workbench.display import Rows, Shown
from workbench.errors import WorkbenchError, check_choice, check_finite
from workbench.model.effect import Effect
from workbench.model.own_units import in_si_equations
from workbench.model.quantities import (
    Input,
    Output,
    Parameter,
    Quantity,
    State,
    combined_unit,
    declared_unit,
)
from workbench.model.regularisation import EXACT, REGULARISED, Form
from workbench.model.scope import Port
from workbench.model.sizes import horizon, missing, poles_of, silent, sized, sizes
from workbench.model.trace import Equations, Named, Trace, trace
from workbench.model.traits import Bound, Traits
from workbench.model.units import of_difference, readably, same_dimension, with_unit

Own = TypeVar("Own", State, Parameter)

_KEPT = 16
"""How many models with effects attached are kept with the one that they were attached to."""

_FARTHER = 10.0
"""Factor by which an output goes beyond the size that equations promise where they are wrong."""


@dataclass(frozen=True, repr=False)
class Model(Shown):
    """A plant: states, inputs, outputs, parameters and the equations that join them.

    ``equations`` takes a `Scope` and returns two mappings: the rate of every own state and the
    measurement of every output; or the rates alone, where each output is the state with its name.
    Whatever passes through ``scope.port`` can be changed by an effect.

    Args:
        equations: The equations, written with the names of a `Scope`.
        states: States, those of attached effects last.
        parameters: Parameters, those of attached effects last.
        effects: Attached effects, in the order in which they act on a port.
        traits: What general rooms may know of the plant beside its equations.
        time: Unit in which the equations count time, where that is not the second and the units of
            their quantities do not tell it.

    Example:
        >>> def equations(m):
        ...     force = m.port("axis.force", m.u.force, unit="N", signals={"speed": m.x.speed})
        ...     return {"position": m.x.speed, "speed": force / m.p.mass}, {"sensed": m.x.position}
        >>> axis = Model(
        ...     "axis",
        ...     equations,
        ...     states=(State("position", "m"), State("speed", "m/s")),
        ...     inputs=(Input("force", "N"),),
        ...     outputs=(Output("sensed", "m"),),
        ...     parameters=(Parameter("mass", "kg", value=2.0, lower=0.1),),
        ... )
        >>> axis.rates([0.0, 1.0], [4.0])
        array([1., 2.])
    """

    name: str
    equations: Callable[..., Equations | Named]
    states: tuple[State, ...]
    inputs: tuple[Input, ...]
    outputs: tuple[Output, ...]
    parameters: tuple[Parameter, ...] = ()
    effects: tuple[Effect, ...] = ()
    description: str = ""
    traits: Traits = Traits()
    time: str = ""

    def __post_init__(self) -> None:
        for group in (self.states, self.inputs, self.outputs, self.parameters):
            names = [q.name for q in group]
            double = sorted({n for n in names if names.count(n) > 1})
            if double:
                raise WorkbenchError(f"model {self.name!r} uses the name {double[0]!r} twice")
        kinds = ("states", "inputs", "outputs", "parameters")
        groups = {kind: getattr(self, kind) for kind in kinds}
        equations = in_si_equations(self.equations, groups, self.time)
        object.__setattr__(self, "equations", equations)
        read = {q.name: q.display_unit for q in self.outputs if q.display_unit != q.unit}
        states = tuple(
            replace(q, display_unit=read[q.name])
            if q.name in read and not q.display_unit and same_dimension(read[q.name], q.unit)
            else q
            for q in self.states
        )
        object.__setattr__(self, "states", states)
        _ = self.exact
        if missing((self.states, self.inputs, self.outputs), self.exact, dict(self.traits.scales)):
            self._find_sizes()

    def _find_sizes(self) -> None:
        """Give a size to what declares none, and write the equations down again with it."""
        x = np.array([q.initial for q in self.states], dtype=float)
        u, p = self.nominal_input, self.values
        of_x, of_u, of_y, of_ports = sizes(self.exact, self.states, self.inputs, x, u, p)
        y = np.asarray(self.exact.outputs_function(x, u, p), dtype=float).ravel()
        scales = {**of_ports, **dict(self.traits.scales)}
        changed = {
            "states": sized(self.states, of_x, x),
            "inputs": sized(self.inputs, of_u, u),
            "outputs": sized(self.outputs, of_y, y),
            "traits": replace(self.traits, scales=tuple(scales.items())),
        }
        for name, value in changed.items():
            object.__setattr__(self, name, value)
        self._traces.clear()
        _ = self.exact

    @cached_property
    def _traces(self) -> dict[Form, Trace]:
        """Return the equations as they were written down so far; other values share them."""
        return {}

    @cached_property
    def _extended(self) -> dict[tuple[Hashable, ...], Model]:
        """Return the last models with effects attached to these equations, whatever the values."""
        return {}

    @property
    def exact(self) -> Trace:
        """The equations with their kinks, for verification."""
        return self._written(EXACT)

    @property
    def regularised(self) -> Trace:
        """The equations with rounded kinks, for prediction and derivatives."""
        return self._written(REGULARISED)

    def _written(self, form: Form) -> Trace:
        if form not in self._traces:
            self._traces[form] = trace(self, form)
        return self._traces[form]

    @cached_property
    def horizon(self) -> float:
        """Time in which the response shows at the start, without dry effects at rest, in s."""
        model = self._without(self.dry_effects)
        traced = model.regularised
        slopes = traced.function("slopes", ca.densify(ca.jacobian(traced.rates, traced.x)))
        found = np.asarray(slopes(model.initial_state(), model.nominal_input, model.values))
        if not np.isfinite(found).all():
            return self.traits.pace
        return horizon(poles_of(found), self.traits.pace)

    def __getstate__(self) -> dict[str, object]:
        """Leave out what follows from the fields: a copy, or another process, finds it again."""
        return {f.name: getattr(self, f.name) for f in fields(self)}

    def form(self, form: Form | str) -> Trace:
        """Return the equations as `EXACT` or `REGULARISED`, which may be given by name."""
        name = form if isinstance(form, str) else ("regularised" if form.regularised else "exact")
        check_choice("form", name, ("exact", "regularised"))
        return self.regularised if name == "regularised" else self.exact

    @property
    def ports(self) -> tuple[Port, ...]:
        """Places where an effect may act, in the order of the equations."""
        return self.exact.ports

    @property
    def values(self) -> Vector:
        """Parameter values, shape (n_parameters,), in SI."""
        return np.array([q.value for q in self.parameters], dtype=float)

    @property
    def commands(self) -> tuple[Input, ...]:
        """Inputs that somebody sets, not those that are only measured."""
        return tuple(q for q in self.inputs if q.commanded)

    @property
    def quantities(self) -> tuple[Quantity, ...]:
        """Outputs, inputs and states: what may declare a unit for reading.

        A state that declares none is read as an output that is this state.
        """
        read = zip(ca.vertsplit(self.exact.outputs), self.outputs, strict=True)
        shown = {value.element_hash(): q.display_unit for value, q in read}
        values = zip(ca.vertsplit(self.exact.x), self.states, strict=True)
        states = (
            replace(q, display_unit=q.display_unit or shown.get(value.element_hash(), ""))
            for value, q in values
        )
        return (*self.outputs, *self.inputs, *states)

    @cached_property
    def shadowed(self) -> tuple[str, ...]:
        """Names of inputs that outputs have too which do not read them."""
        inputs = dict(zip((q.name for q in self.inputs), ca.vertsplit(self.exact.u), strict=True))
        read = zip((q.name for q in self.outputs), ca.vertsplit(self.exact.outputs), strict=True)
        return tuple(n for n, v in read if n in inputs and not ca.depends_on(v, inputs[n]))

    @property
    def nominal_input(self) -> Vector:
        """Inputs at rest, shape (n_inputs,), in SI."""
        return np.array([q.nominal for q in self.inputs], dtype=float)

    def read_in(self, name: str) -> str:
        """Return the unit that the author's words give a parameter for reading; empty if none.

        A parameter of an effect that says none is read as the parameter that this changes, or as
        what happens at its ports, without a zero of its own.

        Example:
            >>> from workbench.plants.servo_axis import servo_axis
            >>> axis = servo_axis().with_parameters({"offset": 1.0})
            >>> axis.read_in("mass"), axis.read_at(["position"], "m")
            ('', 'mm')
        """
        effect = next((e for e in self.effects if e.name == name.partition(".")[0]), None)
        places: tuple[str, ...] = (name,)
        if effect is not None and "." in name:
            places = effect.places
        one = self.parameter(name)
        return one.display_unit or self.read_at(places, one.unit)

    def read_at(self, places: Iterable[str], unit: str) -> str:
        """Return the unit in which people read something of an SI unit; empty if none.

        What a signal at a port is over a power of another quantity is read in both their units.

        Args:
            places: Ports, rates, and parameters, whose own unit it may be.
        """
        places, known = tuple(places), self.quantities
        said = {q.name: of_difference(q.display_unit) for q in self.parameters if q.unit == unit}
        ports = [q for name in places for q in self.ports if q.name == name]
        # In which its author wrote it, or named it.
        read = {
            q.name: of_difference(q.stated) or declared_unit(q.name, q.unit, known, difference=True)
            for q in ports
        }
        said |= {q.name: read[q.name] for q in ports if q.unit == unit}
        found = (said.get(p) or declared_unit(p, unit, known, difference=True) for p in places)
        # What changes a parameter is read as that is written.
        own = any(q.name in places and q.unit == unit for q in self.parameters)
        combined = (combined_unit(unit, q.unit, read[q.name], known) for q in ports if not own)
        return next(filter(None, (*found, *combined)), "")

    def reading(self, unit: str, *places: str, size: float = 0.0) -> tuple[str, float]:
        """Return how differences of an SI unit are read at places: a unit, and its factor from SI.

        Args:
            size: How large they are, in SI; not known if 0.

        Example:
            >>> from workbench.plants.servo_axis import servo_axis
            >>> servo_axis().reading("m/s", "rate of position"), servo_axis().reading("Pa")
            (('mm/s', 1000.0), ('bar', 1e-05))
        """
        factor, written = readably(1.0, unit, self.read_at(places, unit), size)
        return written, factor

    def size_text(self, size: float, unit: str, ports: Iterable[str], digits: int = 2) -> str:
        """Write how large something at some ports is, in SI, as people read it there.

        Example:
            >>> from workbench.plants.servo_axis import servo_axis
            >>> servo_axis().size_text(1.3e-5, "m", ["position.reading"])
            '0.013 mm'
        """
        written, factor = self.reading(unit, *ports, size=size)
        return with_unit(f"{float(f'{factor * size:.{digits}g}'):g}", written)

    def parameter(self, name: str) -> Parameter:
        """Return a parameter by name; ``effect.name`` for one of an effect."""
        return self.parameters[index_of("parameter", name, self.parameters)]

    def bound(self, bound: Bound) -> float:
        """Return a bound that the traits of the model state, in SI."""
        if isinstance(bound, tuple):
            return float(sum(self.parameter(name).value for name in bound))
        return bound

    def effect(self, name: str) -> Effect:
        """Return an attached effect by name."""
        check_choice("effect", name, [e.name for e in self.effects])
        return next(e for e in self.effects if e.name == name)

    def with_effect(self, *effects: Effect) -> Model:
        """Return a model with effects attached, behind those that are there.

        An effect at an input or rate where the plant has no port opens those (`opened`).
        """
        if not effects:
            return self
        ports = [port.name for port in self.ports]
        if any(port not in ports for e in effects for port in e.ports):
            further = self.opened()
            if all(port in [q.name for q in further.ports] for e in effects for port in e.ports):
                return further.with_effect(*effects)
        effects = tuple(e.settle(e, self) if e.settle else e for e in effects)
        taken = [effect.name for effect in self.effects]
        for effect in effects:
            if effect.name in taken:
                raise WorkbenchError(
                    f"effect {effect.name!r} is attached already; take it away with without(), or"
                    " attach it again under another name with renamed()"
                )
            taken.append(effect.name)
            for port in effect.ports:
                check_choice(f"port of effect {effect.name}", port, ports)
        attached = (*self.effects, *effects)
        parameters = (*self.parameters, *(_prefixed(e, q) for e in effects for q in e.parameters))
        key = tuple(map(_structure, effects))
        if key in self._extended:
            # The same laws with other values or bounds.
            return self._extended[key]._valued(effects=attached, parameters=parameters)  # noqa: SLF001
        states = (*self.states, *(_prefixed(e, q) for e in effects for q in e.states))
        model = replace(self, effects=attached, states=states, parameters=parameters)
        self._extended[key] = model
        while len(self._extended) > _KEPT:
            del self._extended[next(iter(self._extended))]
        return model

    def opened(self) -> Model:
        """Return the model with ports at inputs and rates that pass no port of their own."""
        return self._opened

    @cached_property
    def _opened(self) -> Model:
        if self.traits.opened:
            return self
        further = replace(self, traits=replace(self.traits, opened=True, scales=()))
        return self if len(further.ports) == len(self.ports) else further

    @property
    def dry_effects(self) -> tuple[str, ...]:
        """Names of the attached effects that have no slope at rest: dry friction, hysteresis."""
        return tuple(e.name for e in self.effects if e.dry)

    def without(self, *names: str) -> Model:
        """Return a model with effects, their states and their parameters taken away.

        What changes a parameter of one of them goes with it.
        """
        if not names:
            return self
        for name in names:
            check_choice("effect", name, [e.name for e in self.effects])
        found = self._without(names)
        _ = found.exact
        return found

    def _without(self, names: Collection[str]) -> Model:
        """Return a model without effects, whose equations are written down once they are read."""
        gone = tuple(f"{name}." for name in names)
        beside = {e.name for e in self.effects if e.about.subject.startswith(gone)} - {*names}
        if beside:
            return self._without({*names, *beside})
        model = copy.copy(self)
        model.__dict__.update(
            effects=tuple(e for e in self.effects if e.name not in names),
            states=tuple(q for q in self.states if not q.name.startswith(gone)),
            parameters=tuple(q for q in self.parameters if not q.name.startswith(gone)),
        )
        return model

    def with_parameters(self, values: Mapping[str, float]) -> Model:
        """Return a model with other values by name, in each parameter's SI unit."""
        for name in values:
            index_of("parameter", name, self.parameters)
        changed = tuple(
            q.with_value(values[q.name]) if q.name in values else q for q in self.parameters
        )
        return self._valued(parameters=changed)

    def _valued(self, **changed: tuple[Parameter | Effect, ...]) -> Model:
        """Return a model with other values: its equations are those that are written down."""
        model = copy.copy(self)
        model.__dict__.update(changed, _traces=self._traces, _extended=self._extended)
        return model

    def sized_by(self, moved: Mapping[str, float]) -> Model:
        """Return a model with the sizes that inputs have of which it says nothing.

        Where neither a scale nor a range nor a value at rest tells how far an input goes, the sizes
        of states and outputs are unknown too; they follow from it. An output that goes far farther
        than the equations promise, as the level of a lake that they see empty, has the size that it
        shows, and so has the state that it reads.

        Args:
            moved: How far inputs and outputs go, by name, in SI; zeros and what declares a size do
                not count.
        """
        unknown = {q.name for q in self.inputs if not q.sized and silent(q)}
        new = {name: size for name, size in moved.items() if name in unknown and size > 0.0}
        found = self._with_sizes(new, {}) if new else self
        shown = {
            q.name: moved[q.name]
            for q in found.outputs
            if not q.sized and moved.get(q.name, 0.0) > _FARTHER * q.scale
        }
        return found._with_sizes({}, shown) if shown else found  # noqa: SLF001

    def _with_sizes(self, of_inputs: Mapping[str, float], read: Mapping[str, float]) -> Model:
        """Return the model with sizes of inputs and outputs, in SI, from which the rest follows."""
        told = {
            state.name: read[q.name]
            for q, reading in zip(self.outputs, self.exact.outputs.elements(), strict=True)
            for state, symbol in zip(self.states, self.exact.x.elements(), strict=True)
            if q.name in read and ca.is_equal(reading, symbol, 3)
        }
        return replace(
            self,
            inputs=tuple(replace(q, scale=of_inputs.get(q.name, q.scale)) for q in self.inputs),
            states=tuple(
                q if q.sized else replace(q, scale=told.get(q.name, 0.0)) for q in self.states
            ),
            outputs=tuple(
                q if q.sized else replace(q, scale=read.get(q.name, 0.0)) for q in self.outputs
            ),
            traits=replace(self.traits, scales=()),
        )

    def rates(
        self,
        x: npt.ArrayLike,
        u: npt.ArrayLike,
        *,
        form: Form | str = EXACT,
    ) -> Vector:
        """Compute the rates of the states, shape (n_states,), in SI per second.

        Args:
            x: States, shape (n_states,), in SI.
            u: Inputs, shape (n_inputs,), in SI.
        """
        return self._call(self.form(form).rates_function, x, u)

    def read(
        self,
        x: npt.ArrayLike,
        u: npt.ArrayLike,
        *,
        form: Form | str = EXACT,
    ) -> Vector:
        """Compute what the sensors would read without noise, shape (n_outputs,), in SI.

        Args:
            x: States, shape (n_states,), in SI.
            u: Inputs, shape (n_inputs,), in SI.
        """
        return self._call(self.form(form).outputs_function, x, u)

    def signals(self, x: npt.ArrayLike, u: npt.ArrayLike) -> dict[str, float]:
        """Compute every port and published signal at one instant, in SI by name.

        Args:
            x: States, shape (n_states,), in SI.
            u: Inputs, shape (n_inputs,), in SI.
        """
        values = self._call(self.exact.signals_function, x, u)
        return dict(zip(self.exact.signal_names, values.tolist(), strict=True))

    def initial_state(
        self, given: Mapping[str, float] | None = None, *, u: npt.ArrayLike | None = None
    ) -> Vector:
        """Return a starting state, shape (n_states,), in SI.

        Args:
            given: Values of some states by name, in SI; the others start at their ``initial``, the
                states of effects where the effect's ``start`` puts them.
            u: Inputs at the start, shape (n_inputs,), in SI; at rest by default.
        """
        given = dict(given or {})
        x = np.array([q.initial for q in self.states], dtype=float)
        for name, value in given.items():
            x[index_of("state", name, self.states)] = value
        free = [i for i, q in enumerate(self.states) if q.name not in given]
        # Once for each that has a start, which may depend on the state of another.
        for _ in (effect for effect in self.effects if effect.start is not None):
            given_u = self.nominal_input if u is None else u
            started = self._call(self.exact.start_function, x, given_u)
            x[free] = started[free]
        return check_finite("initial state", x)

    def _call(self, function: ca.Function, x: npt.ArrayLike, u: npt.ArrayLike) -> Vector:
        x_ = check_vector("state", x, self.states)
        u_ = check_vector("input", u, self.inputs)
        return np.asarray(function(x_, u_, self.values), dtype=float).ravel()

    def tables(self) -> tuple[Rows, ...]:
        """Return the quantities, the effects with their ports, and the ports."""

        def named(title: str, own: Iterable[Quantity | Port]) -> Rows:
            rows = [(q.name, q.unit, q.description) for q in own]
            return Rows(title, ("name", "unit", "meaning"), rows)

        ports = [(effect.name, ", ".join(effect.ports)) for effect in self.effects]
        heads = ("name", "value", "unit", "lower", "upper", "meaning", "source")
        keys = ("name", "value", "unit", "lower", "upper", "description", "source")
        return (
            named("inputs", self.inputs),
            named("outputs", self.outputs),
            named("states", self.states),
            Rows("effects", ("name", "ports"), ports),
            Rows("parameters", heads, list(map(attrgetter(*keys), self.parameters))),
            named("ports", self.ports),
        )

    def columns(self) -> dict[str, list[object]]:
        """Return the parameters as columns."""
        table = next(t for t in self.tables() if t.title == "parameters")
        return {name: [row[i] for row in table.rows] for i, name in enumerate(table.headings)}

    def __str__(self) -> str:
        lines = [f"{self.name}: {self.description}" if self.description else self.name]
        groups = {"states": self.states, "inputs": self.inputs, "outputs": self.outputs}
        for title, group in groups.items():
            lines += [f"  {title}"] + [_row(q) for q in group]
        lines += ["  parameters"]
        lines += [f"{_row(q)}  {q.value:<12.6g} {q.source}".rstrip() for q in self.parameters]
        lines += ["  effects    " + (", ".join(e.name for e in self.effects) or "none")]
        lines += ["  ports      " + ", ".join(q.name for q in self.ports)]
        return "\n".join(lines)


def index_of(kind: str, name: str, quantities: Sequence[Quantity]) -> int:
    """Return the position of a quantity by name; ``kind`` says in the message what it is."""
    names = [q.name for q in quantities]
    check_choice(kind, name, names)
    return names.index(name)


def check_vector(kind: str, values: npt.ArrayLike, quantities: Sequence[Quantity]) -> Vector:
    """Return values as a finite vector with one entry per quantity, shape (n,), in SI.

    ``kind`` says in the message what the vector is.
    """
    vector = check_finite(f"{kind} vector", values).ravel()
    if vector.size != len(quantities):
        raise WorkbenchError(
            f"{kind} vector has {vector.size} entries; the model needs {len(quantities)}:"
            f" {', '.join(q.name for q in quantities)}"
        )
    return vector


def _prefixed(effect: Effect, quantity: Own) -> Own:
    return replace(quantity, name=f"{effect.name}.{quantity.name}")


def _row(quantity: Quantity) -> str:
    return f"    {quantity.name:<34} {quantity.unit:<14} {quantity.description}".rstrip()


def _structure(effect: Effect) -> tuple[Hashable, ...]:
    """Return what the equations of a model with an effect depend on."""
    names = tuple(q.name for q in effect.parameters)
    does = effect.transform, effect.rates, effect.start
    return effect.name, effect.ports, names, effect.states, does
