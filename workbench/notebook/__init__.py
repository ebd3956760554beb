"""What notebooks add: pictures of objects, sliders, and starter notebooks."""

from workbench.notebook.plots import plot
from workbench.notebook.sliders import sliders

__all__ = ["plot", "sliders"]
