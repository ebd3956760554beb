"""One machine told in other sizes and times is judged alike: nothing is true of one scale alone."""

from __future__ import annotations

import numpy as np
import pytest
from pytest import approx

from tests.diagnosis.machine_data import recording
from tests.diagnosis.newcomers import diagnosed
from tests.machines import machine
from workbench.arrays import Vector
from workbench.diagnosis.estimation.observe import observe
from workbench.diagnosis.estimation.refit import refit
from workbench.diagnosis.undeclared.plant import with_undeclared
from workbench.model import Input, Model, Output, Parameter, Scope, State
from workbench.recordings.recording import Recording

SAMPLES, STEP = 3000, 0.005


def slide(kg: float, metre: float, second: float) -> Model:
    """A slide on a spring that a motor moves, of which all sizes are those of a small one times."""
    newton = kg * metre / second**2
    volt = newton * metre / second

    def equations(m: Scope) -> dict[str, object]:
        force = m.p.constant * m.x.current - m.p.stiffness * m.x.place - m.p.drag * m.x.speed
        drop = m.p.resistance * m.x.current + m.p.constant * m.x.speed
        return {
            "place": m.x.speed,
            "speed": force / m.p.mass,
            "current": (m.u.voltage - drop) / m.p.inductance,
        }

    def known(name: str, unit: str, value: float, low: float, high: float, by: float) -> Parameter:
        fitted = high > low
        ends = {"lower": low * by, "upper": high * by} if fitted else {}
        return Parameter(name, unit, value=value * by, fitted=fitted, **ends)

    return Model(
        "slide",
        lambda m: (equations(m), {"place": m.x.place, "current": m.x.current}),
        states=(
            State("place", "m", 0.05 * metre),
            State("speed", "m/s", 0.3 * metre / second),
            State("current", "A", 2.0),
        ),
        inputs=(Input("voltage", "V", 10.0 * volt, lower=-20.0 * volt, upper=20.0 * volt),),
        outputs=(Output("place", "m"), Output("current", "A")),
        parameters=(
            known("mass", "kg", 2.0, 0.0, 0.0, kg),
            known("stiffness", "N/m", 900.0, 100.0, 5000.0, newton / metre),
            known("drag", "N s/m", 12.0, 0.0, 100.0, newton * second / metre),
            known("constant", "N/A", 15.0, 5.0, 50.0, newton),
            known("resistance", "ohm", 2.0, 0.2, 20.0, volt),
            known("inductance", "H", 0.02, 0.0, 0.0, volt * second),
        ),
    )


