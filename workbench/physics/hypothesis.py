"""A hypothesis: an effect at zero size that a model may lack, and how large it usually is."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from typing import Literal

from workbench.errors import check_choice
from workbench.model import Effect, Parameter

Group = Literal["process", "sensor"]


@dataclass(frozen=True)
class Hypothesis:
    """An effect that a model may lack.

    Args:
        effect: The effect at zero size: attached, it changes nothing but has a derivative.
        size_parameter: Short name of the parameter whose zero means absent.
        typical_size: Usual magnitude, in the parameter's unit.
        law: Name of the law; the effect's name may add where it acts.
        shapes: Values of other parameters worth trying before a fit, in their units, by short name;
            like all that follows but the last as `workbench.physics.law.Law` has it.
        details: Values of details from which their refit begins, in their units.
        alone: The same law at each of its places alone, where several share its parameters.

    Example:
        >>> from workbench.physics.library import library
        >>> from workbench.plants.arm import arm
        >>> hypothesis = next(h for h in library(arm()) if h.name == "stribeck_friction")
        >>> hypothesis.size_parameter, hypothesis.unit, hypothesis.typical_size
        ('break_away', 'N m', 1.0)
    """

    effect: Effect
    size_parameter: str
    typical_size: float
    group: Group = "process"
    law: str = ""
    shapes: tuple[Mapping[str, float], ...] = ({},)
    details: Mapping[str, float] = field(default_factory=dict)
    stiff: bool = False
    whole: bool = False
    far: bool = False
    same_as: tuple[str, ...] = ()
    alone: tuple[Hypothesis, ...] = ()
    usual: bool = False
    evident: bool = False

    def __post_init__(self) -> None:
        names = [q.name for q in self.effect.parameters]
        check_choice(f"parameter of effect {self.effect.name}", self.size_parameter, names)
        check_choice("group", self.group, ("process", "sensor"))
        if not self.law:
            object.__setattr__(self, "law", self.effect.name)

    @property
    def name(self) -> str:
        """Name of the effect."""
        return self.effect.name

    @property
    def comes_once(self) -> bool:
        """Whether it is an event that does not come again by itself."""
        return bool(self.effect.about.moment) and not self.effect.about.period

    @property
    def ports(self) -> tuple[str, ...]:
        """Ports on which it acts."""
        return self.effect.ports

    @property
    def size(self) -> Parameter:
        """The parameter whose zero means absent, with its unit and bounds."""
        return next(q for q in self.effect.parameters if q.name == self.size_parameter)

    @property
    def size_name(self) -> str:
        """Name of that parameter in a model to which the effect is attached."""
        return f"{self.effect.name}.{self.size_parameter}"

    @property
    def unit(self) -> str:
        """Unit of the size."""
        return self.size.unit

    @property
    def largest_size(self) -> float:
        """Largest plausible magnitude, in the size's unit."""
        return max(abs(self.size.lower), abs(self.size.upper))

    @property
    def signed(self) -> bool:
        """Whether the size may be negative."""
        return self.size.lower < 0.0

    @property
    def replaces(self) -> bool:
        """Whether the size is the share of a law that is either there or not.

        A fit then holds the size at 1 and frees the other parameters.
        """
        return not self.size.fitted

    @property
    def advanced(self) -> dict[str, float]:
        """By how much recordings are moved ahead for the attached effect, in s, by parameter."""
        own, advance = self.effect.parameters, self.effect.about.advance
        return {f"{self.effect.name}.{q.name}": q.value for q in own if q.name == advance}

    @property
    def absent(self) -> dict[str, float]:
        """Values at which the attached effect changes nothing, by name, in their units."""
        return dict.fromkeys((self.size_name, *self.advanced), 0.0)

    def at_size(self, size: float, shape: Mapping[str, float] | None = None) -> Effect:
        """Return the effect at another size.

        Args:
            size: Size, in its unit.
            shape: Values of other parameters by short name, in each one's unit.
        """
        return self.effect.with_parameters({**(shape or {}), self.size_parameter: size})


def look_alikes(hypothesis: Hypothesis, hypotheses: Iterable[Hypothesis]) -> tuple[Hypothesis, ...]:
    """Return the others that the same data may not separate from one: either names the other."""
    own = {hypothesis.law, hypothesis.name}
    return tuple(
        other
        for other in hypotheses
        if other.name != hypothesis.name
        and (
            own & set(other.effect.about.look_alikes)
            or {other.law, other.name} & set(hypothesis.effect.about.look_alikes)
        )
    )
