"""Play: a follower that stays until its slack is taken up."""

from __future__ import annotations

from collections.abc import Mapping

from workbench.model import About, Effect, EffectView, Parameter, PortView, State
from workbench.model.face import Expression, maximum
from workbench.physics.elastoplastic import elastoplastic_rate


def _slack(
    port: str,
    size: Parameter,
    shape: tuple[Parameter, ...],
    *,
    speed_signal: str,
    own_reach: bool,
    floor: float,
    about: About,
    name: str,
) -> Effect:
    def transform(at: PortView) -> Expression:
        return at.value - at.p[size.name] * at.x.slack

    def rates(effect: EffectView) -> Mapping[str, Expression]:
        at = effect.at[port]
        reach = effect.p.reach if own_reach else effect.p[size.name] + floor
        return {
            "slack": elastoplastic_rate(
                at.signals[speed_signal], effect.x.slack, reach, 0.01 * floor, face=effect.face
            )
        }

    return Effect(
        name,
        (port,),
        transform,
        parameters=(size, *shape),
        states=(State("slack", "1", 1.0, "slack taken up, -1 to 1", 0.0, -1.05, 1.05, 0.5),),
        rates=rates,
        about=about,
    )


def play(
    port: str = "valve.spool",
    *,
    half_width: float = 0.03,
    floor: float = 0.005,
    speed_signal: str = "speed",
    unit: str = "V",
    upper: float = 0.5,
    typical: float = 0.03,
    name: str = "play",
) -> Effect:
    """Build mechanical play: the signal follows its cause with a slack to both sides.

    ``y = u - half_width z`` with an elasto-plastic z that reaches 1 after ``half_width + floor`` of
    motion. With floor 0 it is the play operator: after a reversal y stays until u has moved by
    twice the half-width. The floor keeps the equation regular at zero width.

    Args:
        port: Port with the local signal ``speed_signal``.
        half_width: Half of the slack, in ``unit``.
        floor: Motion added to the reach, in ``unit``; small beside the usual half-width.
        speed_signal: Name of the local signal that is the rate of the port's signal.
        unit: Unit of the port.
        upper: Largest plausible half-width, in ``unit``.
        typical: Usual half-width, in ``unit``; scales the fit.
        name: Name of the effect.

    Returns:
        Effect of size ``half_width`` with one state.

    Raises:
        WorkbenchError: If the half-width is outside its bounds.

    Example:
        >>> play().states[0].name
        'slack'
    """
    return _slack(
        port,
        Parameter(
            "half_width", unit, typical, "half of the slack", half_width, 0.0, upper, fitted=True
        ),
        (),
        speed_signal=speed_signal,
        own_reach=False,
        floor=floor,
        about=About(
            "y = u - w z, z elasto-plastic with reach w",
            "Krasnosel'skii and Pokrovskii 1989, play operator",
            look_alikes=("command_play", "spool_hysteresis", "dead_band"),
            separated_by="slow triangles of several amplitudes about the centre",
        ),
        name=name,
    )


def spool_hysteresis(
    port: str = "valve.spool",
    *,
    half_width: float = 0.02,
    reach: float = 0.05,
    speed_signal: str = "speed",
    unit: str = "V",
    upper: float = 0.5,
    typical: float = 0.02,
    name: str = "spool_hysteresis",
) -> Effect:
    """Build hysteresis of a spool: friction and magnetism hold it back by a constant amount.

    ``y = u - half_width z`` with an elasto-plastic z that turns over ``reach`` of motion.

    Args:
        port: Port with the local signal ``speed_signal``.
        half_width: Half of the loop's width, in ``unit``.
        reach: Motion over which the loop turns, in ``unit``.
        speed_signal: Name of the local signal that is the rate of the port's signal.
        unit: Unit of the port.
        upper: Largest plausible half-width, in ``unit``.
        typical: Usual half-width, in ``unit``; scales the fit.
        name: Name of the effect.

    Returns:
        Effect of size ``half_width`` with one state.

    Raises:
        WorkbenchError: If a value is outside its bounds.

    Example:
        >>> [q.name for q in spool_hysteresis().parameters]
        ['half_width', 'reach']
    """
    return _slack(
        port,
        Parameter(
            "half_width", unit, typical, "half of the loop", half_width, 0.0, upper, fitted=True
        ),
        (
            Parameter(
                "reach",
                unit,
                reach,
                "motion over which the loop turns",
                reach,
                0.1 * reach,
                20.0 * reach,
                "estimate",
                fitted=True,
            ),
        ),
        speed_signal=speed_signal,
        own_reach=True,
        floor=0.1 * reach,
        about=About(
            "y = u - w z, z elasto-plastic",
            "manufacturer: hysteresis at most 0.4 % of stroke",
            look_alikes=("play", "dead_band"),
            separated_by="slow triangles of several amplitudes about the centre",
        ),
        name=name,
    )


def command_play(
    port: str = "valve.command",
    *,
    half_width: float = 0.03,
    floor: float = 0.001,
    time_constant: float = 0.002,
    unit: str = "V",
    upper: float = 0.5,
    typical: float = 0.03,
    name: str = "command_play",
) -> Effect:
    """Build play of a command that is held and jumps: what follows stays within a half-width of it.

    ``y = u - clip(u - s, -w, w)`` with a follower s that moves to within ``w + floor`` of u at
    ``1 / time_constant``. A jump beyond the slack is followed at once, as by the play operator; no
    rate of u is needed.

    Args:
        port: Port of the command.
        half_width: Half of the slack w, in ``unit``.
        floor: Slack that is added to the follower's, in ``unit``; small beside the usual
            half-width.
        time_constant: Time in which the follower comes near, s.
        unit: Unit of the port.
        upper: Largest plausible half-width, in ``unit``.
        typical: Usual half-width, in ``unit``; scales the fit.
        name: Name of the effect.

    Returns:
        Effect of size ``half_width`` with one state.

    Raises:
        WorkbenchError: If the half-width is outside its bounds.

    Example:
        >>> command_play().states[0].name
        'follower'
    """

    def magnitude(value: Expression) -> Expression:
        return maximum(value, -value)

    def transform(at: PortView) -> Expression:
        e, w = at.value - at.x.follower, at.p.half_width
        # The clipped value, written so that its derivative by w at w = 0 is the sign of e.
        return at.value - 0.5 * (magnitude(e + w) - magnitude(e - w))

    def rates(effect: EffectView) -> Mapping[str, Expression]:
        e, w = effect.at[port].value - effect.x.follower, effect.p.half_width + floor
        return {"follower": (maximum(e - w, 0.0) - maximum(-e - w, 0.0)) / time_constant}

    def start(effect: EffectView) -> Mapping[str, Expression]:
        # Somewhere within its slack: a start in the middle would have no derivative at size zero.
        return {"follower": effect.at[port].value - floor}

    return Effect(
        name,
        (port,),
        transform,
        parameters=(
            Parameter(
                "half_width",
                unit,
                typical,
                "half of the slack",
                half_width,
                0.0,
                upper,
                fitted=True,
            ),
        ),
        states=(State("follower", unit, 1.0, "position of the follower"),),
        rates=rates,
        start=start,
        about=About(
            "y = u - clip(u - s, -w, w), s within w of u",
            "Krasnosel'skii and Pokrovskii 1989, play operator",
            look_alikes=("play", "spool_hysteresis", "dead_band"),
            separated_by="slow triangles of several amplitudes about the centre",
        ),
    )
