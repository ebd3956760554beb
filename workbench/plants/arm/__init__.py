"""The antagonistic pneumatic-muscle arm and its components."""

from workbench.plants.arm.arm import arm
from workbench.plants.arm.muscle import pneumatic_muscle
from workbench.plants.arm.servovalve import servovalve
from workbench.plants.arm.two_valves import two_valve_arm

__all__ = ["arm", "pneumatic_muscle", "servovalve", "two_valve_arm"]
