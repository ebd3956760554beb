"""Location: an unknown input gains where something is missing, and nowhere else."""

from __future__ import annotations

import casadi as ca
import numpy as np

from tests.diagnosis.axis_case import diagnosed
from workbench.diagnosis.estimation.simulated_recordings import simulated
from workbench.diagnosis.location.locate import Location, groups_of, locate
from workbench.model import Input, Model, Output, Parameter, Scope, State
from workbench.model.trace import Equations
from workbench.plants.arm import arm


def test_groups_are_those_ports_that_may_leave_something_out() -> None:
    groups = groups_of(arm(3))
    assert groups == {
        "chamber_1": ("chamber_1.flow",),
        "chamber_2": ("chamber_2.flow",),
        "joint": ("joint.torque",),
    }


def test_hidden_friction_is_located_and_gone_afterwards() -> None:
    found = diagnosed(True)
    assert found.before is not None and found.after is not None
    assert found.before.best == "axis"
    # Units of log likelihood: thousands against what another excitation would change by chance.
    assert found.before.alone["axis"] > 300
    assert found.after.alone["axis"] < 0.3 * found.before.alone["axis"]


def test_nothing_is_located_where_nothing_is_hidden() -> None:
    found = diagnosed(False)
    assert found.before is not None and found.before.alone["axis"] < 5


def test_location_prints_the_groups_by_gain() -> None:
    text = str(Location({"a": 1.0, "b": 50.0}))
    assert text.index("b ") < text.index("a  ")


def test_what_is_far_larger_than_usual_is_located_where_it_acts() -> None:
    # An unknown input of the usual size, and of some times that, gains nothing at the climb.
    def balloon(m: Scope) -> Equations:
        x, u, p = m.x, m.u, m.p
        drag = (0.1 + p.drag * ca.fabs(x.climb)) * x.climb
        climb = m.port("climb.rate", 0.02 * x.air - drag, unit="m/s2", disturbance=6e-4)
        air = 0.3 * u.burner - 0.002 * x.air
        air = m.port("air.rate", air, unit="K/s", disturbance=4e-3)
        return {"height": x.climb, "climb": climb, "air": air}, {"height": x.height, "air": x.air}

    model = Model(
        "balloon",
        balloon,
        states=(State("height", "m", 100.0), State("climb", "m/s", 2.0), State("air", "K", 10.0)),
        inputs=(Input("burner", "1", 1.0),),
        outputs=(
            Output("height", "m", 100.0, noise_rms=0.5),
            Output("air", "K", 10.0, noise_rms=0.3),
        ),
        parameters=(Parameter("drag", "1/m", value=0.0, scale=0.1),),
    )
    burner = np.repeat(np.random.default_rng(1).uniform(-0.2, 0.2, 90), 20)
    seen = simulated(model, burner, sample_time=1.0, values={"drag": 0.15})
    assert locate(model, [seen]).best == "climb"
