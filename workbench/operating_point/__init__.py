"""Operating points: where a model rests, or drifts in a known way."""

from workbench.operating_point.derivatives import Derivatives, derivatives_of
from workbench.operating_point.operating_point import (
    OperatingPoint,
    operating_point,
    usual_inputs,
)

__all__ = ["Derivatives", "OperatingPoint", "derivatives_of", "operating_point", "usual_inputs"]
