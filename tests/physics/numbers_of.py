"""Numbers of laws: written down in CasADi symbols, and of a restriction as ISO 6358 rates it."""

from __future__ import annotations

from typing import Any

import casadi as ca
import numpy as np

from workbench.physics.flow import orifice_flow


def on_symbols(law: Any, *at: Any) -> Any:
    """Return what a law gives at arrays of one shape: its result, or each of several."""
    x = [ca.SX.sym("x") for _ in at]
    found = law(*x)
    several = isinstance(found, (tuple, list))
    function = ca.Function("law", x, list(found) if several else [found])
    values = function.call([ca.DM(np.ravel(value)).T for value in at])
    shaped = [np.array(value).reshape(np.shape(at[0])) for value in values]
    return shaped if several else shaped[0]


def slope_of(law: Any, at: Any) -> Any:
    """Return the derivative of a law of one argument."""
    return on_symbols(lambda x: ca.jacobian(law(x), x), at)


def iso6358(up: Any, down: Any, temperature: Any, c: Any, b: Any, **form: Any) -> Any:
    """Return the flow from a high to a low pressure at one temperature."""
    return orifice_flow(up, down, temperature, temperature, c, b, **form)
