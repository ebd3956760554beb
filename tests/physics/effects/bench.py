"""A bench for effects: a port whose signals are prescribed, and integrators for what follows."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from itertools import pairwise
from typing import Any

import casadi as ca
import numpy as np

from workbench.model import Effect, Input, Model, Output, Scope, State
from workbench.model.trace import Equations
from workbench.physics.library import Hypothesis, library
from workbench.physics.recorded_facts import RecordedFacts

Path = Callable[[float], Mapping[str, float]]


def bench(effect: Effect, unit: str = "N", *signals: str) -> Model:
    """Attach an effect to a port whose value and local signals are inputs; read what comes out.

    With several ports, each has the same inputs and an output of its own.
    """

    def equations(m: Scope) -> Equations:
        local = {name: m.u[name] for name in signals}
        outputs = {
            f"out_{i}": m.port(port, m.u.value, unit=unit, signals=local)
            for i, port in enumerate(effect.ports)
        }
        return {"clock": 1.0 + 0.0 * m.u.value}, outputs

    return Model(
        "bench",
        equations,
        states=(State("clock", "s"),),
        inputs=tuple(Input(name, "1") for name in ("value", *signals)),
        outputs=tuple(Output(f"out_{i}", unit) for i in range(len(effect.ports))),
    ).with_effect(effect)


def offered(model: Model, name: str, **known: Any) -> Hypothesis:
    """Return what the library offers a model by the name of a hypothesis, or of its law."""
    found = library(model, RecordedFacts(**known))
    return next(h for h in found if name == h.name or name == h.law)


def run(
    model: Model, path: Path, times: np.ndarray, *, start: Mapping[str, float] | None = None
) -> np.ndarray:
    """Return the first output over times, by Runge-Kutta of fourth order, ten steps per sample."""
    f, g = model.exact.rates_function, model.exact.outputs_function
    names, p = [q.name for q in model.inputs], model.values

    def inputs(instants: np.ndarray) -> np.ndarray:
        given = [path(float(t)) for t in instants]
        return np.array([[row.get(name, 0.0) for row in given] for name in names])

    fine = np.concatenate(
        [np.linspace(a, b, 10, endpoint=False) for a, b in pairwise(times)] + [times[-1:]]
    )
    h = np.diff(fine)
    x, u0, u1, u2 = (
        ca.SX.sym(n, len(q)) for n, q in zip("xabc", (model.states, *[names] * 3), strict=True)
    )
    step = ca.SX.sym("h")
    k1 = f(x, u0, p)
    k2 = f(x + step / 2 * k1, u1, p)
    k3 = f(x + step / 2 * k2, u1, p)
    k4 = f(x + step * k3, u2, p)
    after = x + step / 6 * (k1 + 2 * k2 + 2 * k3 + k4)
    walk = ca.Function("step", [x, u0, u1, u2, step], [after]).mapaccum(len(h))
    first = model.initial_state(start, u=inputs(times[:1])[:, 0])
    # The middle and the end of a step belong to it, also where the path has a corner or a jump.
    stages = [inputs(fine[:-1] + share * h) for share in (1e-9, 0.5, 1.0 - 1e-9)]
    states = np.asarray(walk(first, *stages, h))
    at_samples = np.column_stack([first, states[:, 9::10]])
    return np.asarray(g.map(len(times))(at_samples, inputs(times), p)).reshape(
        len(model.outputs), len(times)
    )[0]


def held(model: Model, levels: np.ndarray, interval: float = 0.1) -> list[np.ndarray]:
    """Return the output while each of some levels is held for a time, in s, in a hundred steps."""
    count, fine = len(levels), 100
    places = (np.arange(fine * count) + 1e-4) * interval / fine

    def path(t: float) -> Mapping[str, float]:
        return {"value": float(levels[min(int(t / interval), count - 1)])}

    return np.split(run(model, path, places), count)


def read(model: Model, **inputs: float) -> float:
    """Return the first output of a bench whose effect has no states."""
    u = [inputs.get(q.name, 0.0) for q in model.inputs]
    return float(model.read(model.initial_state(u=u), u)[0])


def response(model: Model, frequency: float) -> complex:
    """Return the frequency response from the first input to the first output, by derivatives."""
    x, u = model.initial_state(), model.nominal_input
    A, B, C, D = (np.asarray(m) for m in model.exact.jacobian_function(x, u, model.values))
    s = 1j * frequency
    return complex((C @ np.linalg.solve(s * np.eye(len(A)) - A, B[:, :1]) + D[:, :1])[0, 0])


def triangle(turns: list[float], speed: float) -> tuple[Path, np.ndarray, np.ndarray]:
    """Return a path of constant speed between turning points, its end times and sample times."""
    lengths = np.abs(np.diff(turns))
    ends = np.concatenate([[0.0], np.cumsum(lengths / speed)])

    def velocity(t: float) -> float:
        i = min(int(np.searchsorted(ends, t, side="right")) - 1, len(turns) - 2)
        return float(np.sign(turns[i + 1] - turns[i])) * speed

    def path(t: float) -> Mapping[str, float]:
        v = velocity(t)
        return {"speed": v, "contraction_speed": v}

    samples = np.concatenate(
        [np.linspace(a, b, 80, endpoint=False) for a, b in pairwise(ends)] + [ends[-1:]]
    )
    return path, ends, samples


def position(turns: list[float], ends: np.ndarray, times: np.ndarray) -> np.ndarray:
    """Return the position on a triangular path at given times."""
    return np.interp(times, ends, turns)
