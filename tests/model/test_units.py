"""Factors of the units that data sheets and files use, from the definitions of the SI."""

import math
from typing import Any

import numpy as np
import pytest

from workbench.errors import WorkbenchError
from workbench.model import Input, Model, Output, Parameter, Scope, State
from workbench.model.trace import Equations
from workbench.model.units import convert, is_known, same_dimension, to_si
from workbench.physics.library import library
from workbench.simulation.trajectory import what_moved


@pytest.mark.parametrize(
    ("unit", "si", "size"),
    [
        ("cm", "m", 1e-2),
        ("mm", "m", 1e-3),
        ("um", "m", 1e-6),
        ("µs", "s", 1e-6),
        ("ns", "s", 1e-9),
        ("kHz", "Hz", 1e3),
        ("mA", "A", 1e-3),
        ("mrad", "rad", 1e-3),
        ("kN", "N", 1e3),
        ("mg", "kg", 1e-6),
        ("hPa", "Pa", 1e2),
        ("mbar", "Pa", 1e2),
        ("bar", "Pa", 1e5),
        ("MPa", "Pa", 1e6),
        ("kW", "J/s", 1e3),
        ("l/min", "m3/s", 1e-3 / 60.0),
        ("km/h", "m/s", 1.0 / 3.6),
        ("ohm", "V/A", 1.0),
        ("N.m.s/rad", "N m s/rad", 1.0),
        ("kOhm", "V/A", 1e3),
        ("uH", "V s/A", 1e-6),
        ("nF", "A s/V", 1e-9),
        ("mmol/l", "mol/m3", 1.0),
        ("GPa", "N/m2", 1e9),
        ("mT", "V s/m2", 1e-3),
        ("kn", "m/s", 1852.0 / 3600.0),
        ("day", "s", 86400.0),
        ("cmH2O", "Pa", 98.0665),
        ("l/(s cmH2O)", "m3/(s Pa)", 1e-3 / 98.0665),
        ("mTorr", "Pa", 101.325 / 760.0),
        ("1/month", "1/s", 12.0 / (365.25 * 86400.0)),
        ("weeks", "s", 7 * 86400.0),
        ("arcsec", "rad", math.pi / 648000),
        ("bpm", "Hz", 1.0 / 60.0),
        ("lx", "lm/m2", 1.0),
        ("cP", "Pa s", 1e-3),
        ("uM", "mol/m3", 1e-3),
        ("‰", "1", 1e-3),
        ("sccm", "m3/s", 1e-6 / 60.0),
        ("mAh", "A s", 3.6),
        ("cm1.5/s", "m^1.5/s", 1e-3),
        ("\u03bcm", "m", 1e-6),
        ("k\u2126", "V/A", 1e3),
    ],
)
def test_one_of_a_unit_in_si(unit: str, si: str, size: float) -> None:
    assert same_dimension(unit, si)
    assert float(to_si(1.0, unit)) == pytest.approx(size, rel=1e-12)
    assert float(convert(size, si, unit)) == pytest.approx(1.0, rel=1e-12)


def glucose(*, rest: str = "mg/dl", fixed: float | None = None) -> Model:
    """Sugar that insulin lowers, in minutes; ``fixed`` stands for its rest, as a bare number."""

    def equations(m: Any) -> Equations:
        rate = m.p.pace * ((m.p.rest if fixed is None else fixed) - m.x.sugar)
        taken = m.port("body.uptake", m.p.gain * m.u.insulin, unit="mg/(dl min)", scale=2.0)
        return {"sugar": rate - taken}, {"read": m.x.sugar}

    return Model(
        "glucose",
        equations,
        states=(State("sugar", "mg/dl", initial=120.0, lower=0.0),),
        inputs=(Input("insulin", "mU/min", lower=0.0, upper=50.0, nominal=10.0),),
        outputs=(Output("read", "mg/dl", noise_rms=2.0),),
        parameters=(
            Parameter("pace", "1/min", value=0.012, lower=0.0, upper=0.1),
            Parameter("rest", rest, value=130.0),
            Parameter("gain", "mg/(dl mU)", value=0.02),
        ),
    )


