"""The schema of a study file: every field with its unit, range and example.

It is checked before anything is built, it says which keys there are, and the page of all fields is
written from it.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from controllers.uncertainty import Uncertainty
from workbench.checked_json import (
    Place,
    Shape,
    ShapeError,
    anything,
    flag,
    listed,
    named,
    number,
    one_of,
    size,
    text,
    whole,
)
from workbench.errors import WorkbenchError, check_choice
from workbench.model.units import quantity
from workbench.study.designs import Fastest
from workbench.study.study import Box, Limitations, Variation
from workbench.verification import Requirement, Scenario, Tolerance
from workbench.verification.scenario import EVENTS_S, FAULTS, RANGES_S, USUAL_SAMPLES
from workbench.verification.signals import BEGINS_S, FREQUENCIES_HZ

_FIXED = ("1", "s", "Hz")
"""Units that stand for one, whatever the plant: their numbers are converted as they are read."""


class ToldError(ShapeError):
    """An entry whose mistake is a whole sentence already."""


@dataclass(frozen=True)
class FieldTable:
    """A table of a study file whose fields are known.

    Args:
        partial: Whether needed fields may be missing, because another table may have them.
        others: Whether there may be other fields, such as the options of a plant or the keys of a
            reference of one's own.
    """

    fields: Mapping[str, Field]
    partial: bool = False
    others: bool = False

    def __call__(self, value: Any, place: Place) -> Any:
        """Accept a table that has the needed fields and no unknown ones."""
        found = dict(named(anything)(value, place))
        name = ".".join(map(str, place)) or "the study"
        for key, item in found.items():
            if key in self.fields:
                found[key] = self.fields[key](item, (*place, key))
            elif not self.others:
                try:
                    check_choice(f"key of {name}", key, self.fields)
                except WorkbenchError as error:
                    raise ToldError((*place, key), str(error)) from None
        if not self.partial:
            self.check_needed(found, place)
        return found

    def check_needed(self, table: Mapping[str, Any], place: Place) -> None:
        """Check that every needed field is there.

        Raises:
            ToldError: If one is not.
        """
        for key, field in self.fields.items():
            if field.needed and not table.get(key) and table.get(key) != 0:
                name = ".".join(map(str, place)) or "the study"
                raise ToldError(place, f"{name} has no {key!r}; add it")


@dataclass(frozen=True)
class Field:
    """An entry of a table.

    Args:
        example: How it is written in TOML; none for a table of fields.
        unit: Unit of a number without one, in words where it depends on another entry.
        range: Least and largest value, in ``unit``.
        usual: What holds where it is left out.
        needed: Whether it must be given.
    """

    shape: Shape
    text: str
    example: str = ""
    unit: str = ""
    range: tuple[float, float] | None = None
    usual: object = ""
    needed: bool = False

    def __call__(self, value: Any, place: Place) -> Any:
        """Accept what has the shape and is in the range; numbers of a fixed unit become SI."""
        return self._read(self.shape(value, place), place)

    def _read(self, value: Any, place: Place) -> Any:
        if isinstance(value, list):
            return [self._read(item, (*place, i)) for i, item in enumerate(value)]
        if isinstance(value, dict) and self.unit:
            return {name: self._read(item, (*place, name)) for name, item in value.items()}
        if not (self.unit in _FIXED or self.range) or isinstance(value, (bool, dict)):
            return value
        unit = self.unit if self.unit in _FIXED else "1"
        try:
            given = quantity(str(place[-1]), value, unit)
        except WorkbenchError as error:
            raise ToldError(place, str(error)) from None
        if self.range is not None and not self.range[0] <= given <= self.range[1]:
            shown = f"{given:g}" if unit == "1" else f"{given:g} {unit}"
            raise ShapeError(place, f"is {shown}; the valid range is {self.valid}")
        return value if isinstance(value, int) and unit == "1" else given

    @property
    def valid(self) -> str:
        """The range in words; empty if there is none."""
        if self.range is None:
            return ""
        low, high = self.range
        unit = "" if self.unit == "1" or self.unit.startswith("`") else f" {self.unit}"
        if math.isinf(high):
            return f"{low:g}{unit} or more"
        return f"{low:g} to {high:g}{unit}"


NAMES = listed(text)
_SIZES = named(size)
_OWN = "that of the parameter"
_OUTPUT = "that of the output"

_PARAMETERS = Field(_SIZES, "parameters that have another value", '{ mass = "4 kg" }', _OWN)
VARIED = {
    "parameters": _PARAMETERS,
    "effects": Field(
        NAMES, "effects of the library, or `module:object`, that are attached", '["hysteresis"]'
    ),
    "without": Field(NAMES, "effects of the plant that are left out", '["bearing_friction"]'),
    "noise": Field(size, "factor on the noise of every sensor", "2.0", "1", (0, 100), 1.0),
}
SELECTION = {
    "seeds": Field(whole, "how many of the seeds run", "1", "1", (1, 1000), "all"),
    "scenarios": Field(NAMES, "scenarios that run", '["step"]', usual="all"),
    "variations": Field(NAMES, "variations that run", '["nominal"]', usual="all"),
    "judged": Field(flag, "whether requirements apply; it is evidence if not", "true", usual=True),
}
_OPTIONAL = Field(
    flag, "whether it runs with `--fresh` of `controllers` alone", "true", usual=False
)


def _event(what: str, which: str, column: str, example: str, unit: str) -> dict[str, Field]:
    return {
        "time": Field(size, f"when {what} begins", '"0.5 s"', "s", EVENTS_S, needed=True),
        which: Field(text, f"name of the {which}", f'"{example}"', needed=True),
        column: Field(size, f"{column} of {what}", "2.5", unit, needed=True),
    }


_UNTIL = Field(size, "when it ends", '"2 s"', "s", EVENTS_S, "never")
_DISTURBANCE = FieldTable(
    {**_event("the load", "port", "level", "joint.torque", "that of the port"), "until": _UNTIL},
)
_CHANGE = FieldTable(_event("the change", "parameter", "value", "mass", _OWN))
_FAULT = FieldTable(
    {
        "time": Field(size, "when it begins", "1.0", "s", EVENTS_S, needed=True),
        "signal": Field(text, "a sensor, or `reference.NAME`", '"angle"', needed=True),
        "kind": Field(one_of(*FAULTS), f"one of {', '.join(FAULTS)}", '"stuck"', needed=True),
        "level": Field(size, "the offset or the value", "0.1", "SI unit of the signal", usual=0.0),
        "until": _UNTIL,
    },
)
_DISTURBANCES = Field(
    listed(_DISTURBANCE), "constants that are added to ports", "[{ ... }]", usual="none"
)

VARIATION = FieldTable(
    {
        **VARIED,
        "scaled": Field(
            _SIZES, "factors on parameters, whatever their bounds", "{ mass = 2.0 }", "1"
        ),
        "scenarios": SELECTION["scenarios"],
        "controllers": Field(NAMES, "controllers that run it", '["pid"]', usual="all"),
        "disturbances": _DISTURBANCES,
        "ideal": Field(flag, "whether sensors and converters are ideal", "true", usual=False),
        "late_samples": Field(
            whole, "samples by which commands are late", "1", "1", (0, 1000), Variation.late_samples
        ),
        "plan_duration": Field(
            size, "factor on the duration of planned moves", "1.5", "1", (0.01, 100), 1.0
        ),
        "lead": Field(size, "added to the lead of the feedforward", '"2 ms"', "s", (-1, 1), 0.0),
        "judged": SELECTION["judged"],
        "like": Field(text, "variation whose entries it has too", '"4 kg"'),
        "optional": _OPTIONAL,
    },
)
_SPEED = "unit of the key"
UNCERTAINTY = FieldTable(
    partial=True,
    fields={
        "delay": Field(
            listed(size, length=2),
            "least and largest time between measurement and valve",
            '["0 ms", "8 ms"]',
            "s",
            usual=list(Uncertainty.delay),
        ),
        "sensor_lag": Field(
            listed(size, length=2),
            "least and largest lag of the sensors with noise",
            '["0 ms", "10 ms"]',
            "s",
            usual=list(Uncertainty.sensor_lag),
        ),
        "trusted_frequency": Field(
            size,
            "frequency above which no model is trusted",
            '"30 Hz"',
            "Hz",
            (1e-3, 1e6),
            Uncertainty.trusted_frequency / (2.0 * math.pi),
        ),
        "declared": Field(
            flag,
            "whether the limits also hold for what the plant declares as tolerated",
            usual=True,
        ),
    },
)
FASTEST = FieldTable(
    partial=True,
    fields={
        "key": Field(
            text, "key of the specification that sets the speed", '"bandwidth"', needed=True
        ),
        "speeds": Field(
            listed(number, length=3),
            "first, last (lower) speed, and how many are tried",
            "[60, 20, 9]",
            _SPEED,
            needed=True,
        ),
        "at": Field(
            listed(_SIZES),
            "operating points at which the limits hold",
            '[{ angle = "30 deg" }]',
            _OUTPUT,
            usual="that of the design",
        ),
        "variations": Field(
            NAMES, "variations on which the limits hold", '["4 kg"]', usual="nominal"
        ),
        "maximum_sensitivity": Field(
            number, "limit on Ms", "2.0", "1", (1, 1e3), Fastest.maximum_sensitivity
        ),
        "maximum_complementary": Field(
            number, "limit on Mt", "1.9", "1", (1, 1e3), Fastest.maximum_complementary
        ),
        "late_sensitivity": Field(
            number, "limit on Ms with commands one sample late", "3.0", "1", (1, 1e3), "none"
        ),
        "uncertainty": Field(
            UNCERTAINTY, "what the limits hold for beside the models, at every sensor and command"
        ),
        "reduced": Field(text, "key that is reduced where no speed is within the limits", '"gain"'),
        "factors": Field(listed(number), "what it is reduced by", "[1.0, 0.7]", "1", (1e-6, 1)),
    },
)
CONTROLLER = FieldTable(
    partial=True,
    fields={
        "design": Field(
            text, "a design of the list below, or `module:function`", '"pid"', needed=True
        ),
        "at": Field(
            _SIZES,
            "operating point of the linear model",
            '{ angle = "30 deg" }',
            _OUTPUT,
            usual="that of the plant",
        ),
        "specification": Field(
            named(anything), "keys of the design, see below", "{ bandwidth = 30.0 }"
        ),
        "guard": Field(flag, "whether it runs inside a guard", "true", usual=False),
        **VARIED,
        "parameters": _PARAMETERS,
        "inertia_margin": Field(
            _SIZES, "added to parameters for the feedback alone", '{ mass = "0.6 kg" }', _OWN
        ),
        "plan": Field(
            named(anything),
            "options of the planned move of a design on the plant's model",
            "{ jerk_share = 0.7 }",
        ),
        "fastest": Field(FASTEST, "search of the fastest design within limits on Ms and Mt"),
        "plants": Field(NAMES, "plants that it is designed for", '["3 kg"]', usual="all"),
        "requires": Field(
            NAMES, "packages without which it is left out", '["slycot"]', usual="none"
        ),
        **SELECTION,
    },
)
REFERENCE = FieldTable(
    others=True,
    fields={
        "kind": Field(
            text, "steps, ramps, sine, recorded, or `module:object`", '"steps"', usual="steps"
        ),
        "unit": Field(text, "unit of its values", '"deg"', usual="SI"),
        "times": Field(listed(number), "times of steps, ramps, recorded", "[0.0, 0.5]", "s"),
        "values": Field(listed(number), "value from each time on", "[15, 45]", "`unit`"),
        "mean": Field(number, "mean of a sine", "30", "`unit`"),
        "amplitude": Field(number, "amplitude of a sine", "10", "`unit`"),
        "frequency_Hz": Field(number, "frequency of a sine", "1.0", "Hz", FREQUENCIES_HZ),
        "begin": Field(number, "time until which a sine holds its mean", "0.5", "s", BEGINS_S, 0.0),
        "file": Field(text, "CSV file of a recorded reference, time in s first", '"run.csv"'),
        "column": Field(text, "its column", '"angle"'),
    },
)


def _time(key: str, says: str, example: str, **more: Any) -> Field:
    samples = USUAL_SAMPLES.get(key)
    usual = getattr(Scenario, key, "") if samples is None else f"{samples} samples"
    return Field(size, says, example, "s", RANGES_S[key], **{"usual": usual, **more})


SCENARIO = FieldTable(
    partial=True,
    fields={
        "duration": _time("duration", "length of the run", '"4 s"', needed=True),
        "sample_time": _time("sample_time", "time between samples of the loop", '"2 ms"'),
        "references": Field(named(REFERENCE), "reference of each controlled output", needed=True),
        "start": Field(
            _SIZES,
            "operating point at which the run starts",
            '{ angle = "15 deg" }',
            _OUTPUT,
            usual="the references at 0 s",
        ),
        "settle": _time("settle", "time for which the loop holds the start before 0 s", '"0.5 s"'),
        "changes": Field(
            listed(_CHANGE), "parameters that change during the run", "[{ ... }]", usual="none"
        ),
        "disturbances": _DISTURBANCES,
        "faults": Field(
            listed(_FAULT), "measurements and references that go wrong", "[{ ... }]", usual="none"
        ),
        "noise": Field(flag, "whether sensors are noisy", "true", usual=Scenario.noise),
        "quantise": Field(
            flag, "whether converters have their resolution", "true", usual=Scenario.quantise
        ),
        "late_samples": Field(
            whole, "samples by which commands are late", "1", "1", (0, 1000), Scenario.late_samples
        ),
        "rest_window": _time(
            "rest_window", "end of a step at which errors and oscillation are taken", '"1 s"'
        ),
        "count_from": _time("count_from", "time from which tracking errors count", '"0.5 s"'),
        **SELECTION,
        "optional": _OPTIONAL,
    },
)
CAUSE = FieldTable(
    {
        "name": Field(text, "name under which misses are listed", '"dry friction"', needed=True),
        "text": Field(text, "what it is", '"No design knows it."'),
        "variation": Field(text, "variation that shows it", '"hysteresis"'),
    },
)
LIMITATIONS = FieldTable(
    {
        "scenario": Field(text, "scenario whose steps are compared", '"step"', needed=True),
        **{
            key: Field(CAUSE, says)
            for key, says in (
                ("unknown", "what no design knows and a plan must bear"),
                ("neglected", "what the design models leave out"),
                ("loop", "what a loop of finite bandwidth adds"),
                ("design", "where another controller reaches the goal"),
            )
        },
        "ladder": Field(
            listed(listed(text, length=2)),
            "variations with one limitation less at a time, and what the plant lacks there",
            '[["no friction", "friction"]]',
        ),
        "controllers": Field(NAMES, "controllers whose steps are shown", '["pid"]', usual="none"),
        "ratio": Field(
            size, "wanted settling over physical limit", "2.0", "1", (0, 1e3), Limitations.ratio
        ),
        "overshoot": Field(
            size, "overshoot of a faster plan", "0.05", "1", (0, 1e3), Limitations.overshoot
        ),
        "notes": Field(NAMES, "further paragraphs", '["..."]'),
    },
)
PLANT = FieldTable(
    others=True,
    fields={
        "kind": Field(
            text, "a plant of `workbench plants`, `module:object`, or a verdict.json", '"arm"'
        ),
        **VARIED,
    },
)
PLANTS = FieldTable(
    others=True,
    fields={
        **VARIED,
        "controllers": Field(named(CONTROLLER), "what differs in controllers"),
        "variations": Field(named(VARIATION), "what differs in variations"),
        "scenarios": Field(named(SCENARIO), "what differs in scenarios"),
        "optional": _OPTIONAL,
    },
)
REQUIREMENT = FieldTable(
    {
        "metric": Field(text, "a metric of the list below", '"settling_time"', needed=True),
        "limit": Field(number, "the limit", "0.5", "`unit`", (0, math.inf), needed=True),
        "unit": Field(text, "unit of the limit", '"s"', usual="SI unit of the metric"),
        "kind": Field(
            one_of("at_most", "at_least"),
            "at_most or at_least",
            '"at_most"',
            usual=Requirement.kind,
        ),
        "hard": Field(flag, "whether missing it fails the study", "true", usual=Requirement.hard),
        "scenario": Field(text, "scenario that it judges", '"step"', usual="all"),
        "step": Field(
            size,
            "size of the steps that settling_time and overshoot judge",
            '"10 deg"',
            _OUTPUT,
            usual="all",
        ),
        "controllers": Field(NAMES, "controllers that it judges", '["pid"]', usual="all"),
        "variations": Field(NAMES, "variations that it judges", '["nominal"]', usual="all"),
        "plants": Field(NAMES, "plants that it judges", '["3 kg"]', usual="all"),
        "weight": Field(number, "weight in the mean score", "1.0", "1", (0, 1e6), 1.0),
    },
)
LINEAR = FieldTable(
    {
        "angles": Field(listed(size), "values of the controlled output", '["30 deg"]', _OUTPUT),
        "points": Field(
            listed(_SIZES), "operating points", '[{ angle = "30 deg" }]', _OUTPUT, usual="designs'"
        ),
    },
)
ROBUSTNESS = FieldTable(
    {
        "box": Field(
            named(listed(size, length=2)),
            "lowest and highest value of parameters",
            '{ mass = ["2 kg", "4 kg"] }',
            _OWN,
            needed=True,
        ),
        "scenarios": Field(NAMES, "scenarios of every draw", '["step"]', usual="the first"),
        "controllers": Field(NAMES, "controllers that are tried", '["pid"]', usual="all"),
        "draws": Field(whole, "plants that are drawn", "20", "1", (4, 10_000), Box.draws),
        "search": Field(
            whole, "further plants of the search of the worst", "12", "1", (0, 1000), Box.search
        ),
        "seed": Field(whole, "seed of the draws", "1", "1", (0, 2**31), Box.seed),
        "hard": Field(
            flag, "whether a requirement missed at the worst plant fails", "true", usual=Box.hard
        ),
    },
)
_TOLERANCE = Tolerance()
TOLERANCE = FieldTable(
    {
        "absolute": Field(
            size,
            "difference that does not count",
            "0.01",
            "SI unit of the metric",
            usual="that of the metric",
        ),
        "relative": Field(
            number,
            "difference that does not count, of the baseline's value",
            "0.05",
            "1",
            (0, 10),
            _TOLERANCE.relative,
        ),
        "better": Field(
            one_of("less", "more", "neither"), "less, more or neither", '"less"', usual="less"
        ),
        "gates": Field(flag, "whether a worse value fails the study", "true", usual=True),
    },
)
REPORT = FieldTable(
    {
        "physical_limit": Field(
            flag, "whether steps are compared with the fastest move", "true", usual=False
        ),
        "limit_steps": Field(
            listed(listed(size, length=2)),
            "steps that are compared",
            "[[0.26, 0.52]]",
            _OUTPUT,
            usual="all",
        ),
        "limit_variations": Field(
            NAMES, "variations whose fastest move is found too", '["4 kg"]', usual="none"
        ),
        "figures": Field(NAMES, "figures of one's own, `module:object`", '["mine:fast"]'),
        "traced": Field(
            NAMES, "variations whose courses are drawn", '["hysteresis"]', usual="nominal"
        ),
        "limitations": Field(LIMITATIONS, "section on what keeps controllers from a goal"),
    },
)
STUDY = FieldTable(
    {
        "schema": Field(whole, "version of the file", "1", usual=1),
        "name": Field(text, "name of the study", '"arm"', usual="name of the file"),
        "description": Field(text, "what it is about, a sentence", '"Two designs."'),
        "seeds": Field(
            listed(whole), "seeds of the sensors' noise", "[1, 2]", "1", (0, 2**63 - 1), [1]
        ),
        "metrics": Field(NAMES, "metrics of one's own, `module:object`", '["mine:energy"]'),
        "plant": Field(PLANT, "what controllers are designed for and run on"),
        "variations": Field(named(VARIATION), "the plant with something else"),
        "controllers": Field(named(CONTROLLER), "what is compared", needed=True),
        "scenarios": Field(named(SCENARIO), "what is asked of a loop", needed=True),
        "requirements": Field(listed(REQUIREMENT), "what is required of a run", needed=True),
        "robustness": Field(
            ROBUSTNESS, "a box from which plants are drawn, and the worst searched"
        ),
        "tolerances": Field(named(TOLERANCE), "how a metric is compared with a baseline"),
        "linear": Field(LINEAR, "where loops are opened for Bode plots and margins"),
        "report": Field(REPORT, "what is shown beside the runs"),
        "plants": Field(named(PLANTS), "several plants that controllers are designed for"),
    },
)
"""Shape of a study file; options of a plant stand in its tables too."""
