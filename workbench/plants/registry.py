"""All plants: the workbench's own, those of installed packages, the user's, and saved ones."""

from __future__ import annotations

from pathlib import Path

from workbench.plants.plant import Plant, adopt
from workbench.plants.saved import plant_of_file
from workbench.registry import Registry


class Plants(Registry[Plant]):
    """Plants by name, as ``module:object``, or as a file that keeps one, such as verdict.json."""

    def get(self, name: str, *, folder: Path | None = None) -> Plant:
        """Return a plant."""
        if name.endswith(".json"):
            path = Path(name) if folder is None else folder / name
            return plant_of_file(path, lambda other: self.get(other, folder=folder), folder=folder)
        return super().get(name, folder=folder)


PLANTS = Plants("plant", Plant, package="workbench.plants", group="workbench.plants", adopt=adopt)
"""Plants by name; one of the user's own as ``module:object``: a function, a model or a Plant."""
