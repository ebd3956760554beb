"""An input that reads nothing for moments is bridged where the machine knows none of them."""

import numpy as np
import pytest

from tests.diagnosis.machine_data import held, recording
from tests.machines import machine
from workbench.arrays import Vector
from workbench.diagnosis.misrecorded_columns import with_breaks_bridged
from workbench.diagnosis.undeclared.plant import with_undeclared
from workbench.model import Model
from workbench.recordings.recording import Recording

BREAKS = ((60, 65), (150, 153), (290, 296), (340, 345))


def rider() -> Model:
    return machine(
        lambda m: {"speed": (m.u.power / 5.0 - m.p.drag * m.x.speed) / 80.0},
        "speed m/s 7",
        "power W 0 500",
        "speed m/s",
        "drag N s/m 6 1 30",
    )


def ridden(*, followed: bool) -> tuple[Recording, Vector]:
    """A rider whose meter reads nothing four times, once as the power changes, in W; beside SciPy.

    Args:
        followed: Whether there is no power either.
    """
    rng = np.random.default_rng(3)
    power = np.repeat(rng.uniform(50.0, 420.0, 25), 16)
    power[290:306] = power[292]
    power[330:360] = power[335]
    read = power.copy()
    for a, b in BREAKS:
        read[a:b] = 0.0

    def rates(_: float, x: Vector, given: float) -> list[float]:
        return [(given / 5.0 - 8.0 * x[0]) / 80.0]

    speed = held(rates, [7.0], (read if followed else power,), 1.0)[:, 0]
    speeds = {"speed [m/s]": speed + 0.03 * rng.normal(size=len(power))}
    return recording("ride", 1.0, {"power [W]": read}, speeds), power


@pytest.mark.parametrize("followed", [True, False])
def test_what_a_meter_lost_is_bridged_and_what_the_legs_did_is_not(followed: bool) -> None:
    ride, power = ridden(followed=followed)
    model, _ = with_undeclared(rider(), [ride])
    (seen,), rows = with_breaks_bridged(model, [ride])
    if followed:
        assert seen is ride and not rows
        return
    assert "drops out 4 times, for 19 s in all" in rows[0]["note"]
    # The speed tells when the power changed meanwhile.
    np.testing.assert_array_equal(seen["power"], power)
