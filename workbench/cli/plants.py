"""The verb ``plants``."""

from __future__ import annotations

import math
from pathlib import Path
from textwrap import TextWrapper

import typer


def plants(name: str | None = None) -> None:
    """List the plants, or what one takes: options, inputs, outputs, parameters, laws to attach.

    Example: 'workbench plants arm'.

    Args:
        name ([NAME]): Plant, or module:object of your own.
    """
    from workbench.model.quantities import shown_in
    from workbench.model.units import from_si, with_unit, written_unit
    from workbench.physics.library import library
    from workbench.plants.registry import PLANTS

    if name is None:
        for plant in PLANTS.members().values():
            typer.echo(f"{plant.name:<16}{plant.summary}")
        return
    plant = PLANTS.get(name, folder=Path.cwd())
    model = plant.model()
    typer.echo(str(plant))
    for kind in ("inputs", "outputs", "states"):
        named = (
            f"{q.name} ({written_unit(shown_in(q)) or 'ratio'}"
            f"{'' if getattr(q, 'commanded', True) else ', only measured'})"
            for q in getattr(model, kind)
        )
        typer.echo(f"  {kind}: {', '.join(named) or 'none'}")
    typer.echo(f"  parameters:{'' if model.parameters else ' none'}")
    for q in model.parameters:
        unit = shown_in(q)
        value, lower, upper = (from_si(one, unit) for one in (q.value, q.lower, q.upper))
        known = "" if lower == -math.inf else f", {lower:g} to {upper:g}"
        told = with_unit(f"{value:.6g}", unit)
        typer.echo(f"    {q.name:<32} {told}{known}{', refitted' if q.fitted else ''}")
    typer.echo(f"  effects: {', '.join(effect.name for effect in model.effects) or 'none'}")
    offered: dict[str, list[str]] = {}
    for hypothesis in library(model):
        offered.setdefault(hypothesis.law, []).append(hypothesis.name)
    typer.echo(f"  --effect takes:{'' if offered else ' only what is your own'}")
    # A line per law, with its places.
    lines = TextWrapper(100, initial_indent="    ", subsequent_indent="      ")
    for law in sorted(offered):
        typer.echo(lines.fill(", ".join(sorted(offered[law]))))
