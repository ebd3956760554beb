"""What was tuned of a law begins a simpler one, as far as that goes."""

from __future__ import annotations

from dataclasses import replace

from workbench.diagnosis.selection.simplification import _begun
from workbench.physics.library import library
from workbench.plants.servo_axis import servo_axis


def test_what_was_tuned_beyond_the_bounds_of_a_simpler_law_ends_there() -> None:
    known = {h.name: h for h in library(servo_axis())}
    stops, stop = known["end_stops"], known["end_stop"]
    (touch,) = (q for q in stop.effect.parameters if q.name == "touch")
    tuned = tuple(
        replace(q, value=2.0 * q.value, upper=2.0 * q.value) if q.name == "touch" else q
        for q in stops.effect.parameters
    )
    entry = replace(stops, effect=replace(stops.effect, parameters=tuned))
    begun = {q.name: q for q in _begun(stop, entry, 1.0).effect.parameters}
    assert begun["touch"].value == touch.upper
