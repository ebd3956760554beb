"""What every controller has to do: plants, variations that no design knows, and scenarios."""

from __future__ import annotations

import math
from dataclasses import dataclass

from workbench.errors import check_choice
from workbench.model import Model
from workbench.physics.hysteresis import muscle_hysteresis
from workbench.plants.arm import arm
from workbench.plants.arm.inertia import MAXIMUM_LOAD, Plane
from workbench.verification import Change, Disturbance, Scenario, Sine, Steps

HOLD = 1.4
"""Time that each step is held, s."""

BEGIN = 0.2
"""Time of the first step, s."""

STEPS_DEG = (5.0, 10.0, 5.0, 20.0, 35.0, 50.0, 55.0, 25.0, 55.0, 50.0, 35.0, 5.0, 35.0, 30.0)
"""Angles of the staircase, °: steps of 5, 15 and 30° in both directions between 5° and 55°."""

SINES_HZ = (0.2, 0.5, 1.0)
"""Frequencies of the sines of 15° about 30°, Hz."""

OTHER_STEPS_DEG = (
    8.0,
    13.0,
    28.0,
    43.0,
    13.0,
    18.0,
    48.0,
    53.0,
    38.0,
    33.0,
    18.0,
    48.0,
    43.0,
    13.0,
)
"""Other angles, °: steps of the same sizes."""

VARIATIONS = ("nominal", "1 kg", "5 bar", "valve 0.15 V")
"""What differs from the design; muscle hysteresis always does."""

FRESH_VARIATIONS = (
    "5.5 bar",
    "6.5 bar",
    "valve -0.1 V",
    "valve 0.2 V",
    "half hysteresis",
    "1.5 hysteresis",
    "40 °C",
    "other steps",
)
"""What no choice of a design was made with: checked on demand."""

SUPPLY_BAR = {"5 bar": 5.0, "5.5 bar": 5.5, "6.5 bar": 6.5}
"""Supply pressure of the variations that change it, bar."""

VALVE_OFFSET_V = {"valve 0.15 V": 0.15, "valve -0.1 V": -0.1, "valve 0.2 V": 0.2}
"""Offset of the valve in the variations that have one, V."""

HYSTERESIS = {"half hysteresis": (5.0, 3.5e-5), "1.5 hysteresis": (15.0, 1e-4)}
"""Level in N and level per pressure in N/Pa of the variations that change them."""

USUAL_HYSTERESIS = (10.0, 7e-5)
"""The same of all others."""

CHANGES = "changes at rest"
"""Name of the scenario in which load, supply and valve change while the arm holds 30°."""


@dataclass(frozen=True)
class Case:
    """A known load in a plane.

    Args:
        load: Added load, in kg.
        plane: Plane of the motion.

    Example:
        >>> Case(3.0).name
        '3 kg horizontal'
    """

    load: float
    plane: Plane = "horizontal"

    @property
    def name(self) -> str:
        """Name under which results are reported."""
        return f"{self.load:g} kg {self.plane}"

    @property
    def changed_load(self) -> float:
        """Load after the change: 1 kg more, or less where the rig carries no more, in kg."""
        return self.load + 1.0 if self.load + 1.0 <= MAXIMUM_LOAD else self.load - 1.0


CASES: tuple[Case, ...] = (Case(0.0), Case(3.0), Case(8.0), Case(3.0, "vertical"))
"""The cases of the comparison."""

FRESH_CASES: tuple[Case, ...] = (Case(1.5), Case(5.0), Case(6.5))
"""Loads that no choice of a design was made with: checked on demand."""


def nominal_plant(case: Case) -> Model:
    """Build the plant that the designs know.

    Args:
        case: Load and plane.

    Returns:
        The arm without hysteresis at 6 bar.

    Example:
        >>> any("turn" in state.name for state in nominal_plant(Case(3.0)).states)
        False
    """
    return arm(case.load, plane=case.plane)


def varied_plant(case: Case, variation: str) -> Model:
    """Build a plant on which controllers are verified.

    Args:
        case: Load and plane that the design knows.
        variation: One of `VARIATIONS` or `FRESH_VARIATIONS`.

    Returns:
        The arm with muscle hysteresis (10 N + 7 N/bar unless it is varied) and the variation.

    Raises:
        WorkbenchError: If the variation is unknown.

    Example:
        >>> varied_plant(Case(8.0), "1 kg").parameter("load").value
        7.0
    """
    check_choice("variation", variation, (*VARIATIONS, *FRESH_VARIATIONS))
    plant = arm(
        case.changed_load if variation == "1 kg" else case.load,
        plane=case.plane,
        supply_bar=SUPPLY_BAR.get(variation, 6.0),
    )
    if variation == "40 °C":
        plant = plant.with_parameters({"ambient_temperature": 313.15})
    level, per_pressure = HYSTERESIS.get(variation, USUAL_HYSTERESIS)
    return plant.with_effect(muscle_hysteresis(level=level, level_per_pressure=per_pressure))


def scenarios(variation: str) -> tuple[Scenario, ...]:
    """Return the staircase and the sines.

    Args:
        variation: One of `VARIATIONS` or `FRESH_VARIATIONS`; an offset of the valve is a part of
            the scenario.

    Returns:
        Scenarios at 500 Hz with noise and quantisation.

    Example:
        >>> [scenario.name for scenario in scenarios("nominal")]
        ['steps', 'sine 0.2 Hz', 'sine 0.5 Hz', 'sine 1 Hz']
    """
    check_choice("variation", variation, (*VARIATIONS, *FRESH_VARIATIONS))
    offset = (
        (Disturbance(0.0, "valve.command", VALVE_OFFSET_V[variation]),)
        if variation in VALVE_OFFSET_V
        else ()
    )
    angles = OTHER_STEPS_DEG if variation == "other steps" else STEPS_DEG
    count = len(angles) - 1
    times = (0.0, *(BEGIN + HOLD * i for i in range(count)))
    staircase = Scenario(
        "steps",
        {"angle": Steps(times, tuple(math.radians(a) for a in angles))},
        duration=BEGIN + HOLD * count,
        disturbances=offset,
    )
    mean, amplitude = math.radians(30.0), math.radians(15.0)
    sines = tuple(
        Scenario(
            f"sine {f:g} Hz",
            {"angle": Sine(mean, amplitude, f)},
            duration=max(1.5 / f, 4.0),
            disturbances=offset,
        )
        for f in SINES_HZ
    )
    return (staircase, *sines)


def changes_at_rest(case: Case) -> Scenario:
    """Return the scenario in which the plant changes while the arm holds 30°.

    Args:
        case: Load and plane.

    Returns:
        Load at 0.5 s, supply at 2 s, valve at 3.5 s; 5 s long.

    Example:
        >>> [change.parameter for change in changes_at_rest(Case(3.0)).changes]
        ['load', 'supply_pressure']
    """
    return Scenario(
        CHANGES,
        {"angle": Steps((0.0,), (math.radians(30.0),))},
        duration=5.0,
        changes=(
            Change(0.5, "load", case.changed_load),
            Change(2.0, "supply_pressure", 5e5),
        ),
        disturbances=(Disturbance(3.5, "valve.command", 0.15),),
    )
