"""Tight reference route: scipy.integrate.solve_ivp on the derivative of the rig."""

from __future__ import annotations

import itertools

import numpy as np
from numpy.typing import NDArray
from scipy.integrate import solve_ivp

from workbench.evaluation.rig import plant

Array = NDArray[np.float64]


def run(
    parameters: dict[str, float],
    state: Array,
    command: Array,
    *,
    sample: float = 2e-3,
    method: str = "Radau",
    rtol: float = 1e-9,
) -> Array:
    """Integrate with one command in volt per sample; return the states at the samples.

    Each stretch of constant command is one call, so no jump of the input lies inside a step.
    Radau also passes the kinks of Maxwell-slip elements, on which LSODA stalls.
    """
    sizes = {
        "mass": 1e-3, "energy": 100.0, "spool_speed": 100.0, "creep": 1e5, "slip": 1e-3,
        "bristle": 1e-3, "fibre": 0.1, "reservoir": 1e-3, "exhaust": 1e-4, "line": 1e-4,
    }  # fmt: skip
    scale = np.ones(len(plant.STATES))
    for name, size in sizes.items():
        for i, state_name in enumerate(plant.STATES):
            if state_name.startswith(name):
                scale[i] = size
    on = np.flatnonzero(plant.derivative(1.01 * state + 1e-6, 6.0, parameters))  # states in use
    edges = [0, *(np.flatnonzero(np.diff(command)) + 1), len(command)]
    out = np.empty((len(command), len(state)))
    x = np.array(state, float)
    for i, j in itertools.pairwise(edges):
        t = np.arange(j - i + 1) * sample
        u = float(command[i])

        def rhs(_: float, y: Array, u: float = u, rest: Array = x) -> Array:
            full = rest.copy()
            full[on] = y
            return plant.derivative(full, u, parameters)[on]

        solution = solve_ivp(
            rhs, (0.0, t[-1]), x[on], method=method, t_eval=t, rtol=rtol, atol=rtol * scale[on]
        )
        if not solution.success:
            raise RuntimeError(solution.message)
        out[i:j] = x
        out[i:j, on] = solution.y.T[:-1]
        x = x.copy()
        x[on] = solution.y[:, -1]
    return out
