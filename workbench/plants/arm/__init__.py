"""The antagonistic pneumatic-muscle arm and its components."""

from workbench.plants.arm.arm import arm, two_valve_arm
from workbench.plants.arm.muscle import pneumatic_muscle
from workbench.plants.arm.servovalve import servovalve

__all__ = ["arm", "pneumatic_muscle", "servovalve", "two_valve_arm"]
