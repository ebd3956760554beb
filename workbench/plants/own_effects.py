"""Effects of the user's own, named as ``module:object``, beside those of the library."""

from __future__ import annotations

import inspect
from collections.abc import Iterable, Sequence
from pathlib import Path

import numpy as np

from workbench.errors import WorkbenchError
from workbench.model import Effect, Model
from workbench.physics.hypothesis import Hypothesis
from workbench.physics.law import Law
from workbench.registry import load_object, user_code


def own_laws(
    model: Model, references: Sequence[str], *, folder: Path | None = None
) -> tuple[Hypothesis | Law, ...]:
    """Return effects of the user's own, to be offered beside the library.

    Args:
        references: Each ``module:object``: a law, an effect, a hypothesis, several of them, or a
            function that returns them, called with the model if it takes an argument.
        folder: Where the modules stand, beside the Python path.

    Raises:
        WorkbenchError: If an object is none of these.
    """
    return tuple(item for name in references for item in _own(model, name, folder))


def _own(model: Model, reference: str, folder: Path | None) -> list[Hypothesis | Law]:
    found = load_object("effect", reference, folder=folder)
    if callable(found) and not isinstance(found, (Effect, Hypothesis, Law)):
        with user_code(f"effect {reference!r}"):
            required = [
                p
                for p in inspect.signature(found).parameters.values()
                if p.default is p.empty and p.kind is not p.VAR_KEYWORD
            ]
            found = found(model) if required else found()
    several = found if isinstance(found, Iterable) else (found,)
    return [_hypothesis(item, reference) for item in several]


def _hypothesis(item: object, reference: str) -> Hypothesis | Law:
    if isinstance(item, (Hypothesis, Law)):
        return item
    if not isinstance(item, Effect) or not item.parameters:
        raise WorkbenchError(
            f"effect {reference!r} gave a {type(item).__name__}; it must be an Effect with a"
            " parameter for its size, a Law or a Hypothesis"
        )
    size = item.parameters[0]
    largest = max(abs(size.lower), abs(size.upper))
    # Bounds are all that the user says of sizes; beyond them nothing is plausible.
    typical = abs(size.value) or (0.2 * largest if np.isfinite(largest) else size.scale)
    return Hypothesis(item.with_parameters({size.name: 0.0}), size.name, typical)
