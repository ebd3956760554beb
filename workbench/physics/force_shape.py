"""Other shapes of a muscle's static force: another law, slopes, and the term phi(q)."""

from __future__ import annotations

from workbench.model import About, Effect, Parameter, PortView
from workbench.model.face import Expression
from workbench.physics.force_laws import ForceLaw, PaperLaw, Sarosi

TENSIONS = ("muscle_1.tension", "muscle_2.tension")
"""Ports of the tensions of both muscles."""

REFERENCE_CONTRACTION = 0.03
"""Contraction at the end of the arm's travel, m."""

REFERENCE_PRESSURE = 3e5
"""Gauge pressure in the middle of the range, Pa."""


def _share(value: float, lower: float, upper: float, text: str) -> Parameter:
    return Parameter("share", "1", 0.5, text, value, lower, upper, fitted=True)


def force_shape(
    ports: tuple[str, ...] = TENSIONS,
    *,
    share: float = 1.0,
    law: ForceLaw | None = None,
    name: str = "force_shape",
) -> Effect:
    """Build a muscle that follows another static law in part or in whole.

    ``T = T + share [T_law(q, p) - T]``

    Args:
        ports: Ports of muscle tensions, with the local signals ``contraction`` and
            ``gauge_pressure``.
        share: Share of the other law, a fraction; 1 replaces the plant's law.
        law: The other law; Sarosi's by default.
        name: Name of the effect.

    Returns:
        Effect of size ``share``.

    Raises:
        WorkbenchError: If the share is outside its bounds.

    Example:
        >>> force_shape(share=0.5).parameters[0].value
        0.5
    """
    other = law or Sarosi()

    def transform(at: PortView) -> Expression:
        tension = other.tension(at.signals.contraction, at.signals.gauge_pressure, face=at.face)
        return at.value + at.p.share * (tension - at.value)

    return Effect(
        name,
        ports,
        transform,
        parameters=(_share(share, -0.5, 1.5, "share of the other law"),),
        about=About(
            "T = T + share (T_law(q, p) - T)",
            "J. Sarosi, Tehnicki vjesnik 22 (2015), for the DMSP-20-200N",
            look_alikes=("contraction_force_correction", "linear_spring", "series_elasticity"),
            separated_by="isometric pressure ramps at several contractions with a load cell",
        ),
    )


def contraction_force_correction(
    ports: tuple[str, ...] = TENSIONS,
    *,
    gain: float = 0.1,
    name: str = "contraction_force_correction",
) -> Effect:
    """Build a force that falls faster or slower with contraction than the law says.

    ``T = T [1 + gain (2 q / q_end - 1)]``: unchanged in the middle of the travel, by ``gain`` more
    at its end and less at its start.

    Args:
        ports: Ports of muscle tensions, with the local signal ``contraction``.
        gain: Relative change at 30 mm, a fraction.
        name: Name of the effect.

    Returns:
        Effect of size ``gain``.

    Raises:
        WorkbenchError: If the gain is outside its bounds.

    Example:
        >>> contraction_force_correction().parameters[0].upper
        0.6
    """

    def transform(at: PortView) -> Expression:
        along = 2.0 * at.signals.contraction / REFERENCE_CONTRACTION - 1.0
        return at.value * (1.0 + at.p.gain * along)

    return Effect(
        name,
        ports,
        transform,
        parameters=(
            Parameter("gain", "1", 0.1, "relative change at 30 mm", gain, -0.6, 0.6, fitted=True),
        ),
        about=About(
            "T = T [1 + gain (2 q / q_end - 1)]",
            "first-order correction of the force over contraction; scatter between muscles",
            look_alikes=("force_shape", "linear_spring", "series_elasticity"),
            separated_by="isometric pressure ramps at several contractions with a load cell",
        ),
    )


def pressure_force_correction(
    ports: tuple[str, ...] = TENSIONS,
    *,
    gain: float = 0.05,
    name: str = "pressure_force_correction",
) -> Effect:
    """Build a force that is not proportional to pressure as the law says.

    ``T = T [1 + gain (p / p_mid - 1)]`` with p_mid = 3 bar gauge.

    Args:
        ports: Ports of muscle tensions, with the local signal ``gauge_pressure``.
        gain: Relative change at 6 bar gauge, a fraction.
        name: Name of the effect.

    Returns:
        Effect of size ``gain``.

    Raises:
        WorkbenchError: If the gain is outside its bounds.

    Example:
        >>> pressure_force_correction().parameters[0].value
        0.05
    """

    def transform(at: PortView) -> Expression:
        return at.value * (1.0 + at.p.gain * (at.signals.gauge_pressure / REFERENCE_PRESSURE - 1.0))

    return Effect(
        name,
        ports,
        transform,
        parameters=(
            Parameter("gain", "1", 0.05, "relative change at 6 bar", gain, -0.4, 0.4, fitted=True),
        ),
        about=About(
            "T = T [1 + gain (p / p_mid - 1)]",
            "first-order correction of the force over pressure; dead pressure of the tube",
            look_alikes=("force_shape", "sensor_gain", "force_gain"),
            separated_by="the same angle held at low and at high mean pressure",
        ),
    )


def phi_term(
    ports: tuple[str, ...] = TENSIONS, *, share: float = 1.0, name: str = "phi_term"
) -> Effect:
    """Build the pressure-independent term phi(q) of the paper's force law, in part or in whole.

    ``T = T + share phi(q)``

    Args:
        ports: Ports of muscle tensions, with the local signal ``contraction``.
        share: Share of phi(q), a fraction.
        name: Name of the effect.

    Returns:
        Effect of size ``share``.

    Raises:
        WorkbenchError: If the share is outside its bounds.

    Example:
        >>> phi_term().parameters[0].value
        1.0
    """
    paper = PaperLaw()

    def transform(at: PortView) -> Expression:
        return at.value + at.p.share * paper.phi(at.signals.contraction, face=at.face)

    return Effect(
        name,
        ports,
        transform,
        parameters=(_share(share, 0.0, 2.0, "share of phi(q)"),),
        about=About(
            "T + phi(q)",
            "equation (4) and line [1] of the paper's Figure 3",
            look_alikes=("linear_spring", "contraction_force_correction"),
            separated_by="the same angle held at low and at high mean pressure",
        ),
    )
