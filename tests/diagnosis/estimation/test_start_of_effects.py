"""The start of an effect's states is as uncertain as its law says."""

from __future__ import annotations

from workbench.diagnosis.estimation.observe import observe
from workbench.diagnosis.estimation.process_noise import extended_start
from workbench.evaluation.foreign.foreign_case import plan
from workbench.physics.library import library


def test_a_clock_is_not_set_by_a_filter() -> None:
    # Otherwise the filter moves the time of an event in each recording to where it likes it.
    case = next(c for c in plan(60, 9200) if c.title == "tank: heater_failure")
    model = case.build()
    law = next(e for e in library(model) if e.name == "gain_jump_heater_power")
    extended = model.with_effect(law.at_size(0.0))
    seen = observe(model, next(iter(case.recordings().values())))
    started = extended_start(seen, model, extended)
    rms = dict(zip((q.name for q in extended.states), started.start_rms, strict=True))
    # An hour of a recording of days is known to well below a sample.
    assert rms["gain_jump_heater_power.clock"] < 1e-3 * seen.sample_time
