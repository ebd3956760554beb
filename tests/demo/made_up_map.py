"""A force map of a 200 mm muscle that obeys equation (4), without noise."""

from __future__ import annotations

import numpy as np

from workbench.demo.force_map_study import LAW_LENGTH, ForceMap
from workbench.physics.force_laws import PaperLaw


def made_up_map() -> ForceMap:
    """Compute the forces at seven contractions and ten pressures."""
    q, p = np.meshgrid(np.linspace(0.0, 0.03, 7), np.linspace(1e5, 6e5, 10))
    force = np.asarray(PaperLaw().force(q, p))
    return ForceMap(p.ravel(), LAW_LENGTH - q.ravel(), force.ravel())