@pytest.mark.parametrize("fixed", [None, 130.0])
def test_equations_count_in_units_of_their_own(fixed: float | None) -> None:
    plant = glucose(fixed=fixed)
    sugar, (pace, *_) = plant.states[0], plant.parameters
    assert (sugar.unit, sugar.display_unit, plant.read_in("pace")) == ("kg/m3", "mg/dl", "1/min")
    assert pace.value == pytest.approx(0.012 / 60.0)
    assert plant.inputs[0].unit == "mU/s"
    rate = 0.012 * (130.0 - 120.0) - 0.02 * 10.0
    assert plant.rates([1.2], [10.0 / 60.0]) == pytest.approx([rate * 0.01 / 60.0])
    assert plant.read([1.2], [0.0]) == pytest.approx([1.2])
    uptake = next(port for port in plant.ports if port.name == "body.uptake")
    passed = plant.signals([1.2], [10.0 / 60.0])["body.uptake"]
    assert to_si(passed, uptake.unit) == pytest.approx(0.2 * 0.01 / 60.0)
    assert to_si(uptake.scale, uptake.unit) == pytest.approx(2.0 * 0.01 / 60.0)


def test_units_that_do_not_belong_together_are_refused() -> None:
    with pytest.raises(WorkbenchError, match=r"sugar is in 'mg/dl'.*display_unit"):
        glucose(rest="g/m3")
    with pytest.raises(WorkbenchError, match=r"T is in 'degC'.*display_unit"):
        Model(
            "oven",
            lambda m: ({"T": m.p.room - m.x.T}, {"read": m.x.T}),
            states=(State("T", "degC"),),
            inputs=(),
            outputs=(Output("read", "degC"),),
            parameters=(Parameter("room", "K", value=293.0),),
        )
    # What is off by its zero alone is not named beside what is off by a factor.
    with pytest.raises(WorkbenchError, match=r"heat is in 'kW', others.*\('heat', 'W', disp"):
        Model(
            "oven",
            lambda m: ({"T": (m.u.heat - m.p.loss * m.x.T) / m.p.store}, {"read": m.x.T}),
            states=(State("T", "degC"),),
            inputs=(Input("heat", "kW"),),
            outputs=(Output("read", "degC"),),
            parameters=(Parameter("loss", "W/K", value=2.0), Parameter("store", "J/K", value=9.0)),
        )


@pytest.mark.parametrize(("time", "pace"), [("min", 60.0), ("s", 1.0)])
def test_a_flow_per_minute_asks_in_which_time_the_equations_count(time: str, pace: float) -> None:
    def stirred(said: str) -> Model:
        return Model(
            "stirred",
            lambda m: ({"c": m.u.flow * (0.2 - m.x.c) / m.p.volume}, {"c": m.x.c}),
            states=(State("c", "mol/l"),),
            inputs=(Input("flow", "l/min"),),
            outputs=(Output("c", "mol/l"),),
            parameters=(Parameter("volume", "l", value=50.0),),
            time=said,
        )

    with pytest.raises(WorkbenchError, match=r"time='min'\) if .* or time='s' if"):
        stirred("")
    flow = 2.0 * 1e-3 / 60.0
    rate = 2.0 * (0.2 - 0.1) / 50.0 * 1e3 / pace
    assert stirred(time).rates([100.0], [flow]) == pytest.approx([rate])


@pytest.mark.parametrize(("unit", "most"), [("%", 100.0), ("1", 1.0)])
def test_a_gain_for_each_per_cent_belongs_with_what_is_read_in_per_cent(
    unit: str, most: float
) -> None:
    def drum() -> Model:
        return Model(
            "drum",
            lambda m: ({"T": m.p.gain * m.u.gas - (m.x.T - 25.0)}, {"T": m.x.T}),
            states=(State("T", "degC"),),
            inputs=(Input("gas", unit, upper=most),),
            outputs=(Output("T", "degC"),),
            parameters=(Parameter("gain", "K/(% s)", value=0.4),),
        )

    if unit == "1":
        with pytest.raises(WorkbenchError, match="do not belong together"):
            drum()
    else:
        assert drum().rates([273.15 + 25.0], [0.5]) == pytest.approx([20.0])


def test_what_is_no_unit_here_is_one_by_its_own_name() -> None:
    assert convert(3.0, "mU/min", "mU/h") == pytest.approx(180.0)
    assert not same_dimension("mU", "CFU")
    assert not is_known("mU/min")
    with pytest.raises(WorkbenchError, match=r"cannot be read at '\^\^2'"):
        convert(1.0, "mU^^2", "mU")


