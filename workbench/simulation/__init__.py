"""From model to trajectory, compiled where a C compiler is present."""

from workbench.simulation.simulate import simulate
from workbench.simulation.stepper import Stepper
from workbench.simulation.trajectory import Trajectory

__all__ = ["Stepper", "Trajectory", "simulate"]
