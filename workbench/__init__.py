"""A control-design workbench for an antagonistic pneumatic-muscle arm."""

from __future__ import annotations
