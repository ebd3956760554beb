"""The demonstration: everything the workbench does, on one page."""

from workbench.demo.demonstration import PARTS, Demonstration, run_demo

__all__ = ["PARTS", "Demonstration", "run_demo"]
