"""Several effects of the same law as one: shared parameters, own states."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace

from workbench.errors import WorkbenchError
from workbench.model import Effect, EffectView, Names, PortView
from workbench.model.face import Expression


def _own(x: Names, number: int) -> Names:
    suffix = f"_{number}"
    return Names("state", {k.removesuffix(suffix): v for k, v in x.items() if k.endswith(suffix)})


def shared(effects: tuple[Effect, ...], *, name: str) -> Effect:
    """Join effects that differ in their ports only into one with a single set of parameters.

    Args:
        effects: The effects, with the same parameters and states but different ports.
        name: Name of the joint effect.

    Returns:
        Effect with the parameters of the first, on the ports of all; the states of the i-th effect
        have its number as a suffix.

    Raises:
        WorkbenchError: If the parameters differ or a port is used twice.

    Example:
        >>> from workbench.physics.line import line
        >>> both = shared((line(1), line(2)), name="lines")
        >>> [q.name for q in both.states], len(both.parameters)
        (['pressure_1', 'pressure_2'], 3)
    """
    ports = [port for effect in effects for port in effect.ports]
    if len(set(ports)) != len(ports):
        raise WorkbenchError(
            f"effects that share {name!r} act on the same port: {', '.join(ports)}"
        )
    if any(effect.parameters != effects[0].parameters for effect in effects):
        raise WorkbenchError(f"effects that share {name!r} differ in their parameters; align them")
    number_of = {port: i for i, effect in enumerate(effects) for port in effect.ports}

    def seen(at: PortView) -> PortView:
        i = number_of[at.port]
        return replace(at, index=effects[i].ports.index(at.port), x=_own(at.x, i + 1))

    def transform(at: PortView) -> Expression:
        return effects[number_of[at.port]].transform(seen(at))

    def each(
        functions: list[Callable[[EffectView], Mapping[str, Expression]] | None], view: EffectView
    ) -> Mapping[str, Expression]:
        result: dict[str, Expression] = {}
        for i, function in enumerate(functions):
            if function is not None:
                at = {k: seen(v) for k, v in view.at.items() if number_of[k] == i}
                own = replace(view, x=_own(view.x, i + 1), at=at)
                result |= {f"{k}_{i + 1}": v for k, v in function(own).items()}
        return result

    return Effect(
        name,
        tuple(ports),
        transform,
        parameters=effects[0].parameters,
        states=tuple(
            replace(q, name=f"{q.name}_{i + 1}")
            for i, effect in enumerate(effects)
            for q in effect.states
        ),
        rates=(lambda view: each([e.rates for e in effects], view)) if effects[0].states else None,
        start=(lambda view: each([e.start for e in effects], view)) if effects[0].states else None,
        about=effects[0].about,
    )
