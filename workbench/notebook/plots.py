"""Pictures of objects: what ``.plot()`` draws, one function per kind."""

from __future__ import annotations

from functools import singledispatch
from typing import TYPE_CHECKING, Any

import numpy as np

from workbench.diagnosis.stages import Diagnosis
from workbench.errors import WorkbenchError, check_choice
from workbench.linearisation import LinearModel
from workbench.linearisation.transfer import frequency_response
from workbench.model.quantities import shown_in
from workbench.model.units import from_si, parse_unit, per
from workbench.recordings import Recording
from workbench.reports.figures.bode_nyquist import bode
from workbench.reports.figures.diagnosis import all_as_read, diagnosis_runs, held_out_runs
from workbench.reports.figures.recording import recorded, recorded_signals
from workbench.reports.figures.study_traces import written
from workbench.reports.figures.tracking import TRACKING, tracking
from workbench.reports.figures.tracking import Trajectory as Curves
from workbench.simulation import Trajectory
from workbench.study.result import StudyResult
from workbench.verification import Run

if TYPE_CHECKING:
    from collections.abc import Mapping

    from matplotlib.figure import Figure


def plot(shown: Any, *what: Any) -> Figure:
    """Draw a linear model, a run, a trajectory, a recording, a study's result or a diagnosis.

    Args:
        what: Of a linear model, the output; of a run, other runs of its scenario, dashed those on
            a linear model; of a trajectory, what of it; of a study's result, the scenario; of a
            diagnosis, the held-out recording.

    Example:
        >>> import workbench as wb
        >>> axis = wb.servo_axis()
        >>> len(plot(wb.linearise(wb.operating_point(axis, {"position": 0.0}))).axes)
        2
    """
    # A notebook shows figures only once pyplot has been imported.
    import matplotlib.pyplot as _  # noqa: F401, ICN001

    figure: Figure = _drawn(shown, *what)
    return figure


@singledispatch
def _drawn(shown: Any, *_: Any) -> Figure:
    kinds = ", ".join(sorted(kind.__name__ for kind in _drawn.registry if kind is not object))
    raise WorkbenchError(
        f"there is no picture of a {type(shown).__name__}; there is one of {kinds}"
    )


@_drawn.register(LinearModel)
def _of_linear(linear: LinearModel, output: str = "") -> Figure:
    """Draw the Bode plot from the first input to an output, frequency in Hz."""
    name = output or linear.output_names[0]
    check_choice("output", name, linear.output_names)
    own = [m.frequency_hz for m in linear.modes if m.frequency_hz > 1e-6] or [1.0]
    hertz = np.geomspace(0.1 * min(own), 10 * max(own), 400)
    quantity = next(q for q in linear.operating_point.model.outputs if q.name == name)
    response = frequency_response(linear, name, hertz)
    shown = response / parse_unit(quantity.display_unit).factor
    driven = linear.input_names[0]
    units = {q.name: q.unit for q in linear.operating_point.model.inputs}
    unit = written(per(quantity.display_unit, units.get(driven, "1")))
    figure = bode(hertz, {f"{driven} to {name}".replace("_", " "): shown}, unit=unit)
    turns = np.asarray(figure.axes[1].lines[0].get_ydata(), dtype=float) / 90.0
    # Whole quarter turns, so that a phase between two of them has marks on its axis.
    low = np.floor(turns.min())
    figure.axes[1].set_ylim(90.0 * low, 90.0 * max(np.ceil(turns.max()), low + 1.0))
    return figure


@_drawn.register(Run)
def _of_run(run: Run, *others: Run) -> Figure:
    """Draw reference, output, error and command of runs, dashed what the linear model says."""
    name, command = run.controlled[0], run.input_quantities[0]
    quantity = next(q for q in run.output_quantities if q.name == name)
    unit = quantity.display_unit
    runs = [run, *others]
    full = [r for r in runs if r.model is not None] or runs
    ideal = {r.controller: np.asarray(from_si(r[name], unit)) for r in runs if r.model is None}
    curves: dict[str, Curves] = {}
    for r in full:
        label = r.controller
        while label in curves:
            label = f"{label}, {r.plant}" if r.plant not in label else f"{label}, again"
        linear = ideal.get(r.controller) if r.model is not None else None
        output = np.asarray(from_si(r[name], unit))
        curves[label] = Curves(label, r.time, output, r[command.name], linear)
    return tracking(
        run.time,
        from_si(run.references[name], unit),
        list(curves.values()),
        quantity=name.replace("_", " "),
        unit=written(unit),
        command=f"{command.name.replace('_', ' ')} in {written(command.unit)}",
    )


@_drawn.register(StudyResult)
def _of_study(found: StudyResult, scenario: str = "") -> Figure:
    """Draw what every controller did on the nominal plant in a scenario."""
    name = scenario or next(iter(found.study.scenarios))
    check_choice("scenario", name, found.study.scenarios)
    pictures = TRACKING.draw(found, name, "", "nominal")
    if not pictures:
        raise WorkbenchError(f"scenario {name!r} kept no trajectories on the nominal plant")
    figure: Figure = pictures[0].figure
    return figure


@_drawn.register(Trajectory)
def _of_trajectory(run: Trajectory, *names: str) -> Figure:
    """Draw inputs and outputs over time, or what is named."""
    model = run.model
    units: Mapping[str, str] = {
        q.name: shown_in(q) for q in (*model.inputs, *model.states, *model.outputs)
    }
    asked = names or tuple(q.name for q in (*model.inputs, *model.outputs))
    held = {q.name for q in model.inputs}
    ports = {p.name: p.unit for p in model.ports}
    shown = [units.get(n, ports.get(n, "1")) for n in asked]
    return recorded_signals(
        run.time,
        [f"{n.replace('_', ' ')}\nin {written(u)}" for n, u in zip(asked, shown, strict=True)],
        [from_si(run[n], u) for n, u in zip(asked, shown, strict=True)],
        [n in held for n in asked],
    )


_drawn.register(Recording)(recorded)


@_drawn.register(Diagnosis)
def _of_diagnosis(found: Diagnosis, recording: str = "") -> Figure:
    """Draw a held-out recording with the refitted and the extended model."""
    if not found.runs:
        raise WorkbenchError("the diagnosis did not get as far as runs on held-out recordings")
    refitted = found.runs["refitted"]
    name = recording or next(iter(refitted))
    check_choice("held-out recording", name, refitted)
    return diagnosis_runs(all_as_read(found.nominal, held_out_runs(found, name))[0])
