"""Writing the equations of a model down once, as CasADi functions."""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, Protocol

import casadi as ca
import numpy as np

from workbench.arrays import Vector
from workbench.errors import WorkbenchError
from workbench.model.effect import Effect
from workbench.model.exchanges import exchanges
from workbench.model.expressions import leave_the_numbers, with_real_roots
from workbench.model.quantities import Input, Quantity, State
from workbench.model.regularisation import Expression, Form
from workbench.model.scope import EffectView, Names, Port, PortView, Scope, ValidRange
from workbench.model.traits import LEFT_OUT, Traits
from workbench.model.units import per, same_dimension

# NumPy's functions of a symbol give a symbol, in equations too, and say nothing of it.
ca.GlobalOptions.setNumpyMode(-1)

Named = Mapping[str, Expression]

Equations = tuple[Named, Named]
"""Rate of every own state and measurement of every output, by name."""


_GENTLE = {
    ca.OP_CONST, ca.OP_INPUT, ca.OP_OUTPUT, ca.OP_ASSIGN, ca.OP_ADD, ca.OP_SUB, ca.OP_MUL,
    ca.OP_DIV, ca.OP_NEG, ca.OP_SQ, ca.OP_TWICE, ca.OP_INV, ca.OP_EXP, ca.OP_SIN, ca.OP_COS,
    ca.OP_CONSTPOW,
}  # fmt: skip


_ACCELERATIONS = "m/s2", "rad/s2"

_DEEP = 12
"""Operations down to which two expressions are compared."""


class Written(Protocol):
    """What a model says of its equations."""

    @property
    def name(self) -> str:
        """Name of the plant."""

    @property
    def equations(self) -> Callable[[Scope], Equations | Named]:
        """The equations, written with the names of a `Scope`."""

    @property
    def states(self) -> tuple[State, ...]:
        """States, those of attached effects last."""

    @property
    def inputs(self) -> tuple[Input, ...]:
        """What drives the model."""

    @property
    def outputs(self) -> tuple[Quantity, ...]:
        """What the sensors measure."""

    @property
    def parameters(self) -> tuple[Quantity, ...]:
        """Parameters, those of attached effects last."""

    @property
    def effects(self) -> tuple[Effect, ...]:
        """Attached effects, in the order in which they act on a port."""

    @property
    def traits(self) -> Traits:
        """What general rooms may know of the plant beside its equations."""