def test_inputs_and_outputs_are_read_in_units_of_their_own() -> None:
    rudder = Input("rudder", "rad", display_unit="deg")
    assert (rudder.display_unit, Output("speed", "m/s").display_unit) == ("deg", "m/s")
    for kind in (Input, Output):
        with pytest.raises(WorkbenchError, match=r"'K' of rudder does not measure what 'rad'"):
            kind("rudder", "rad", display_unit="K")


def test_an_input_is_shown_in_the_unit_in_which_people_read_it() -> None:
    rudder, pressure = Input("rudder", "rad", display_unit="deg"), Input("pressure", "Pa")
    table = what_moved([(rudder, np.array([0.0, np.pi])), (pressure, np.array([0.0, 2e5]))])
    assert [row[2:] for row in table.rows] == [(pytest.approx(180.0), "deg"), (2.0, "bar")]


def test_degrees_fahrenheit_have_a_zero_of_their_own() -> None:
    assert float(to_si(212.0, "degF")) == pytest.approx(373.15)
    assert float(convert(-40.0, "degF", "degC")) == pytest.approx(-40.0)


def test_units_of_other_dimensions_are_refused() -> None:
    with pytest.raises(WorkbenchError, match="bar"):
        convert(1.0, "bar", "m")


def test_g_of_an_acceleration_is_told_its_unit() -> None:
    with pytest.raises(WorkbenchError, match="9.80665 m/s2 being gn"):
        Output("acceleration", "m/s2", display_unit="g")
    with pytest.raises(WorkbenchError, match="same kind$"):
        Output("acceleration", "m/s2", display_unit="kg")
    assert to_si(1.0, "gn") == 9.80665


def test_what_says_no_unit_is_a_plain_number() -> None:
    plain = Model(
        "plain",
        lambda m: ({"x": m.u.u - m.p.k * m.x.x}, {"y": m.x.x}),
        states=(State("x"),),
        inputs=(Input("u", lower=-1.0, upper=1.0),),
        outputs=(Output("y"),),
        parameters=(Parameter("k", value=2.0),),
    )
    every = (*plain.states, *plain.inputs, *plain.outputs, *plain.parameters)
    assert {q.unit for q in every} == {"1"}


def test_units_that_no_equation_joins_may_be_of_any_size() -> None:
    def drum(m: Any) -> Equations:
        steam = m.p.valve * m.x.pressure
        return {"pressure": (m.u.heat - steam * m.p.latent) / m.p.store}, {"flow": steam}

    plant = Model(
        "drum",
        drum,
        states=(State("pressure", "bar", initial=40.0),),
        inputs=(Input("heat", "kW"),),
        outputs=(Output("flow", "kg/s"),),
        parameters=(
            Parameter("valve", "kg/(s bar)", value=0.4),
            Parameter("latent", "kJ/kg", value=1700.0),
            Parameter("store", "kJ/bar", value=9000.0),
        ),
    )
    rate = (3e4 - 0.4 * 40.0 * 1700.0) / 9000.0
    assert plant.rates([40e5], [3e7]) == pytest.approx([rate * 1e5])


def test_who_says_the_time_of_equations_says_that_they_hold_their_factors() -> None:
    def tank(time: str) -> Model:
        return Model(
            "tank",
            lambda m: ({"level": 60.0 / 1000.0 * m.u.pump / m.p.area}, {"level": m.x.level}),
            states=(State("level", "m"),),
            inputs=(Input("pump", "l/min"),),
            outputs=(Output("level", "m"),),
            parameters=(Parameter("area", "m2", value=2.0),),
            time=time,
        )

    with pytest.raises(WorkbenchError, match=r"pump is in 'l/min'.*time='min'"):
        tank("")
    with pytest.raises(WorkbenchError, match=r"time is 'm'; give a unit of time"):
        tank("m")
    # 10 l/min into 2 m2 are 0.3 m an hour.
    assert tank("h").rates([0.0], [1e-2 / 60.0]) == pytest.approx([0.3 / 3600.0])


def test_what_goes_in_and_comes_out_says_no_time_of_plain_equations() -> None:
    heart = Model(
        "heart",
        lambda m: ({"beats": (m.p.gain * m.u.air - m.x.beats) / m.p.time}, {"rate": m.x.beats}),
        states=(State("beats"),),
        inputs=(Input("air", "l/min"),),
        outputs=(Output("rate", "1/min"),),
        parameters=(Parameter("gain", value=3.0), Parameter("time", "s", value=20.0)),
    )
    # 10 l/min raise it by 30 beats a minute, in 20 s.
    assert heart.rates([0.0], [1e-2 / 60.0]) == pytest.approx([1.5])
    assert heart.read([30.0], [0.0]) == pytest.approx([0.5])


