"""Sensitivity peaks against python-control."""

from __future__ import annotations

import numpy as np
import pytest

from controllers import cascade_pid, design_pid
from controllers.sensitivity import loop_matrices, peak_sensitivities
from workbench.linearisation import LinearModel


def test_peaks_agree_with_python_control(linear: LinearModel) -> None:
    import control as ct

    pid = design_pid(linear)
    ms, mt = peak_sensitivities(pid, linear)
    A, B, C, F, G, H, J = loop_matrices(pid, linear)
    h = pid.sample_time
    plant = ct.ss(A, B, C, np.zeros((3, 1)), h, inputs=["u"], outputs=["y", "p1", "p2"])
    law = ct.ss(F, G, H, J, h, inputs=["m", "p1", "p2"], outputs=["u"])
    opened = ct.interconnect([plant, law], inputs=["m"], outputs=["y"])
    s = ct.feedback(1, -opened)
    response = np.abs(s(np.exp(1j * h * np.geomspace(0.3, 0.97 * np.pi / h, 2000))))
    # Grids of 300 and 2000 frequencies meet a broad peak within half a percent.
    assert ms == pytest.approx(float(response.max()), rel=5e-3)
    assert mt < 1.6


def test_an_unstable_loop_has_infinite_peaks(linear: LinearModel) -> None:
    pid = cascade_pid(proportional=5e7, integral=0.0, derivative=0.0, inner=3e-6)
    assert peak_sensitivities(pid, linear) == (float("inf"), float("inf"))
