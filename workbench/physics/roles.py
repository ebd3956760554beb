"""The role of a port: what it is good for, whatever its states and signals are called.

It follows from what the author of the model declared, else from the unit, else from the structure
of the equations: a force drives the state whose integral is a state too, a flow drives a level.
"""

from __future__ import annotations

from workbench.model.units import per, same_dimension
from workbench.physics.ports import Ports

EFFORTS = ("force", "acceleration", "circuit")
"""Roles of ports that drive a speed: of a body, or the current of a circuit."""

RESISTED = (*EFFORTS, "shared command")
"""Roles of places where something may resist a motion: also a command that sets several bodies in
motion at once, such as the force on the trolley of a crane. What rubs there acts on all of them."""

DRIVES = ("command", "voltage", "circuit", "current")
"""Roles of signals that a drive or amplifier gives."""

FLOWS = ("flow", "heat", "current")
"""Roles of ports that fill a store: with matter, heat or charge."""

_ROLES = {
    "force": ("N", "N m"),
    "acceleration": ("m/s2", "rad/s2"),
    "voltage": ("V",),
    "current": ("A",),
    "flow": ("m3/s", "kg/s"),
    "heat": ("W",),
    "temperature": ("K",),
    "pressure": ("Pa",),
    "inertia": ("kg m2", "kg"),
    "volume": ("m3",),
}
_ENDINGS = {".reading": "measurement", ".command": "command", ".outflow": "flow", ".inflow": "flow"}


def role_of(ports: Ports, index: int) -> str:
    """Return the role of a port: as its author declared, else by name, unit or structure."""
    port = ports.trace.ports[index]
    if port.role:
        return port.role
    for ending, role in _ENDINGS.items():
        if port.name.endswith(ending):
            return role
    if "penetration" in port.signals:
        return "stop"
    for role, units in _ROLES.items():
        if same_dimension(port.unit, *units):
            circuit = role == "voltage" and any(map(ports.is_current, ports.moved[index]))
            return "circuit" if circuit else role
    for state in ports.moved[index]:
        if same_dimension(port.unit, per(state.unit, "s")):
            if state.unit == "A":
                # What changes a current is a voltage over a coil.
                return "circuit"
            fast = state.name in ports.integral or state.unit.endswith("/s")
            return "acceleration" if fast else "flow"
    return "flow" if port.name.endswith(".flow") else ""
