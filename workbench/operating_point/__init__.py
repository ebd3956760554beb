"""Operating points: where a model rests, or drifts in a known way."""

from workbench.operating_point.derivatives import Derivatives, derivatives_of
from workbench.operating_point.operating_point import (
    OperatingPoint,
    operating_point,
    usual_inputs,
)
from workbench.operating_point.trim import input_named

__all__ = [
    "Derivatives",
    "OperatingPoint",
    "derivatives_of",
    "input_named",
    "operating_point",
    "usual_inputs",
]
