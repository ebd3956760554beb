"""Nonlinear systems of python-control, and functions and DAEs of CasADi, as models."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from typing import Any

import casadi as ca
import numpy as np

from workbench.errors import WorkbenchError
from workbench.model.linear_system import is_nonlinear, labels, signal_names
from workbench.model.model import Model
from workbench.model.quantities import Input, Output, Parameter, State
from workbench.model.scope import Scope
from workbench.model.trace import Equations

_NEXT = re.compile(r"xf|.*(next|plus|k1|k_1)", re.IGNORECASE)
"""What the state after a step is called."""


@dataclass(frozen=True)
class RateEquations:
    """Equations ``dx/dt = f(x, u)``, ``y = h(x, u)`` that a function of vectors states.

    Args:
        both: Returns f and h of x, u and the parameters by name, each with as many entries as there
            are names.
    """

    both: Callable[[Any, Any, Mapping[str, Any]], tuple[Any, Any]]
    states: tuple[str, ...]
    inputs: tuple[str, ...]
    outputs: tuple[str, ...]

    def __call__(self, m: Scope) -> Equations:
        f, h = self.both(
            _vector(getattr(m.x, n) for n in self.states),
            _vector(getattr(m.u, n) for n in self.inputs),
            {name: getattr(m.p, name) for name in m.p},
        )
        return _named("rates", self.states, f), _named("outputs", self.outputs, h)


def is_rates(found: object) -> bool:
    """Tell whether an object is a nonlinear system of python-control or of CasADi."""
    dae = isinstance(found, dict) and {"x", "ode"} <= found.keys()
    return dae or isinstance(found, ca.Function) or is_nonlinear(found)


def model_of_rates(system: Any) -> Model:
    """Return a nonlinear system as a plant, in which no quantity has a unit.

    Args:
        system: ``control.nlsys``, of which parameters with a number may be refitted; a
            ``casadi.Function`` of x and u that returns dx/dt, and the outputs if it has a second
            result; or a DAE of CasADi, ``{"x": ..., "u": ..., "ode": ...}``. Without outputs all
            states are measured.

    Raises:
        WorkbenchError: If it is sampled, depends on time, or has algebraic equations.
    """
    title = str(getattr(system, "name", "system"))
    if isinstance(system, (dict, ca.Function)):
        title, both, names = _of_casadi(system)
        free: dict[str, float] = {}
    else:
        title = "nonlinear system" if system.name.startswith("sys[") else system.name
        if getattr(system, "dt", None):
            raise WorkbenchError(
                f"system {title!r} is sampled; give its rates in continuous time, dx/dt = f(x, u)"
            )
        both = _of_control(system, title)
        driven, measured = system.input_labels, system.output_labels
        names = labels(system.state_labels), signal_names(driven), signal_names(measured)
        free = {k: float(v) for k, v in system.params.items() if isinstance(v, (int, float)) and v}
    states, inputs, outputs = names
    return Model(
        labels([title])[0],
        RateEquations(both, *names),
        states=tuple(State(name, "1") for name in states),
        inputs=tuple(Input(name, "1") for name in inputs),
        outputs=tuple(Output(name, "1") for name in outputs),
        parameters=tuple(
            # A refit takes a quarter of the range for what is uncertain: as much as there is.
            Parameter(n, "1", value=v, lower=min(0.0, 4 * v), upper=max(0.0, 4 * v), fitted=True)
            for n, v in free.items()
        ),
        description="nonlinear system",
    )


def _of_control(
    system: Any, title: str
) -> Callable[[Any, Any, Mapping[str, Any]], tuple[Any, Any]]:
    def both(x: Any, u: Any, p: Mapping[str, Any]) -> tuple[Any, Any]:
        known = {**system.params, **p}
        symbol = next((v for v in x if isinstance(v, (ca.SX, ca.MX))), None)
        time = 0.0 if symbol is None else symbol.sym("t")
        f = system.updfcn(time, x, u, known)
        h = x if system.outfcn is None else system.outfcn(time, x, u, known)
        told = [v for v in (*_listed(f), *_listed(h)) if isinstance(v, (ca.SX, ca.MX))]
        if symbol is not None and told and ca.depends_on(ca.vertcat(*told), time):
            raise WorkbenchError(
                f"system {title!r} depends on the time; make what changes with it an input"
            )
        return f, h

    return both


def _of_casadi(system: Any) -> tuple[str, Any, tuple[tuple[str, ...], ...]]:
    if isinstance(system, dict):
        if "alg" in system:
            raise WorkbenchError(
                "the DAE has algebraic equations ('alg'); solve them for z, and give 'ode' alone"
            )
        given = [system["x"], system.get("u", system.get("p", ca.SX(0, 1)))]
        system = ca.Function("dae", given, [system["ode"]])
    sizes = [system.size1_in(i) for i in range(system.n_in())]
    if len(sizes) != 2 or not system.n_out() or system.size1_out(0) != sizes[0]:
        raise WorkbenchError(
            f"function {system.name()!r} of CasADi is {system}; a plant is one of x and u that"
            " returns dx/dt, and the outputs if it has a second result"
        )
    if _NEXT.fullmatch(system.name_out(0)):
        raise WorkbenchError(
            f"function {system.name()!r} of CasADi returns {system.name_out(0)!r}, the state after"
            " a step; a plant returns dx/dt"
        )
    measured = system.size1_out(1) if system.n_out() > 1 else sizes[0]

    def both(x: Any, u: Any, _: Mapping[str, Any]) -> tuple[Any, Any]:
        found = system.call([ca.vertcat(*x), ca.vertcat(*u)])
        return ca.vertsplit(found[0]), ca.vertsplit(found[1]) if len(found) > 1 else x

    counts = (("x", sizes[0]), ("u", sizes[1]), ("y", measured))
    return system.name(), both, tuple(_numbered(*count) for count in counts)


def _numbered(letter: str, count: int) -> tuple[str, ...]:
    return (letter,) if count == 1 else tuple(f"{letter}_{i}" for i in range(count))


def _vector(values: Iterable[Any]) -> Any:
    """Return symbols as an array, which calculates with them one by one."""
    listed = list(values)
    found = np.empty(len(listed), object)
    found[:] = listed
    return found


def _named(what: str, names: tuple[str, ...], values: Any) -> dict[str, Any]:
    listed = _listed(values)
    if len(listed) != len(names):
        raise WorkbenchError(f"the system returns {len(listed)} {what} instead of {len(names)}")
    return dict(zip(names, listed, strict=True))


def _listed(values: Any) -> list[Any]:
    return ca.vertsplit(values) if isinstance(values, (ca.SX, ca.MX)) else list(np.ravel(values))
