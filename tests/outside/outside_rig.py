"""A package that somebody else wrote: one member of every registry, each of a few lines."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from controllers.design import Design
from workbench.model import Input, Model, Output, Parameter, State
from workbench.model.units import per
from workbench.physics.law import Law, each, size
from workbench.plants.plant import Option, Plant
from workbench.recordings.columns import Columns
from workbench.recordings.formats.format import Format
from workbench.reports.figure import Figure
from workbench.verification.metrics import Metric
from workbench.verification.responses import Value
from workbench.verification.signals import SignalKind

# A plant: a hoist that lifts a load by a rope force.


def hoist(mass_kg: float = 4.0) -> Model:
    """Build a hoist: a mass on a rope, lifted by a force and slowed by a brake."""

    def equations(m):
        force = m.port(
            "rope.force",
            m.u.pull - m.p.brake * m.x.speed,
            unit="N",
            scale=20.0,
            signals={"speed": m.x.speed},
            disturbance=0.5,
        )
        return {"height": m.x.speed, "speed": force / m.p.mass}, {"height": m.x.height}

    return Model(
        "hoist",
        equations,
        states=(State("height", "m", 0.5), State("speed", "m/s", 1.0)),
        inputs=(Input("pull", "N", 20.0, lower=-60.0, upper=60.0),),
        outputs=(Output("height", "m", 0.5, noise_rms=1e-4),),
        parameters=(
            Parameter("mass", "kg", value=mass_kg, lower=1.0, upper=20.0, fitted=True),
            Parameter("brake", "N s/m", value=6.0, lower=0.0, upper=60.0, fitted=True),
        ),
    )


HOIST = Plant(
    "outside-hoist",
    hoist,
    "a mass on a rope",
    options=(Option("mass", 4.0, "kg", "what hangs on the rope", 1.0, 20.0, keyword="mass_kg"),),
)

# A law: a brake that grows with the cube of the speed, which the workbench does not know.

cubic_brake = Law(
    "outside_cubic_brake",
    "F = -coefficient v^3",
    each("force", needs=("speed",)),
    lambda at: (
        size("coefficient", per(at.unit, at.speed.unit, 3), 0.1 * at.scale / at.speed.scale**3,
             2.0 * at.scale / at.speed.scale**3, "braking"),
    ),
    lambda at: at.value - at.p.coefficient * at.signals.speed**3,
    source="an outside package",
)  # fmt: skip

# A design: proportional control of the height with damping from its difference.


@dataclass(frozen=True)
class HoistController:
    """Proportional and differential control of one output by one input."""

    gain: float
    damping: float
    name: str = "outside PD"
    sample_time: float = 0.01
    sensors: tuple[str, ...] = ("height",)
    controlled: tuple[str, ...] = ("height",)
    actuators: tuple[str, ...] = ("pull",)
    preview: int = 0

    def initial_state(self, measurement):
        return measurement[0]

    def step(self, state, measurement, reference):
        speed = (measurement[0] - state) / self.sample_time
        pull = self.gain * (reference[0] - measurement[0]) - self.damping * speed
        return (pull,), measurement[0], {}

    def linear_command(self, command):
        return command


def design_hoist(linear, specification):
    mass = 1.0 / float(np.asarray(linear.system.B)[1, 0])
    w = dict(specification).get("bandwidth", 6.0)
    return HoistController(mass * w * w, 1.4 * mass * w)


DESIGN = Design(
    name="outside-pd",
    family="outside PD",
    summary="proportional control with damping",
    function=design_hoist,
    sensors=("height",),
    actuators=("pull",),
    exports=False,
    own=True,
)

# A metric, a kind of reference, a recording format and a figure.

METRIC = Metric(
    "outside_peak_pull",
    lambda run: Value(float(np.max(np.abs(run["pull"])))),
    "largest pull of the rope",
    unit="N",
    table="page",
)


@dataclass(frozen=True)
class Lift:
    """A half cosine from one height to another."""

    low: float
    high: float
    duration: float

    def sample(self, time):
        part = np.clip(np.asarray(time, dtype=float) / self.duration, 0.0, 1.0)
        return self.low + (self.high - self.low) * 0.5 * (1.0 - np.cos(math.pi * part))

    @property
    def changes(self):
        return ()


def read(path, options):
    rows = [line.split(";") for line in path.read_text().splitlines()]
    return Columns(tuple(rows[0]), ("",) * len(rows[0]), np.array(rows[1:], dtype=float))


FORMAT = Format("outside-log", "a log of the outside package", (".hoist",), read)


def draw(result):
    import matplotlib.pyplot as plt

    figure, axes = plt.subplots()
    axes.plot([0.0, 1.0], [0.0, 1.0])
    axes.set_title("drawn by an outside package")
    plt.close(figure)
    return figure


FIGURE = Figure("outside-figure", draw, "study", "Outside figure", "A line of an outside package.")

LIFT = SignalKind("outside-lift", Lift, ("low", "high"), ("duration",))
