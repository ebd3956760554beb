"""Opening curve of the servovalve: spool in volt, fraction of the conductance in percent."""

from __future__ import annotations

import numpy as np

VOLTS = np.array(
    [0, 0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8, 0.9, 1.0, 1.2, 1.4, 1.6, 1.8, 2, 2.5, 3, 3.5, 4]
    + [4.5, 5]
)
PERCENT = np.array(
    [0, 0.2, 0.5, 0.8, 1.2, 1.7, 2.3, 3.0, 4.1, 5.6, 7.1, 10.7, 17, 24, 30, 36, 49, 64, 75, 86]
    + [97, 100]
)
