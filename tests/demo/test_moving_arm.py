"""The moving drawing shows the arm's own lengths, angles and pressures, and needs no network."""

from __future__ import annotations

import json
import math
import re
from pathlib import Path

import numpy as np
import pytest

from tests.reports.browser import BROWSER, measured
from workbench.demo.moving_arm import FRAME_TIME, arm_drawing, moving_arm
from workbench.errors import WorkbenchError
from workbench.model import EXACT
from workbench.plants.arm import arm
from workbench.plants.servo_axis import servo_axis
from workbench.reports.page import Page, html
from workbench.simulation import Trajectory


def run() -> Trajectory:
    model, time = arm(3.0), np.arange(0.0, 1.0, 0.01)
    states = np.tile(model.initial_state(), (len(time), 1))
    names = [q.name for q in model.states]
    states[:, names.index("angle")] = np.radians(30.0 + 20.0 * time)
    inputs = np.full((len(time), 1), 5.9)
    outputs = np.array([model.read(x, [5.9]) for x in states])
    values = np.array([q.value for q in model.parameters])
    return Trajectory(model, time, states, inputs, outputs, "none", 1e-6, 0.0, EXACT, values)


def test_the_drawing_has_the_lengths_of_the_geometry() -> None:
    angle = np.radians([0.0, 17.0, 60.0])
    drawn = arm_drawing(arm(), angle)
    for muscle, length in zip(drawn.muscles, drawn.geometry.lengths(angle), strict=True):
        assert muscle.length == pytest.approx(np.asarray(length))
    # The lever is one body: its two ends keep their places on the arm.
    for muscle in drawn.muscles:
        own = np.arctan2(muscle.end[:, 1], muscle.end[:, 0]) - drawn.direction
        assert np.ptp(np.mod(own, 2 * math.pi)) < 1e-12


def test_another_machine_has_no_such_drawing() -> None:
    with pytest.raises(WorkbenchError, match="is no arm"):
        arm_drawing(servo_axis(), [0.0])


def test_the_frames_are_those_of_the_run() -> None:
    moving = moving_arm(run(), start=0.0, stop=0.9, caption="Moves.")
    found = re.search(r'"application/json">(.*?)</script>', moving.markup)
    assert found is not None
    frames = json.loads(found[1])
    assert len(frames["angle"]) == round(0.9 / FRAME_TIME) + 1
    assert frames["angle"][-1] == pytest.approx(48.0, abs=0.01)
    assert frames["muscles"][0]["pressure"][0] == pytest.approx(3.0, abs=0.05)
    # Muscle 1 shortens and thickens as the angle grows.
    assert np.all(np.diff(frames["muscles"][0]["length"]) < 0)
    assert np.all(np.diff(frames["muscles"][0]["width"]) > 0)


def test_it_needs_no_network_and_heeds_reduced_motion() -> None:
    markup = moving_arm(run(), start=0.0, stop=0.9, caption="Moves.").markup
    assert not re.search(r"https?://|@import|src=|fetch\(", markup)
    assert "prefers-reduced-motion" in markup


MOVED = """
<script>
addEventListener("load", () => {
  const page = document.querySelector("iframe").contentDocument;
  const one = name => page.querySelector(name);
  const turned = () => one(".moving .arm").getAttribute("transform");
  const before = turned(), slider = one(".moving input");
  slider.value = 500;
  slider.dispatchEvent(new page.defaultView.Event("input"));
  document.body.textContent = JSON.stringify({
    before, after: turned(), angle: one(".moving .angle").textContent,
    button: one(".moving button").textContent, controls: !one(".moving .controls").hidden,
  });
});
</script>
"""


@pytest.mark.system
@pytest.mark.skipif(BROWSER is None, reason="there is no Chromium on this machine")
def test_the_reader_moves_the_arm(tmp_path: Path) -> None:
    moving = moving_arm(run(), start=0.0, stop=0.9, caption="Moves.")
    found = measured(html(Page("Arm", "", (), first=(moving,))), MOVED, 390, tmp_path)
    assert found["before"] != found["after"]
    # Half way through the run, 0.45 s.
    assert found["angle"] == "39"
    # Who takes the slider stops the film.
    assert found["button"] == "play" and found["controls"] is True
