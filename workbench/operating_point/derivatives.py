"""Rates, measurements and all their derivatives at a point, in one call without conversions.

Units: SI; states x, shape (n_x,), inputs u, shape (n_u,), and parameters p, shape (n_p,).
"""

from __future__ import annotations

import threading
from functools import lru_cache
from typing import cast
from weakref import WeakKeyDictionary

import casadi as ca

from workbench.arrays import Vector
from workbench.computing.buffered import Buffered
from workbench.model import Form, Model, Trace

_LOCAL = threading.local()


class Derivatives:
    """Evaluates rates and measurements of one form of a model with their automatic derivatives.

    Args:
        form: Exact or regularised equations. On a kink the exact form gives the mean of both sides
            where the kink is a maximum or minimum.
    """

    def __init__(self, model: Model, form: Form | str) -> None:
        """Build the functions, or take those built for the same equations before."""
        traced = model.form(form)
        self._values = Buffered(_values_function(traced))
        self._both = Buffered(_both_function(traced))

    def values(self, x: Vector, u: Vector, p: Vector) -> Vector:
        """Compute rates, then measurements, shape (n_x + n_y,), in SI."""
        return self._values(x, u, p)[0].flatten()

    def __call__(self, x: Vector, u: Vector, p: Vector) -> tuple[Vector, Vector]:
        """Compute rates and measurements, shape (n_x + n_y,), and their derivatives, in SI.

        The derivatives are by states and inputs, shape (n_x + n_y, n_x + n_u).
        """
        table = self._both(x, u, p)[0].copy()
        return table[:, 0], table[:, 1:]


def derivatives_of(model: Model, form: Form | str) -> Derivatives:
    """Return the derivatives of a model, built once for the same equations."""
    # Buffers are written to during a call, so each thread has its own.
    if not hasattr(_LOCAL, "known"):
        _LOCAL.known = WeakKeyDictionary()
    traced = model.form(form)
    if traced not in _LOCAL.known:
        _LOCAL.known[traced] = Derivatives(model, form)
    return cast(Derivatives, _LOCAL.known[traced])


@lru_cache(maxsize=64)
def _values_function(traced: Trace) -> ca.Function:
    return traced.function("values", ca.densify(ca.vertcat(traced.rates, traced.outputs)))


@lru_cache(maxsize=64)
def _both_function(traced: Trace) -> ca.Function:
    values = ca.vertcat(traced.rates, traced.outputs)
    jacobian = ca.jacobian(values, ca.vertcat(traced.x, traced.u))
    return traced.function("values_and_derivatives", ca.densify(ca.horzcat(values, jacobian)))