@dataclass(frozen=True, eq=False)
class Trace:
    """One form of a model's equations as CasADi expressions.

    Args:
        x: Symbols of the states in the model's order, shape (n_states, 1), in SI.
        u: Symbols of the inputs, shape (n_inputs, 1), in SI.
        p: Symbols of the parameters, shape (n_parameters, 1), in SI.
        rates: Rates of the states, shape (n_states, 1), in SI per second.
        outputs: Named, shape (n_outputs, 1), in SI.
        start: States at the start of a run, as functions of the states given, shape
            (n_states, 1), in SI.
        signals: Their values, shape (n_signals, 1), each in its unit of ``signal_units``.
        ranges: Ranges of published signals within which the laws hold.
        perturbation: Symbols of what is added to the signal of each port in the order of ``ports``,
            shape (n_ports, 1), in the ports' SI units; zero in ``rates`` and ``outputs``.
        perturbed_rates: Rates of the states with that added, shape (n_states, 1), in SI per second.
        perturbed_outputs: Named with that added, shape (n_outputs, 1), in SI.
        local_signals: Local signals of each port, in its order, shape (n_local, 1), in SI.
    """

    x: ca.SX
    u: ca.SX
    p: ca.SX
    rates: ca.SX
    outputs: ca.SX
    start: ca.SX
    ports: tuple[Port, ...]
    signal_names: tuple[str, ...]
    signal_units: tuple[str, ...]
    signals: ca.SX
    ranges: tuple[ValidRange, ...]
    perturbation: ca.SX
    perturbed_rates: ca.SX
    perturbed_outputs: ca.SX
    local_signals: tuple[ca.SX, ...]

    @cached_property
    def rates_by_port(self) -> ca.SX:
        """Derivatives of the rates by what each port adds, (n_states, n_ports), in SI."""
        return self._at_rest(ca.jacobian(self.perturbed_rates, self.perturbation))

    @cached_property
    def outputs_by_port(self) -> ca.SX:
        """Derivatives of the measurements by what each port adds, (n_outputs, n_ports), in SI."""
        return self._at_rest(ca.jacobian(self.perturbed_outputs, self.perturbation))

    def _at_rest(self, expression: ca.SX) -> ca.SX:
        return ca.substitute(expression, self.perturbation, ca.SX.zeros(self.perturbation.numel()))

    def function(self, name: str, *expressions: ca.SX) -> ca.Function:
        """Build a CasADi function of three vectors (states, inputs, parameters), in SI.

        Args:
            expressions: What it returns, in this trace's symbols; any shape, in SI.
        """
        return ca.Function(name, [self.x, self.u, self.p], list(expressions))

    def along(
        self, states: Vector, inputs: Vector, parameters: Vector, *expressions: ca.SX
    ) -> list[Vector]:
        """Evaluate expressions of this trace at every sample: arrays (n, rows, columns), in SI.

        Args:
            states: States, shape (n, n_states), in SI.
            inputs: Inputs, shape (n, n_inputs), in SI.
            parameters: Parameters, shape (n_parameters,) or (n, n_parameters), in SI.
            expressions: What to evaluate, in SI.
        """
        n = len(states)
        function = self.function("along", *map(ca.densify, expressions)).map(n)
        p = parameters.T if parameters.ndim == 2 else np.tile(parameters[:, None], (1, n))
        return [
            np.asarray(values, dtype=float)
            .reshape(values.shape[0], n, values.shape[1] // n)
            .transpose(1, 0, 2)
            for values in function.call([states.T, inputs.T, p])
        ]

    @cached_property
    def rates_function(self) -> ca.Function:
        """Rates as a CasADi function of (x, u, p)."""
        return self.function("rates", self.rates)

    @cached_property
    def gentle(self) -> bool:
        """Whether rates and measurements have no place where they bend or steepen at once.

        They are made of sums, products, powers, exponentials and sines alone.
        """
        f = self.function("both", self.rates, self.outputs)
        return all(f.instruction_id(i) in _GENTLE for i in range(f.n_instructions()))

    @cached_property
    def outputs_function(self) -> ca.Function:
        """Named as a CasADi function of (x, u, p)."""
        return self.function("outputs", self.outputs)

    @cached_property
    def signals_function(self) -> ca.Function:
        """Ports and published signals as a CasADi function of (x, u, p)."""
        return self.function("signals", self.signals)

    @cached_property
    def start_function(self) -> ca.Function:
        """States at the start of a run as a CasADi function of (x, u, p)."""
        return self.function("start", self.start)

    @cached_property
    def jacobian_function(self) -> ca.Function:
        """Derivatives (df/dx, df/du, dg/dx, dg/du) as a CasADi function of (x, u, p)."""
        return self.function(
            "jacobians",
            ca.jacobian(self.rates, self.x),
            ca.jacobian(self.rates, self.u),
            ca.jacobian(self.outputs, self.x),
            ca.jacobian(self.outputs, self.u),
        )


def trace(model: Written, form: Form) -> Trace:
    """Write the equations of a model down with CasADi symbols.

    Raises:
        WorkbenchError: If the equations forget a state or an output, return one that is not
            declared, or an effect forgets the rate of one of its states.
    """
    symbols = {
        "state": _symbols(model.states),
        "input": _symbols(model.inputs),
        "parameter": _symbols(model.parameters),
    }
    own = {
        kind: {effect.name: _short_names(effect, values, kind) for effect in model.effects}
        for kind, values in symbols.items()
    }
    seen: dict[str, dict[str, PortView]] = {effect.name: {} for effect in model.effects}
    # What is added to the signal of each port, zero but for its derivatives.
    perturbations: dict[str, ca.SX] = {}
    # Of a state and an input of one name a law means the state: the input has its port.
    known = Names("state or input", symbols["input"] | symbols["state"])
    local: dict[str, Names] = {}
    written: dict[str, Expression] = {}

    def transform(port: Port, value: Expression, signals: Names) -> Expression:
        local[port.name], written[port.name] = signals, value
        for effect in model.effects:
            if port.name in effect.ports:
                view = PortView(
                    port.name,
                    effect.ports.index(port.name),
                    value,
                    signals,
                    own["parameter"][effect.name],
                    own["state"][effect.name],
                    form,
                    port.scale,
                    known,
                    Names("parameter", symbols["parameter"]),
                    plain=written[port.name],
                )
                seen[effect.name][port.name] = view
                value = effect.transform(view)
        perturbations[port.name] = ca.SX.sym(f"perturbation.{port.name}")
        return value + perturbations[port.name]

    def scope_of(inputs: Mapping[str, Expression]) -> Scope:
        return Scope(
            Names("state", symbols["state"]),
            Names("input", inputs),
            Names("parameter", symbols["parameter"]),
            form=form,
            transform=transform,
            scales=dict(model.traits.scales),
        )

    scope = scope_of(symbols["input"])
    rates, outputs = _equations_of(model, scope)
    sizes = dict(model.traits.sizes)
    declared = dict(written)
    if not declared or model.traits.opened:
        plain = rates
        covered = _covered(model, scope_of(symbols["input"]), symbols, declared)
        scope = scope_of({})
        read = {q.name for q in model.outputs}
        places = {
            q.name: "command" if q.commanded or q.name in read else "reading" for q in model.inputs
        }
        scope.u = Names(
            "input",
            {
                q.name: symbols["input"][q.name]
                if q.name in covered or f"{q.name}.{places[q.name]}" in declared
                else _opened(scope, q, places[q.name], symbols["input"][q.name], sizes)
                for q in model.inputs
            },
        )
        rates, outputs = _equations_of(model, scope)
        written_rates = rates
        if not declared:
            rates = _default_exchanges(model, scope, plain, rates, symbols, sizes)
        whole = _whole(rates, declared, scope, perturbations) | {*model.traits.passing}
        rates = _default_rates(model, scope, rates, sizes, whole)
        outputs = _felt(model, written_rates, rates, outputs)
    outputs = _default_measurements(model, scope, outputs, sizes)
    rates = dict(rates)
    starts: dict[str, Expression] = {}
    values = Names("signal", scope.values)
    for effect in model.effects:
        if effect.rates is None:
            continue
        view = EffectView(
            own["parameter"][effect.name],
            own["state"][effect.name],
            form,
            seen[effect.name],
            values,
        )
        rates |= {f"{effect.name}.{k}": v for k, v in effect.rates(view).items()}
        if effect.start is not None:
            starts |= {f"{effect.name}.{k}": v for k, v in effect.start(view).items()}
    start = _column(starts.get(n, s) for n, s in symbols["state"].items())
    signals = _column(scope.values.values())
    perturbed_rates = _stack(model, "rate of state", rates, model.states)
    perturbed_outputs = _stack(model, "measurement of output", outputs, model.outputs)
    # The equations may have been traced before ports were opened at what they read.
    perturbation = _column(perturbations[q.name] for q in scope.ports)
    sources = {**scope.values, **symbols["parameter"], **known}
    own_signals = [_column(local[q.name].values()) for q in scope.ports]
    # Effects one after another have written anew what stands before them.
    traced = ca.cse([perturbed_rates, perturbed_outputs, start, signals, *own_signals])
    nothing = [perturbation], [ca.SX.zeros(perturbation.numel())]
    still = ca.substitute(traced, *nothing)
    told = [f"rate of {q.name}" for q in model.states]
    told += [f"output {q.name}" for q in model.outputs]
    _require_numbers(model, ca.vertcat(*still[:2]), told)
    if _leaves_the_numbers(model, symbols, still[:2]):
        traced = with_real_roots(traced)
        still = ca.substitute(traced, *nothing)
    named = _origins(sources)
    return Trace(
        x=_column(symbols["state"].values()),
        u=_column(symbols["input"].values()),
        p=_column(symbols["parameter"].values()),
        rates=still[0],
        outputs=still[1],
        start=still[2],
        ports=tuple(
            replace(
                port,
                origins=tuple(map(named, local[port.name].values())),
                disturbance=port.disturbance or LEFT_OUT * sizes.get(port.name, 0.0),
            )
            for port in scope.ports
        ),
        signal_names=tuple(scope.values),
        signal_units=tuple(scope.units[name] for name in scope.values),
        signals=still[3],
        ranges=tuple(scope.ranges),
        perturbation=perturbation,
        perturbed_rates=traced[0],
        perturbed_outputs=traced[1],
        local_signals=tuple(still[4:]),
    )


def _leaves_the_numbers(
    model: Written, symbols: Mapping[str, Mapping[str, ca.SX]], expressions: Sequence[ca.SX]
) -> bool:
    x, u, p = (
        np.array([getattr(q, usual, 0.0) for q in quantities], dtype=float)
        for quantities, usual in (
            (model.states, "initial"),
            (model.inputs, "nominal"),
            (model.parameters, "value"),
        )
    )
    reach = np.array([q.scale or abs(at) or 1.0 for q, at in zip(model.states, x, strict=True)])
    own = [_column(symbols[kind].values()) for kind in ("state", "input", "parameter")]
    return leave_the_numbers(expressions, own, x, reach, u, p)


def _equations_of(model: Written, scope: Scope) -> Equations:
    found: Any = model.equations(scope)
    if isinstance(found, Mapping):
        return found, {q.name: scope.x[q.name] for q in model.outputs if q.name in scope.x}
    if isinstance(found, tuple) and [isinstance(v, Mapping) for v in found] == [True, True]:
        return found
    raise WorkbenchError(
        f"the equations of {model.name!r} return a {type(found).__name__}; return two mappings, the"
        " rate of every state and the measurement of every output"
    )


def _require_numbers(model: Written, values: ca.SX, names: Sequence[str]) -> None:
    """Refuse what is no number wherever a model is, as ``math.sin`` makes of a symbol."""
    if not _never_a_number(values):
        return
    name = next(n for v, n in zip(values.elements(), names, strict=True) if _never_a_number(v))
    raise WorkbenchError(
        f"the {name} of {model.name!r} is not a number, wherever the model is; the functions of"
        " Python's math know no symbols: take sin, sqrt and the like from numpy"
    )


def _never_a_number(values: ca.SX) -> bool:
    f = ca.Function("given", [ca.vcat([*ca.symvar(values)])], [values])
    constants = (k for k in range(f.n_instructions()) if f.instruction_id(k) == ca.OP_CONST)
    return any(math.isnan(f.instruction_constant(k)) for k in constants)


def _symbolic(value: Expression) -> ca.SX:
    return value if isinstance(value, ca.SX) else ca.SX(value)


def _symbols(quantities: Sequence[Quantity]) -> dict[str, ca.SX]:
    return {q.name: ca.SX.sym(q.name) for q in quantities}


def _opened(
    scope: Scope,
    q: Quantity,
    what: str,
    value: Expression,
    sizes: Mapping[str, float],
    *,
    name: str = "",
) -> Expression:
    """Open a port for a quantity of a plant whose author has opened none."""
    moves = what in ("rate", "exchange")
    unit = per(q.unit, "s") if moves else q.unit
    name = name or f"{q.name}.{what}"
    own = q.scale if q.sized and not moves else 0.0
    return scope.port(name, value, unit=unit, scale=sizes.get(name) or own or None)


def _default_exchanges(
    model: Written,
    scope: Scope,
    plain: Named,
    rates: Named,
    symbols: Mapping[str, Mapping[str, ca.SX]],
    sizes: Mapping[str, float],
) -> Named:
    """Open a port at what one state gives and another takes.

    Args:
        plain: The rates of states before a port was open, by name, in SI per second.
        rates: The same behind the ports of the inputs, in SI per second.
    """
    attached = tuple(f"{effect.name}." for effect in model.effects)
    own = {n: s for n, s in symbols["parameter"].items() if not n.startswith(attached)}
    states = [q for q in model.states if q.name in plain]
    if any(q not in states and not q.name.startswith(attached) for q in model.states):
        return rates  # Which rate is missing is told where all of them are taken.
    x = {q.name: symbols["state"][q.name] for q in states}
    given = {n: _symbolic(rate) for n, rate in plain.items() if n in x}
    changed = dict(rates)
    opened = _column(scope.u[n] for n in symbols["input"])
    for found in exchanges(given, states, x, symbols["input"], own):
        between = "_".join(found.names)
        name = f"{between}.exchange"
        name = name if name not in scope.values else f"{between}_{len(scope.values)}.exchange"
        value = ca.substitute(found.value, _column(symbols["input"].values()), opened)
        first = next(q for q in states if q.name == found.names[0])
        more = _opened(scope, first, "exchange", value, sizes, name=name) - value
        for n, share in zip(found.names, found.shares, strict=True):
            changed[n] = changed[n] + share * more
    return changed


def _covered(
    model: Written,
    scope: Scope,
    symbols: Mapping[str, Mapping[str, ca.SX]],
    declared: Named,
) -> set[str]:
    """Return the inputs that ports of the author carry alone: what acts on them acts there.

    Args:
        scope: One in which the equations may be written once more.
        declared: Signals at the author's ports before effects have acted, by name, in SI.
    """
    x = _column(symbols["state"].values())
    carried: dict[str, str] = {}
    for port, value in declared.items():
        entering = [n for n, u in symbols["input"].items() if ca.depends_on(_symbolic(value), u)]
        if len(entering) == 1 and not ca.depends_on(_symbolic(value), x):
            carried[port] = entering[0]
    if not carried:
        return set()
    # What enters beside those ports, as a current that both charges and heats, is not theirs alone.
    scope.transform = lambda port, value, _: ca.SX.sym(port.name) if port.name in carried else value
    beside = _column(v for part in _equations_of(model, scope) for v in part.values())
    return {n for n in carried.values() if not ca.depends_on(beside, symbols["input"][n])}


def _whole(
    rates: Named, declared: Named, scope: Scope, perturbations: Mapping[str, ca.SX]
) -> set[str]:
    """Return the states whose rate is a multiple of the signal at a port of the author."""
    every = _column(rates.values())
    slopes = ca.jacobian(every, _column(perturbations[port] for port in declared))
    pairs = list(zip(*slopes.sparsity().get_triplet(), strict=True))
    if not pairs:
        return set()
    signals = [_symbolic(scope.values[port]) for port in declared]
    driven = ca.vcat([every[i] for i, _ in pairs])
    beside = driven - ca.vcat([slopes[i, j] * signals[j] for i, j in pairs])
    symbols = ca.vcat(ca.symvar(ca.vertcat(beside, driven)))
    values = ca.Function("beside", [symbols], [beside, driven])
    looks = np.random.default_rng(1).uniform(0.5, 1.5, (3, symbols.numel()))
    left, whole = np.array([values.call([at]) for at in looks]).swapaxes(0, 1)
    alone = np.all(np.abs(left) <= 1e-9 * np.abs(whole), axis=(0, 2))
    names = list(rates)
    return {names[i] for (i, _), one in zip(pairs, alone, strict=True) if one}


def _default_rates(
    model: Written, scope: Scope, rates: Named, sizes: Mapping[str, float], whole: Collection[str]
) -> Named:
    """Open a port at every rate that is not a state itself, nor all of what a port carries."""
    states = [scope.x[q.name] for q in model.states]
    own = {q.name: q for q in model.states}

    def defined(rate: Expression) -> bool:
        return any(ca.is_equal(_symbolic(rate), x, 2) for x in states)

    return {
        name: rate
        if defined(rate) or name not in own or name in whole or f"{name}.rate" in scope.values
        else _opened(scope, own[name], "rate", rate, sizes)
        for name, rate in rates.items()
    }


def _felt(model: Written, plain: Named, rates: Named, outputs: Named) -> Named:
    """Let sensors of a rate read what acts at the port of that rate too.

    An accelerometer feels all that acts on its mass, a flow meter before a vessel all that fills
    it.

    Args:
        plain: The rates of states before they had ports, by name, in SI per second.
        rates: The same behind their ports.
    """
    moved = [
        (per(q.unit, "s"), _symbolic(plain[q.name]), _symbolic(rates[q.name]))
        for q in model.states
        if q.name in plain
    ]
    moved = [rate for rate in moved if rate[1].n_dep()]
    units = {q.name: q.unit for q in model.outputs}

    def behind(value: ca.SX, felt: Sequence[tuple[ca.SX, ca.SX]]) -> ca.SX:
        done: dict[int, ca.SX] = {}

        def seen(value: ca.SX) -> ca.SX:
            key = value.element_hash()
            if key not in done:
                parts = [seen(value.dep(i)) for i in range(value.n_dep())]
                new = value
                if parts:
                    make = ca.SX.unary if len(parts) == 1 else ca.SX.binary
                    same = (after for before, after in felt if ca.is_equal(value, before, _DEEP))
                    new = next(same, make(value.op(), *parts))
                done[key] = new
            return done[key]

        return seen(value)

    found = dict(outputs)
    for name, value in outputs.items():
        # The sensor of a mass feels what acts on it through a lever too, in another unit.
        own = units.get(name, "")
        kinds = _ACCELERATIONS if same_dimension(own, *_ACCELERATIONS) else (own,)
        felt = [(before, after) for unit, before, after in moved if same_dimension(unit, *kinds)]
        if felt:
            found[name] = behind(_symbolic(value), felt)
    return found


def _default_measurements(
    model: Written, scope: Scope, outputs: Named, sizes: Mapping[str, float]
) -> Named:
    """Open a port at every output that passes through no port of a sensor."""
    read = {q.name: q for q in model.outputs}
    sensors = {q.name for q in scope.ports if q.role == "measurement"}
    sensors |= {q.name for q in scope.ports if q.name.endswith(".reading")}

    def sensed(name: str, value: Expression) -> bool:
        return f"{name}.reading" in scope.values or any(
            ca.is_equal(_symbolic(value), _symbolic(scope.values[port]), 2) for port in sensors
        )

    return {
        name: _opened(scope, read[name], "reading", value, sizes)
        if name in read and not sensed(name, value)
        else value
        for name, value in outputs.items()
    }


def _origins(values: Mapping[str, Expression]) -> Callable[[Expression], str]:
    """Return a function that names the first of some values that a local signal is, or nothing."""
    order = {name: i for i, name in enumerate(values)}
    nodes: dict[int, str] = {}
    # What is written down twice has two nodes, but the same operations.
    alike: dict[tuple[int, ...], list[tuple[str, ca.SX]]] = {}
    for name, value in values.items():
        expression = _symbolic(value)
        if expression.is_constant():
            continue
        nodes.setdefault(expression.element_hash(), name)
        if not expression.is_symbolic():
            alike.setdefault(_operations(expression), []).append((name, expression))

    def named(signal: Expression) -> str:
        own = _symbolic(signal)
        if own.is_constant():
            return ""
        found = [nodes[own.element_hash()]] if own.element_hash() in nodes else []
        if not own.is_symbolic():
            same = (n for n, v in alike.get(_operations(own), ()) if ca.is_equal(own, v, 2))
            found += [next(same, "")]
        return min((n for n in found if n), key=order.__getitem__, default="")

    return named


def _operations(expression: ca.SX) -> tuple[int, ...]:
    """Return the operation of an expression and those of its parts, in any order."""
    parts = (expression.dep(i).op() for i in range(expression.n_dep()))
    return (expression.op(), *sorted(parts))


def _short_names(effect: Effect, values: Mapping[str, ca.SX], kind: str) -> Names:
    prefix = f"{effect.name}."
    return Names(
        f"{kind} of effect {effect.name}",
        {k.removeprefix(prefix): v for k, v in values.items() if k.startswith(prefix)},
    )


def _column(values: Iterable[Expression]) -> ca.SX:
    return ca.vcat([_symbolic(v) for v in values] or [ca.SX(0, 1)])


def _stack(
    model: Written, what: str, given: Mapping[str, Expression], declared: Sequence[Quantity]
) -> ca.SX:
    names = [q.name for q in declared]
    missing = [n for n in names if n not in given]
    extra = [n for n in given if n not in names]
    if missing or extra:
        problem = f"no {what} {missing[0]!r}" if missing else f"an undeclared {what} {extra[0]!r}"
        raise WorkbenchError(
            f"the equations of model {model.name!r} return {problem}; they must return one for each"
            f" of: {', '.join(names)}"
        )
    return _column(given[n] for n in names)
