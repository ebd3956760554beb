"""Effects: pieces of physics that attach to the ports of a model."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from typing import Any

from workbench.errors import WorkbenchError, check_choice
from workbench.model.quantities import Parameter, State
from workbench.model.regularisation import Expression
from workbench.model.scope import EffectView, PortView


@dataclass(frozen=True)
class About:
    """What is known of an effect, for reports and for choosing between effects.

    Args:
        equation: The law, in one line of text.
        look_alikes: Names of effects that the same data may not separate.
        separated_by: The experiment that tells it from its look-alikes.
        subject: Name of the parameter of the model that it changes; empty if it changes none.
        moment: Name of the own parameter that is the time of an event; empty if there is none.
        period: Name of the own parameter with which that event repeats, in s; empty if it does not.
        part: Name of the own parameter that is the part of it in which it acts; empty if it acts
            throughout.
        begins: Name of the own state that begins otherwise in each recording; empty if there is
            none.
        level: Whether that state stays as it begins, as what is changed between recordings does.
        tells: Name of the own parameter that is told beside the size though no refit changes it;
            empty if there is none.
        advance: Name of the own parameter that is the time, in s, by which a recording of the
            measurement at its port is moved ahead before the equations meet it; empty if it is not.
    """

    equation: str = ""
    source: str = ""
    look_alikes: tuple[str, ...] = ()
    separated_by: str = ""
    subject: str = ""
    moment: str = ""
    period: str = ""
    part: str = ""
    begins: str = ""
    level: bool = False
    tells: str = ""
    advance: str = ""


@dataclass(frozen=True)
class Effect:
    """A piece of physics attached to one or several ports of a model.

    The signal of each port is passed through ``transform``, in the order in which effects were
    attached; the states of the effect follow ``rates``, which may use every signal of the model.

    Args:
        transform: Takes what the effect sees at a port, returns the new signal there.
        rates: Takes what the effect sees of the whole model, returns the rate of each own state.
        start: Same, returns the value of own states at the start of a run; ``State.initial`` for
            those that it leaves out.
        dry: Whether it is friction or play without a slope at rest: linear models leave it out.
        settle: Takes this effect and the model that it is being attached to, returns what is
            attached: units and sizes that follow from the ports are known only then.

    Example:
        >>> drag = Effect(
        ...     "drag",
        ...     ("joint.torque",),
        ...     lambda at: at.value - at.p.coefficient * at.signals.speed,
        ...     parameters=(Parameter("coefficient", "N m s/rad", value=0.3, lower=0.0),),
        ... )
        >>> drag.with_parameters({"coefficient": 0.5}).parameters[0].value
        0.5
    """

    name: str
    ports: tuple[str, ...]
    transform: Callable[[PortView], Expression]
    parameters: tuple[Parameter, ...] = ()
    states: tuple[State, ...] = ()
    rates: Callable[[EffectView], Mapping[str, Expression]] | None = None
    start: Callable[[EffectView], Mapping[str, Expression]] | None = None
    about: About = field(default_factory=About)
    dry: bool = False
    settle: Callable[[Effect, Any], Effect] | None = None

    def __post_init__(self) -> None:
        if not self.ports:
            raise WorkbenchError(f"effect {self.name!r} names no port; give at least one")
        if bool(self.states) != (self.rates is not None):
            raise WorkbenchError(
                f"effect {self.name!r} has {len(self.states)} state(s) and"
                f" {'a' if self.rates else 'no'} rates function; it needs both or neither"
            )
        for q in (*self.parameters, *self.states):
            if q.stated:
                raise WorkbenchError(
                    f"{q.name} of effect {self.name!r} is in {q.stated!r}; a law counts in the SI,"
                    f" here {q.unit!r}"
                )
        own = [q.name for q in (*self.parameters, *self.states)]
        if len(set(own)) != len(own):
            raise WorkbenchError(f"effect {self.name!r} uses a name twice: {', '.join(own)}")

    @property
    def places(self) -> tuple[str, ...]:
        """What it changes, if that is a parameter, and its ports: in whose units it is read."""
        return tuple(filter(None, (self.about.subject, *self.ports)))

    def with_parameters(self, values: Mapping[str, float]) -> Effect:
        """Return the same effect with other values by short name, in each parameter's unit."""
        for name in values:
            check_choice(
                f"parameter of effect {self.name}", name, [q.name for q in self.parameters]
            )
        changed = tuple(
            q.with_value(values[q.name]) if q.name in values else q for q in self.parameters
        )
        return replace(self, parameters=changed)
