"""Laws that act from a time on, or for a while: a hole, a brake that drags, a door that is open."""

from __future__ import annotations

from dataclasses import replace

from workbench.model import PortView
from workbench.model.regularisation import Expression
from workbench.model.units import SPEEDS, same_dimension
from workbench.physics.drift import for_a_while, offset_jump, passed, when
from workbench.physics.friction import coulomb_friction
from workbench.physics.law import Law, each
from workbench.physics.leakage import chamber_leakage
from workbench.physics.place import RESISTED
from workbench.physics.stores import heat_loss, linear_outflow, orifice_outflow


def _begins(law: Law, name: str, source: str) -> tuple[Law, Law]:
    """Return a law without states of its own as it begins at a time, and as it acts for a while."""

    def transform(at: PortView) -> Expression:
        return at.value + passed(at) * (law.transform(at) - at.value)

    jump = replace(
        law,
        name=f"{name}_jump",
        equation=f"{law.equation} step(t - time)",
        parameters=lambda at: (*law.parameters(at), *when(at)),
        transform=transform,
        states=offset_jump.states,
        rates=offset_jump.rates,
        shapes=lambda at: [
            {**shape, **then} for shape in law.shapes(at)[:2] for then in offset_jump.shapes(at)
        ],
        moment="time",
        usual=False,
        source=source,
        look_alikes=(law.name, "offset_jump", "parameter_jump"),
        separated_by=f"the event again, and {law.separated_by}",
    )
    return jump, replace(for_a_while(jump), shapes=law.shapes)


friction_jump, friction_pulse = _begins(
    # Where there is dry friction already, its level may jump.
    replace(
        coulomb_friction,
        where=each(
            *RESISTED, needs=("speed",),
            only=lambda at: not at.dry and same_dimension(at.speed.unit, *SPEEDS),
        ),
    ),
    "friction", "a brake that drags, a bearing or seal that fails",
)  # fmt: skip
leak_jump, leak_pulse = _begins(
    orifice_outflow, "leak", "a hole, a valve that was opened, or closed"
)
linear_leak_jump, linear_leak_pulse = _begins(
    linear_outflow, "linear_leak", "a crack, a load of a voltage that was switched on, or off"
)
gas_leak_jump, gas_leak_pulse = _begins(
    chamber_leakage, "gas_leak", "a hose that came off, a seal that failed"
)
heat_loss_jump, heat_loss_pulse = _begins(
    heat_loss, "heat_loss", "a door that was opened, lagging that fell off"
)
