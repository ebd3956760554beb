"""The demonstration: everything the workbench does, on one page."""

from workbench.demo.demonstration import run_demo

__all__ = ["run_demo"]