def test_ports_of_equations_in_their_own_units_are_in_si() -> None:
    def tank(centimetres: bool) -> Model:
        def equations(m: Scope) -> tuple[dict[str, Any], dict[str, Any]]:
            flow = "cm3/s" if centimetres else "m3/s"
            out = m.port(
                "tank.outflow", m.p.drain * m.x.level, unit=flow, signals={"level": m.x.level},
                disturbance=0.2 if centimetres else 0.2e-6,
            )  # fmt: skip
            rate = (m.u.inflow - out) / m.p.area
            return {"level": rate}, {"level": m.x.level}

        long, flow, wide, drain = ["m", "m3/s", "m2", "m2/s"]
        if centimetres:
            long, flow, wide, drain = ["cm", "cm3/s", "cm2", "cm2/s"]
        size = 1.0 if centimetres else 0.01
        return Model(
            "tank",
            equations,
            states=(State("level", long, 10.0 * size, initial=15.0 * size),),
            inputs=(Input("inflow", flow, 15.0 * size**3, lower=0.0, upper=40.0 * size**3),),
            outputs=(Output("level", long, 5.0 * size),),
            parameters=(
                Parameter("area", wide, value=150.0 * size**2),
                Parameter("drain", drain, value=1.5 * size**2),
            ),
        )

    own, plain = (
        plant.with_effect(
            next(e for e in library(plant) if e.law == "orifice_outflow").at_size(2e-6)
        )
        for plant in map(tank, (True, False))
    )
    for one, other in zip(own.ports, plain.ports, strict=True):
        assert (one.name, one.unit, one.signals) == (other.name, other.unit, other.signals)
        assert one.scale == pytest.approx(other.scale)
        assert one.disturbance == pytest.approx(other.disturbance)
    at = [0.12], [2e-5]
    assert own.rates(*at) == pytest.approx(plain.rates(*at), rel=1e-12)
    assert own.rates(*at) != pytest.approx(tank(True).rates(*at))


@pytest.mark.parametrize(
    ("declare", "problem"),
    [
        (lambda: Parameter("length", "m", value=math.nan), "value of length is nan"),
        (lambda: Parameter("length", "m", value="long"), "value of length is 'long'"),  # type: ignore[arg-type]
        (lambda: Parameter("length", "m", value=1.0, lower=3.0, upper=2.0), "range of length is 3"),
        (lambda: Input("force", "N", 1.0, lower=20.0, upper=-20.0), "swap lower and upper"),
    ],
)
def test_a_slip_of_a_number_is_told(declare: Any, problem: str) -> None:
    with pytest.raises(WorkbenchError, match=problem):
        declare()


def test_a_misspelt_rate_is_told_by_its_state() -> None:
    def equations(m: Scope) -> tuple[dict[str, Any], dict[str, Any]]:
        pull = m.p.stiffness * m.x.way
        return {"way": m.x.speed, "sped": (m.u.force - pull) / 2.0, "turn": pull}, {"way": m.x.way}

    with pytest.raises(WorkbenchError, match="no rate of state 'speed'"):
        Model(
            "slip", equations,
            states=(State("way", "m"), State("speed", "m/s"), State("turn", "rad/s")),
            inputs=(Input("force", "N"),), outputs=(Output("way", "m"),),
            parameters=(Parameter("stiffness", "N/m", value=3.0),),
        )  # fmt: skip


@pytest.mark.parametrize(
    ("told", "value", "unit", "is_"),
    [
        ("revs", 2.0, "rad", 4.0 * math.pi),
        ("Umdr/min", 30.0, "rad/s", math.pi),
        ("krpm", 0.03, "rad/s", math.pi),
        ("rps", 1.0, "rad/s", 2.0 * math.pi),
        ("gon", 200.0, "rad", math.pi),
        ("Grad", 180.0, "rad", math.pi),
        ("Grad Celsius", 20.0, "K", 293.15),
        ("℃", 20.0, "K", 293.15),
        ("DEGF", 32.0, "K", 273.15),
        ("VOLTS", 2.0, "V", 2.0),
        ("Ampere", 2.0, "A", 2.0),
    ],
)
def test_units_as_loggers_and_people_of_other_tongues_write_them(
    told: str, value: float, unit: str, is_: float
) -> None:
    assert is_known(told) and convert(value, told, unit) == pytest.approx(is_)