def _moved(seed: int) -> tuple[Vector, Vector]:
    """Return voltages and what is read of the small slide, which dry friction of 3 N holds."""
    rng = np.random.default_rng(seed)
    voltage = np.repeat(rng.uniform(-14.0, 14.0, SAMPLES // 100), 100)
    x, parts = np.zeros(3), 10
    h, rows = STEP / parts, np.zeros((SAMPLES, 2))

    def rates(y: Vector, u: float, sign: float) -> Vector:
        pull = 14.0 * y[2] - 1000.0 * y[0] - 14.0 * y[1]
        return np.array([y[1], (pull - 3.0 * sign) / 2.0, (u - 2.3 * y[2] - 14.0 * y[1]) / 0.02])

    for k, u in enumerate(voltage):
        rows[k] = x[0], x[2]
        for _ in range(parts):
            pull = 14.0 * x[2] - 1000.0 * x[0]
            # It sticks, or friction is against the motion and ends with it.
            sticks = x[1] == 0.0 and abs(pull) < 3.0
            sign = pull / 3.0 if sticks else float(np.sign(x[1] or pull))
            a = rates(x, u, sign)
            b = rates(x + 0.5 * h * a, u, sign)
            c = rates(x + 0.5 * h * b, u, sign)
            new = x + h / 6.0 * (a + 2.0 * b + 2.0 * c + rates(x + h * c, u, sign))
            if sticks or new[1] * sign < 0.0:
                new[1] = 0.0
            x = new
    return voltage, rows + np.array([2e-5, 4e-3]) * rng.normal(size=rows.shape)


@pytest.fixture(scope="module")
def moved() -> list[tuple[Vector, Vector]]:
    return [_moved(seed) for seed in (1, 2)]


def _recorded(
    moved: list[tuple[Vector, Vector]], kg: float, metre: float, second: float
) -> list[Recording]:
    volt = kg * metre**2 / second**3
    runs: list[Recording] = []
    for k, (voltage, read) in enumerate(moved):
        told = {"place [m]": metre * read[:, 0], "current [A]": read[:, 1]}
        runs.append(recording(f"run {k}", second * STEP, {"voltage [V]": volt * voltage}, told))
    return runs


LAWS = "coulomb_friction joint_hysteresis lugre_friction quadratic_drag"


@pytest.mark.long
@pytest.mark.parametrize("sizes", [(1e6, 1e2, 1e2), (1e-15, 1e-6, 1e-3)])
def test_a_slide_that_sticks_is_told_by_its_friction_however_large_or_slow(
    moved: list[tuple[Vector, Vector]], sizes: tuple[float, float, float]
) -> None:
    verdict = diagnosed(slide(*sizes), _recorded(moved, *sizes), LAWS).verdict
    (finding,) = verdict.findings
    assert (finding.effect, finding.belief) == ("coulomb_friction_speed", "sure"), verdict
    # 3 N on 2 kg.
    level = finding.parameters["level"].value * sizes[2] ** 2 / sizes[1]
    assert level == approx(1.5, rel=5e-3)


def test_intervals_of_the_nominal_model_do_not_depend_on_units(
    moved: list[tuple[Vector, Vector]],
) -> None:
    sizes = (1.0, 1.0, 1.0), (1e-15, 1e-6, 1e-3)
    fits = []
    for each in sizes:
        runs = _recorded(moved, *each)
        model, _ = with_undeclared(slide(*each), runs)
        # Equations that are trusted leave errors that last.
        fits.append(refit(model, [observe(model, run) for run in runs], stages=(1.0, 0.3)))
    assert fits[0].cost == approx(fits[1].cost, rel=1e-9)
    assert max(fits[0].inflations) > 1.5
    assert fits[0].inflations == approx(fits[1].inflations, rel=1e-4)


@pytest.mark.long
@pytest.mark.parametrize(("metre", "second"), [(1.0, 1.0), (1e-3, 1e-4)])
def test_a_cart_without_a_time_of_its_own_lacks_nothing_however_quick(
    metre: float, second: float
) -> None:
    newton = metre / second**2
    cart = machine(
        lambda m: {"place": m.x.speed, "speed": m.u.push / m.p.mass},
        f"place m scale={0.5 * metre}, speed m/s scale={0.5 * metre / second}",
        f"push N {-20 * newton} {20 * newton}",
        "place m",
        "mass kg 1.8 0.5 6",
    )
    runs, step, parts = [], 0.01, 5
    for seed in (1, 2):
        rng = np.random.default_rng(seed)
        x, push, places, to = np.zeros(2), np.zeros(1200), np.zeros(1200), 0.0
        for k in range(len(push)):
            to = rng.uniform(-1.0, 1.0) if k % 150 == 0 else to
            places[k], push[k] = x[0], 20.0 * (to - x[0]) - 8.0 * x[1] + 0.5 * rng.normal()
            for _ in range(parts):
                rate = 0.5 * push[k]
                x += step / parts * np.array([x[1] + 0.5 * step / parts * rate, rate])
        read = {"place [m]": metre * (places + 2e-4 * rng.normal(size=len(places)))}
        runs.append(recording(f"run {seed}", second * step, {"push [N]": newton * push}, read))
    verdict = diagnosed(cart, runs, "sensor_gain viscous_friction quadratic_drag").verdict
    assert verdict.kind == "nothing_missing", verdict
