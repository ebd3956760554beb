"""Controllers: pure sampled laws, designed from linear models."""

from controllers.angle_pd import AnglePD
from controllers.guard import Guard, Guarded
from controllers.mpc.whole_model import LinearMPC, MPCSpecification, design_mpc
from controllers.pid import CascadePID, PIDSpecification, cascade_pid, design_pid
from controllers.protocol import Controller
from controllers.sliding_mode import SlidingMode, SlidingModeSpecification, design_sliding_mode
from controllers.valve_inverse import ValveInverse

__all__ = [
    "AnglePD",
    "CascadePID",
    "Controller",
    "Guard",
    "Guarded",
    "LinearMPC",
    "MPCSpecification",
    "PIDSpecification",
    "SlidingMode",
    "SlidingModeSpecification",
    "ValveInverse",
    "cascade_pid",
    "design_mpc",
    "design_pid",
    "design_sliding_mode",
]
