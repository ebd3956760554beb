"""The verb ``linearise``."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from io import BytesIO
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import typer

from workbench.cli.options import AsJson
from workbench.cli.plant import Chosen, with_plant
from workbench.cli.running import tell
from workbench.files import write_whole

if TYPE_CHECKING:
    from workbench.linearisation import LinearModel


@with_plant("option", "effect", "at")
def linearise(
    chosen: Chosen, *, verdict: bool = False, out: Path | None = None, as_json: AsJson = False
) -> None:
    """Trim a plant and print its linear model: modes, and how far to trust it.

    Of several commands and outputs that they hold independently, relative gains, pairs of single
    loops and ill conditioning too, and zeros in the right half plane.

    Examples: 'workbench linearise --angle 30deg --load 3kg --mean-pressure 3bar --verdict',
    'workbench linearise --plant my_plants:circuit --at voltage=2V'.

    Args:
        verdict: Also simulate how large and how fast a motion may be (seconds).
        out: JSON or MATLAB .mat file for the operating point and the matrices A, B, C, D, in SI.
    """
    from workbench.linearisation import linearise as linear_model
    from workbench.operating_point import operating_point

    point = operating_point(chosen.model, chosen.design_point)
    linear = linear_model(point)
    typer.echo(f"{point}\n\n{linear}", err=as_json)
    for sentence in _interaction(linear, [q.name for q in chosen.model.commands]):
        typer.echo(f"  {sentence}", err=as_json)
    if verdict and linear.verdict is not None:
        typer.echo(f"\n{linear.verdict.amplitude}\n{linear.verdict.frequency}", err=as_json)
    if out is not None or as_json:
        content = {
            "plant": chosen.plant.name,
            "given": dict(point.given),
            "states": dict(zip(linear.state_names, linear.x0.tolist(), strict=True)),
            "inputs": dict(zip(linear.input_names, linear.u0.tolist(), strict=True)),
            "outputs": dict(zip(linear.output_names, linear.y0.tolist(), strict=True)),
            **{name: getattr(linear, name).tolist() for name in "ABCD"},
        }
        to_matlab = out is not None and out.suffix.lower() == ".mat"
        tell(content, as_json=as_json, file=None if to_matlab else out)
        if out is not None and to_matlab:
            write_whole(out, _matlab(content))
            typer.echo(f"written to {out}: load it and take ss(A, B, C, D)", err=as_json)


def _matlab(content: Mapping[str, Any]) -> bytes:
    """Return matrices, points of rest as columns ``x0``, ``u0``, ``y0``, and their names."""
    from scipy.io import savemat

    variables: dict[str, Any] = {name: np.atleast_2d(content[name]) for name in "ABCD"}
    for key, letter in (("states", "x"), ("inputs", "u"), ("outputs", "y")):
        at_rest = content[key]
        variables[f"{letter}0"] = np.reshape(list(at_rest.values()), (-1, 1))
        variables[key] = np.array(list(at_rest), dtype=object)
    file = BytesIO()
    savemat(file, variables, oned_as="column")
    return file.getvalue()


def _interaction(linear: LinearModel, commands: Sequence[str]) -> list[str]:
    """Return what outputs that commands hold independently mean to each other, or do at first."""
    from controllers.plain.loop import held_outputs, loop_of
    from controllers.plain.pairing import interaction, wrong_way

    followed = held_outputs(linear, commands) if set(commands) <= set(linear.input_names) else ()
    if not followed:
        return []
    loop = loop_of(linear, followed)
    return interaction(loop) if len(followed) > 1 else wrong_way(loop)
