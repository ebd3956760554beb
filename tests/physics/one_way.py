"""Flow from a high to a low pressure at one temperature, as ISO 6358 rates a restriction."""

from __future__ import annotations

from typing import Any

from workbench.model.regularisation import EXACT, Form
from workbench.physics.flow import orifice_flow


def iso6358(up: Any, down: Any, temperature: Any, c: Any, b: Any, *, form: Form = EXACT) -> Any:
    return orifice_flow(up, down, temperature, temperature, c, b, form=form)
