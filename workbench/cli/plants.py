"""The verb ``plants``."""

from __future__ import annotations

import math
from pathlib import Path

import typer


def plants(name: str | None = None) -> int:
    """List the plants, or what one takes: options, inputs, outputs, parameters, laws to attach.

    Example: 'workbench plants arm'.

    Args:
        name ([NAME]): Plant, or module:object of your own.
    """
    from workbench.model.units import with_unit, written_unit
    from workbench.physics.library import library
    from workbench.plants.registry import PLANTS

    if name is None:
        for plant in PLANTS.members().values():
            typer.echo(f"{plant.name:<16}{plant.summary}")
        return 0
    plant = PLANTS.get(name, folder=Path.cwd())
    model = plant.model()
    typer.echo(str(plant))
    for kind in ("inputs", "outputs", "states"):
        named = (
            f"{q.name} ({written_unit(q.unit) or 'ratio'}"
            f"{'' if getattr(q, 'commanded', True) else ', only measured'})"
            for q in getattr(model, kind)
        )
        typer.echo(f"  {kind}: {', '.join(named) or 'none'}")
    typer.echo(f"  parameters:{'' if model.parameters else ' none'}")
    for q in model.parameters:
        known = "" if q.lower == -math.inf else f", {q.lower:g} to {q.upper:g}"
        value = with_unit(f"{q.value:.6g}", q.unit)
        typer.echo(f"    {q.name:<32} {value}{known}{', refitted' if q.fitted else ''}")
    typer.echo(f"  effects: {', '.join(effect.name for effect in model.effects) or 'none'}")
    offered = sorted(hypothesis.name for hypothesis in library(model))
    typer.echo(f"  --effect takes: {', '.join(offered) or 'only what is your own'}")
    return 0
