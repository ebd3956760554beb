"""All plants: the workbench's own, those of installed packages, and the user's."""

from __future__ import annotations

from workbench.plants.plant import Plant, adopt
from workbench.registry import Registry

PLANTS = Registry("plant", Plant, package="workbench.plants", group="workbench.plants", adopt=adopt)
"""Plants by name; one of the user's own as ``module:object``: a function, a model or a Plant."""
