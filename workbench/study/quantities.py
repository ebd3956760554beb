"""Values of a study file: a number in SI, or text with a unit such as "5 bar"."""

from workbench.model.units import quantity as si_value

__all__ = ["si_value"]
