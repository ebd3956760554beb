"""Three controllers, designed from one linear model, on the linear and on the full plant."""

from __future__ import annotations

from dataclasses import dataclass

from controllers.protocol import Controller
from workbench.demo.controller_designs import design_controllers, design_model
from workbench.demo.part import Part
from workbench.linearisation import LinearModel
from workbench.model import Model
from workbench.physics.hysteresis import muscle_hysteresis
from workbench.plants.arm import arm
from workbench.reports.figures.steps import ClosedLoopCurves, closed_loop_steps
from workbench.reports.metrics_table import metric_methods, metrics_table
from workbench.reports.page import Commands, Method, Section, Words
from workbench.reports.pictures import Picture
from workbench.verification import (
    Metrics,
    Requirement,
    Run,
    Scenario,
    metrics,
    step_scenario,
    verify,
)

LOAD_KG = 3.0
DESIGN_ANGLE_DEG = 30.0

REQUIREMENTS = (
    Requirement("settling_time", 0.8, "s"),
    Requirement("overshoot", 10.0, "%"),
    Requirement("steady_error", 0.3, "deg"),
    Requirement("oscillation", 0.1, "deg"),
    Requirement("stop_impacts", 0.0),
)
"""What every controller must reach: settle fast, rest exactly, not limit-cycle, not hit a stop."""

COLUMNS = (
    "settling_time",
    "overshoot",
    "steady_error",
    "oscillation",
    "stop_impacts",
    "rmse",
    "chatter",
    "air",
    "solve_time_median",
    "fallbacks",
)


@dataclass(frozen=True)
class Trial:
    """A controller on the full plant and on the linear model.

    Args:
        full: Run on the full plant.
        linear: Run on the linear model.
        figures: Metrics of the run on the full plant.

    Example:
        >>> list(Trial.__dataclass_fields__)
        ['full', 'linear', 'figures']
    """

    full: Run
    linear: Run
    figures: Metrics


def scenario() -> Scenario:
    """Build the step that every controller follows.

    Returns:
        15° to 45° and back, sampled at 500 Hz, with noise and quantisation.

    Example:
        >>> scenario().sample_time
        0.002
    """
    return step_scenario(from_deg=15.0, to_deg=45.0, back=True, hold=2.0)


def plants() -> dict[str, Model]:
    """Build the full plants on which the controllers are proved.

    Returns:
        Plants by name: nominal, and with hysteresis of both muscles.

    Example:
        >>> list(plants())
        ['nominal', 'with muscle hysteresis']
    """
    nominal = arm(LOAD_KG)
    return {
        "nominal": nominal,
        "with muscle hysteresis": nominal.with_effect(muscle_hysteresis()),
    }


def run_trials(
    controllers: tuple[Controller, ...], linear: LinearModel
) -> dict[str, dict[str, Trial]]:
    """Run every controller on every plant and on the linear model.

    Args:
        controllers: The controllers.
        linear: The linear model that they were designed from.

    Returns:
        Trials by plant and controller.

    Example:
        >>> linear = design_model(arm(3))
        >>> list(run_trials(design_controllers(linear, ["pid"]), linear))
        ['nominal', 'with muscle hysteresis']
    """
    wanted = scenario()
    ideal = {c.name: verify(c, linear, wanted.without_imperfections()) for c in controllers}
    found: dict[str, dict[str, Trial]] = {}
    for name, plant in plants().items():
        found[name] = {}
        for controller in controllers:
            run = verify(controller, plant, wanted)
            found[name][controller.name] = Trial(run, ideal[controller.name], metrics(run))
    return found


def closed_loop_part() -> Part:
    """Design three controllers and prove them on the full plant.

    Returns:
        The section and its numbers.

    Example:
        >>> closed_loop_part().marks  # three controllers, two plants, five requirements
        {'met': 30, 'missed': 0, 'open': 0}
    """
    linear = design_model(arm(LOAD_KG), DESIGN_ANGLE_DEG)
    trials = run_trials(design_controllers(linear), linear)
    pictures = [picture for name, own in trials.items() for picture in _pictures(name, own)]
    measured: dict[tuple[str, ...], Metrics] = {
        (controller, plant): trial.figures
        for plant, own in trials.items()
        for controller, trial in own.items()
    }
    results = {
        plant: {controller: _numbers(trial.figures) for controller, trial in own.items()}
        for plant, own in trials.items()
    }
    section = Section(
        "controllers",
        "Three controllers on the linear and the full model",
        (
            Words(
                "A cascaded PID, a sliding mode with boundary layer and a linear MPC with "
                f"constraints, all designed from the same linear model at {DESIGN_ANGLE_DEG:g}° "
                f"with {LOAD_KG:g} kg, all inverting the valve's curve. The same controller "
                "objects then run at 500 Hz on the full nonlinear plant, with saturation, "
                "12-bit converters and sensor noise: a step of 30° and back, nominal and with "
                "muscle hysteresis of 10 N + 7 N/bar that no design knew of."
            ),
            *pictures,
            metrics_table(
                "Steps between 15° and 45° on the full plant",
                ("controller", "plant"),
                measured,
                COLUMNS,
                REQUIREMENTS,
            ),
            Method(metric_methods()),
            Commands(
                (
                    "workbench verify --controller pid --controller sliding-mode --controller mpc",
                    "workbench verify --controller pid --controller sliding-mode --controller mpc "
                    "--hysteresis",
                )
            ),
        ),
    )
    return Part(section, results)


WINDOWS = {"up": (0.4, 1.6), "down": (2.4, 3.6)}
"""Times drawn around each step, in s: the whole run would hide how the curves differ."""


def _pictures(plant: str, trials: dict[str, Trial]) -> list[Picture]:
    first = next(iter(trials.values())).full
    found = []
    for way, (begin, end) in WINDOWS.items():
        seen = (first.time >= begin - 1e-9) & (first.time <= end + 1e-9)
        figure = closed_loop_steps(
            first.time[seen],
            first.references["angle"][seen],
            [
                ClosedLoopCurves(
                    name,
                    trial.full.time[seen],
                    trial.full["angle"][seen],
                    trial.full["valve"][seen],
                    trial.linear["angle"][seen],
                )
                for name, trial in trials.items()
            ],
        )
        found.append(
            Picture(
                f"steps-{plant.replace(' ', '-')}-{way}",
                figure,
                f"Step {way}, full plant {plant}: angle, error (dotted: ± 0.3°) and valve "
                "voltage. Dashed: the same controller on the linear model, with ideal sensors.",
                f"step {way} between 15 and 45 degrees; all controllers settle in half a second",
            )
        )
    return found


def _numbers(found: Metrics) -> dict[str, float]:
    numbers = {}
    for metric in found.values:
        value, unit = metric.shown()
        suffix = unit.replace("%", "percent").replace("/", "_per_").replace(" ", "_")
        numbers[f"{metric.name}_{suffix}" if unit != "1" else metric.name] = value
    return numbers
