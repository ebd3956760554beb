"""Plants as a newcomer would write them, with guesses for scales, and data from SciPy.

Nothing of the workbench's simulation takes part in the data: the truth is integrated by SciPy in
plain numbers, and read with noise.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from fnmatch import fnmatch
from functools import lru_cache
from typing import Any
from unittest.mock import patch

import casadi as ca
import numpy as np
from scipy.integrate import solve_ivp

from tests.diagnosis.machine_data import by_runge_kutta, held, recording
from tests.machines import machine
from workbench.arrays import Vector
from workbench.diagnosis.diagnose import diagnose
from workbench.diagnosis.selection import task
from workbench.diagnosis.selection.held_out import over_noise
from workbench.diagnosis.stages import Diagnosis
from workbench.diagnosis.verdict import Finding
from workbench.model import Model, Scope
from workbench.model.trace import Equations
from workbench.physics.library import Hypothesis, library
from workbench.recordings.recording import Recording

Law = Callable[[float, float], float]


def diagnosed(
    model: Model, runs: Sequence[Recording], laws: str = "*", *, fit: int = 1, **told: Any
) -> Diagnosis:
    """Diagnose by the first recordings, with some laws of the library and the ranges it sees."""
    words = laws.split()

    def few(*given: Any, **known: Any) -> list[Hypothesis]:
        every = library(*given, **known)
        return [e for e in every if any(fnmatch(n, w) for n in (e.law, e.name) for w in words)]

    with patch.object(task, "library", few):
        return diagnose(model, runs[:fit], runs[fit:], jobs=1, advise=False, **told)


def named(found: Diagnosis, effect: str, *, noise: float = math.inf, **sizes: Any) -> Finding:
    """Return the one finding, which has to have a name, be sure, and be as large as it is.

    With it the runs on held-out recordings stay within so many times the noise.
    """
    verdict = found.verdict
    (finding,) = verdict.findings
    assert fnmatch(finding.effect or "", effect) and finding.belief == "sure", verdict
    values = {name: finding.parameters[name].value for name in sizes}
    assert values == sizes
    assert max(over_noise(verdict.fit).values()) < noise
    return finding


def oscillator(*, scale: float = 1.0, left_out: float = 0.02) -> Model:
    """A damped oscillator driven by a force; the guess of the port's scale may be far off."""

    def equations(m: Scope) -> Equations:
        force = m.port(
            "mass.force",
            m.u.drive - m.p.stiffness * m.x.position - m.p.damping * m.x.speed,
            unit="N",
            scale=scale,
            signals={"position": m.x.position, "speed": m.x.speed},
            disturbance=left_out * scale,
        )
        return (
            {"position": m.x.speed, "speed": force / m.p.mass},
            {"position": m.port("position.reading", m.x.position, unit="m")},
        )

    return machine(
        equations,
        "position m scale=1, speed m/s scale=5",
        "drive N scale=1",
        "position m 1e-3 scale=1",
        "mass kg 1.1 0.3 3, stiffness N/m 28 5 90, damping N s/m 0.5 0.01 3",
        name="oscillator",
    )


def carriage() -> Model:
    """A carriage driven by a force: an integrator, run in open loop."""

    def equations(m: Scope) -> Equations:
        force = m.port(
            "carriage.force",
            m.u.drive - m.p.damping * m.x.speed,
            unit="N",
            scale=50.0,
            signals={"position": m.x.position, "speed": m.x.speed},
            disturbance=1.0,
        )
        return (
            {"position": m.x.speed, "speed": force / m.p.mass},
            {"position": m.port("position.reading", m.x.position, unit="m")},
        )

    return machine(
        equations,
        "position m scale=0.5, speed m/s scale=0.2",
        "drive N scale=50",
        "position m 2e-5 scale=0.5",
        "mass kg 18 5 60, damping N s/m 60 0 400",
        name="carriage",
    )


def two_carts() -> Model:
    """Two carts beside one another, alike in all that the model knows of them."""

    def equations(m: Scope) -> Equations:
        rates, read = {}, {}
        for i, (drive, speed) in enumerate(((m.u.a, m.x.a), (m.u.b, m.x.b)), 1):
            force = m.port(
                f"cart_{i}.force",
                drive - m.p.damping * speed,
                unit="N",
                scale=5.0,
                signals={"speed": speed},
                role="force",
                disturbance=0.05,
            )
            rates["ab"[i - 1]] = force / m.p.mass
            read[f"speed_{i}"] = m.port(f"speed_{i}.reading", speed, unit="m/s")
        return rates, read

    return machine(
        equations,
        "a m/s, b m/s",
        "a N scale=5, b N scale=5",
        "speed_1 m/s 1e-3, speed_2 m/s 1e-3",
        "mass kg 1.1 0.3 3, damping N s/m 2 0.1 20",
    )


def driven_carts(drag: tuple[float, float]) -> list[Recording]:
    """Two recordings of carts of 1 kg with 3 N s/m and a drag in N s2/m2 each."""
    runs = []
    for seed in (1, 2):
        inputs = 5.0 * np.sign(np.sin(np.outer([1.7 + 0.3 * seed, 2.9], 0.01 * np.arange(600))))

        def rates(_: float, v: Vector, *drive: float) -> Vector:
            return np.array(drive) - 3.0 * v - np.array(drag) * v * np.abs(v)

        speeds = held(rates, np.zeros(2), inputs, 0.01).T
        read = speeds + 1e-3 * np.random.default_rng(seed).normal(size=speeds.shape)
        commands = {"a [N]": inputs[0], "b [N]": inputs[1]}
        measured = {"speed_1 [m/s]": read[0], "speed_2 [m/s]": read[1]}
        runs.append(recording(f"carts {seed}", 0.01, commands, measured))
    return runs


def damper() -> Model:
    """A damper without memory, as one writes it who only maps speed to force: no state at all."""

    def equations(m: Scope) -> Equations:
        force = m.port(
            "damper.force", m.p.damping * m.u.speed, unit="N", signals={"speed": m.u.speed}
        )
        return {}, {"force": force}

    return machine(equations, "", "speed m/s", "force N 0.05", "damping N s/m 3 0.1 20")


def rubbed() -> list[Recording]:
    """Three recordings of a damper of 2 N s/m with dry friction of 4 N."""
    runs, time = [], 0.01 * np.arange(400)
    for seed in (1, 2, 3):
        speed = np.sin(2.0 * time + seed) + 0.6 * np.sin(5.3 * time)
        noise = 0.05 * np.random.default_rng(seed).normal(size=400)
        force = 2.0 * speed + 4.0 * np.tanh(speed / 0.05) + noise
        runs.append(recording(f"run {seed}", 0.01, {"speed [m/s]": speed}, {"force [N]": force}))
    return runs


def hysteretic() -> Model:
    """A mass on a spring, with no size given to anything but the states."""

    def equations(m: Scope) -> dict[str, Any]:
        force = m.port(
            "mass.force",
            m.u.drive - m.p.stiffness * m.x.position - m.p.damping * m.x.speed,
            unit="N",
            signals={"position": m.x.position, "speed": m.x.speed},
        )
        return {"position": m.x.speed, "speed": force / m.p.mass}

    return machine(
        equations,
        "position m scale=1e-3, speed m/s scale=0.3",
        "drive N scale=50",
        "position m scale=1e-3",
        "mass kg 2 0.5 8, damping N s/m 20 0 500, stiffness N/m 8e4 1e4 3e5",
    )


def loops() -> list[Recording]:
    """Three recordings of the oscillator of J.-P. Noel and M. Schoukens' Bouc-Wen benchmark.

    ``2 a + 10 v + 5e4 x + z = drive``, ``dz/dt = 5e4 v - 800 |v| z + 1100 v |z|``.
    """

    def rates(_: float, s: Sequence[float], drive: float) -> tuple[float, ...]:
        x, v, z = s
        acceleration = (drive - 10.0 * v - 5e4 * x - z) / 2.0
        return v, acceleration, 5e4 * v - 800.0 * abs(v) * z + 1100.0 * v * abs(z)

    step, runs = 1.0 / 750.0, []
    for seed in (1, 2, 3):
        rng = np.random.default_rng(seed)
        tones = np.arange(5.0, 100.0, 2.5)
        phases = rng.uniform(0.0, 2.0 * np.pi, len(tones))
        turns = np.outer(step * np.arange(900), tones)
        drive = np.cos(2.0 * np.pi * turns + phases).sum(axis=1)
        drive *= 50.0 / drive.std()
        seen = by_runge_kutta(rates, (0.0, 0.0, 0.0), drive.tolist(), step, 6)[:, 0]
        read = {"position [m]": seen + 8e-6 * rng.normal(size=len(seen))}
        runs.append(recording(f"run {seed}", step, {"drive [N]": drive}, read))
    return runs


def recorded(
    mass: float,
    force: Law,
    drive: Vector,
    step: float,
    noise: float,
    *,
    seed: int,
    unread: Vector | None = None,
) -> Recording:
    """Integrate ``mass a = drive + force(x, v)`` and read the position, as run ``seed``."""

    def rates(_: float, s: Vector, total: float) -> list[float]:
        return [s[1], (total + force(s[0], s[1])) / mass]

    total = drive if unread is None else drive + unread
    seen = held(rates, np.zeros(2), (total,), step)[:, 0]
    read = {"position [m]": seen + noise * np.random.default_rng(seed).normal(size=len(seen))}
    return recording(f"run {seed}", step, {"drive [N]": drive}, read)


DAY = 86400.0


def epidemic() -> Model:
    """Shares of a town that may fall ill and that are ill."""

    def equations(m: Scope) -> dict[str, Any]:
        new = m.p.contact * m.x.susceptible * m.x.infected
        return {"susceptible": -new, "infected": new - m.p.recovery * m.x.infected + m.u.arrivals}

    return machine(
        equations,
        "susceptible 1 0.99, infected 1 1e-3",
        "arrivals 1/s 0",
        "susceptible 1, infected 1",
        f"contact 1/s {0.3 / DAY} {0.03 / DAY} {3 / DAY}, "
        f"recovery 1/s {0.08 / DAY} {0.01 / DAY} {1 / DAY}",
    )


def fallen_ill(seed: int) -> Recording:
    """Return 200 days of a town that closes its schools after the fortieth."""
    rng = np.random.default_rng(seed)
    arrivals = np.where(rng.uniform(size=200) < 0.1, 5e-4, 0.0)
    contact = np.where(np.arange(200) >= 40, 0.126, 0.28)

    def rates(_: float, x: Vector, contact: float, u: float) -> list[float]:
        return [-contact * x[0] * x[1], contact * x[0] * x[1] - 0.1 * x[1] + u]

    x = held(rates, [0.99, 2e-3], (contact, arrivals), 1.0, rtol=1e-8, atol=1e-12)
    susceptible, infected = (x + [1e-3, 3e-4] * rng.normal(size=x.shape)).T
    read = {"susceptible [1]": susceptible, "infected [1]": infected}
    return recording(f"town {seed}", DAY, {"arrivals [1/s]": arrivals / DAY}, read)


def resonator() -> Model:
    """A resonator of 100 kHz and some hundred nanometres, of whose input nothing is declared."""

    def equations(m: Scope) -> dict[str, Any]:
        force = m.p.gain * m.u.drive - m.p.damping * m.x.speed - m.p.stiffness * m.x.position
        return {"position": m.x.speed, "speed": force / 1e-11}

    return machine(
        equations,
        "position m, speed m/s",
        "drive V",
        "position m display_unit=nm",
        "stiffness N/m 4 0.5 50, damping N s/m 5e-7 1e-8 1e-5, gain N/V 1e-7 1e-8 1e-6",
    )


def ringing(seed: int, *, hardening: float = 0.0) -> Recording:
    """Return a resonator of 4.6 N/m and 120 nN/V under random voltages, every half microsecond.

    Args:
        hardening: Cubic stiffness over the linear one, at 1 um, dimensionless.
    """
    volts = levels(1500, seed, 5.0, 5, 60)

    def rates(_: float, x: Vector, u: float) -> list[float]:
        # In um and us.
        force = 0.12 * u - 0.35 * x[1] - 4.6 * x[0] * (1.0 + hardening * x[0] ** 2)
        return [x[1], 0.1 * force]

    place = held(rates, np.zeros(2), (volts,), 0.5, rtol=1e-8, atol=1e-10)[:, 0]
    read = 1e-6 * (place + 1e-4 * np.random.default_rng(seed).normal(size=len(place)))
    return recording(f"ringing {seed}", 5e-7, {"drive [V]": volts}, {"position [m]": read})


def levels(count: int, seed: int, largest: float, shortest: int, longest: int) -> Vector:
    """Random levels, each held for a random number of samples."""
    rng = np.random.default_rng(seed)
    drive: list[float] = []
    while len(drive) < count:
        drive += [rng.uniform(-largest, largest)] * int(rng.integers(shortest, longest))
    return np.array(drive[:count])


def oscillations(force: Law, *, unread: bool = False) -> list[Recording]:
    """Three recordings of an oscillator of 1 kg."""
    runs = []
    for seed in (1, 2, 3):
        drive = levels(450, seed, 30.0, 20, 80)
        extra = levels(450, 50 + seed, 12.0, 5, 25) if unread else None
        runs.append(recorded(1.0, force, drive, 0.02, 1e-3, seed=seed, unread=extra))
    return runs


@lru_cache(maxsize=1)
def hardening(scale: float) -> Diagnosis:
    """An oscillator whose spring hardens by 40 N/m3, told with a guess of the port's scale."""
    runs = oscillations(lambda x, v: -30.0 * x - 0.6 * v - 40.0 * x**3)
    return diagnosed(oscillator(scale=scale), runs, fit=2)


@lru_cache(maxsize=1)
def rubbing() -> Diagnosis:
    """A carriage of 20 kg with dry friction of 15 N and an offset of the drive of 2 N."""
    law: Law = lambda x, v: -80.0 * v - 15.0 * np.tanh(v / 1e-3)  # noqa: E731
    runs = [
        recorded(20.0, law, levels(600, seed, 60.0, 15, 70), 0.01, 2e-5, seed=seed)
        for seed in (1, 2, 3)
    ]
    return diagnosed(carriage(), runs, fit=2)


def maglev() -> Model:
    """A steel ball under a coil, which falls or is caught without its controller."""

    def equations(m: Scope) -> dict[str, Any]:
        lift = m.p.lift * m.x.current**2 / m.x.gap**2
        return {
            "gap": m.x.speed,
            "speed": 9.81 - lift / m.p.mass,
            "current": (m.u.voltage - m.p.resistance * m.x.current) / m.p.inductance,
        }

    return machine(
        equations,
        "gap m 0.01, speed m/s, current A 0.7",
        "voltage V 0 24",
        "gap m, current A",
        "mass kg 0.05, lift N m2/A2 0.9e-4 1e-5 1e-3, resistance Ohm 9 1 100, "
        "inductance H 0.06 0.001 1",
        name="maglev",
    )


def levitation(
    seed: int, *, samples: int = 1000, drag: float = 0.0, saturated: float = np.inf
) -> Recording:
    """Return a ball of 50 g held by state feedback under a coil of 10 ohm and 50 mH, every 1 ms.

    Args:
        drag: Viscous drag on the ball, in N s/m.
        saturated: Current, in A, at which the iron has lost half of its force.
    """
    lift, mass, resistance, inductance, gap = 1e-4, 0.05, 10.0, 0.05, 0.01
    square = 9.81 * mass * gap**2 / lift
    rest = np.array([gap, 0.0, np.sqrt(square / (1.0 - square / saturated**2))])
    gain = np.array([-3000.0, -70.0, 15.0])
    rng = np.random.default_rng(seed)
    x, target, rows = rest, rest, []

    def rates(_: float, x: Vector, u: float) -> list[float]:
        force = lift * x[2] ** 2 / x[0] ** 2 / (1.0 + (x[2] / saturated) ** 2) + drag * x[1]
        return [x[1], 9.81 - force / mass, (u - resistance * x[2]) / inductance]

    for k in range(samples):
        if k % 100 == 0:
            target = rest * (1.0 + rng.uniform(-0.2, 0.2))
        dither = 0.3 * np.sign(np.sin(k / 7.0))
        u = float(np.clip(resistance * target[2] - gain @ (x - target) + dither, 0.0, 24.0))
        rows.append((u, x[0] + 1e-5 * rng.normal(), x[2] + 3e-3 * rng.normal()))
        x = solve_ivp(rates, (0.0, 1e-3), x, args=(u,), rtol=1e-7, atol=1e-9).y[:, -1]
    voltage, gaps, currents = np.array(rows).T
    read = {"gap [m]": gaps, "current [A]": currents}
    return recording(f"levitation {seed}", 1e-3, {"voltage [V]": voltage}, read)


def crane() -> Model:
    """A trolley with a load on a rope, written down without a port of its own."""

    def equations(m: Scope) -> dict[str, Any]:
        s, c = ca.sin(m.x.angle), ca.cos(m.x.angle)
        pull = m.u.force - m.p.damping * m.x.speed
        pulled = m.p.load * s * (m.p.rope * m.x.swing**2 + 9.81 * c)
        rate = (pull + pulled) / (m.p.trolley + m.p.load * s**2)
        return {
            "position": m.x.speed,
            "angle": m.x.swing,
            "speed": rate,
            "swing": (-rate * c - 9.81 * s) / m.p.rope - 0.1 * m.x.swing,
        }

    return machine(
        equations,
        "position m, angle rad, swing rad/s, speed m/s",
        "force N",
        "position m, angle rad",
        "trolley kg 9 1 50, load kg 5, rope m 1.1 0.3 3, damping N s/m 4 0 50",
    )


def transport(seed: int, *, friction: float = 0.0) -> Recording:
    """Return a trolley of 10 kg that carries 5 kg on a rope of 1 m about, every 10 ms.

    Args:
        friction: Dry friction of the trolley on its rail, in N.
    """
    rng = np.random.default_rng(seed)
    targets = np.repeat(rng.uniform(-1.0, 1.0, 10), 100)
    x, rows = np.zeros(4), []

    def rates(_: float, x: Vector, u: float) -> list[float]:
        s, c = np.sin(x[2]), np.cos(x[2])
        pull = u - 5.0 * x[1] - friction * np.tanh(x[1] / 0.005)
        rate = (pull + 5.0 * s * (x[3] ** 2 + 9.81 * c)) / (10.0 + 5.0 * s * s)
        return [x[1], rate, x[3], -rate * c - 9.81 * s - 0.1 * x[3]]

    for target in targets:
        u = 60.0 * (target - x[0]) - 50.0 * x[1] + 20.0 * rng.normal()
        rows.append((u, x[0] + 5e-4 * rng.normal(), x[2] + 1e-3 * rng.normal()))
        x = solve_ivp(rates, (0.0, 0.01), x, args=(u,), rtol=1e-7, atol=1e-9).y[:, -1]
    force, position, angle = np.array(rows).T
    read = {"position [m]": position, "angle [rad]": angle}
    return recording(f"transport {seed}", 0.01, {"force [N]": force}, read)


def swing() -> Model:
    """A pendulum that swings out: nothing drives it."""

    def equations(m: Scope) -> dict[str, Any]:
        rate = -m.p.stiffness * ca.sin(m.x.angle) - m.p.damping * m.x.speed
        return {"angle": m.x.speed, "speed": rate}

    return machine(
        equations,
        "angle rad 0.5, speed rad/s",
        "",
        "angle rad",
        "stiffness 1/s2 20 1 100, damping 1/s 0.1 0 5",
    )


def swinging_out(start: float) -> Recording:
    """Return a pendulum's decay from an angle, in rad, with dry friction of 0.3 rad/s2."""

    def rates(_: float, x: Vector) -> list[float]:
        return [x[1], -24.0 * np.sin(x[0]) - 0.05 * x[1] - 0.3 * np.tanh(x[1] / 0.005)]

    time = 0.02 * np.arange(500)
    run = solve_ivp(rates, (0.0, time[-1]), [start, 0.0], t_eval=time, rtol=1e-8, atol=1e-10)
    noise = np.random.default_rng(1).normal(0.0, 1e-3, len(time))
    return recording(f"from {start:g}", 0.02, {}, {"angle [rad]": run.y[0] + noise})


def drivetrain(gear: float = 1.0) -> Model:
    """A motor, a gear, an elastic shaft and a load, written down without a port of its own."""

    def equations(m: Scope) -> dict[str, Any]:
        twist = m.x.motor / m.p.gear - m.x.load
        slip = m.x.motor_speed / m.p.gear - m.x.load_speed
        shaft = m.p.stiffness * twist + m.p.damping * slip
        return {
            "motor": m.x.motor_speed,
            "load": m.x.load_speed,
            "motor_speed": (m.u.torque - shaft / m.p.gear - m.p.drag * m.x.motor_speed) / m.p.rotor,
            "load_speed": shaft / m.p.inertia,
        }

    return machine(
        equations,
        "motor rad, load rad, motor_speed rad/s, load_speed rad/s",
        "torque N m -5 5",
        "motor rad, load rad",
        "rotor kg m2 0.01 1e-3 0.1, inertia kg m2 0.03 1e-3 0.3, "
        "stiffness N m/rad 40 4 1e3, damping N m s/rad 0.05 0 1, "
        f"drag N m s/rad 0.02 0 0.5, gear 1 {gear}",
    )


def turned(
    seed: int, *, gear: float = 1.0, play: float = 0.0, relaxing: float = 0.0, samples: int = 1000
) -> Recording:
    """Return a drivetrain of 50 N m/rad under random torques, every 5 ms.

    Args:
        gear: Turns of the motor per turn of the load.
        play: Half of the backlash of its coupling, in rad.
        relaxing: Further stiffness of its coupling, in N m/rad, which is let go within 0.1 s.
    """
    torque = levels(samples, seed, 2.0, 20, 100)

    def rates(_: float, x: Vector, u: float) -> list[float]:
        twist = x[0] / gear - x[1]
        engaged = np.sign(twist) * max(abs(twist) - play, 0.0)
        shaft = 50.0 * engaged + (0.08 * (x[2] / gear - x[3]) if engaged else 0.0)
        let_go = twist - x[4]
        shaft += relaxing * let_go
        return [x[2], x[3], (u - shaft / gear - 0.03 * x[2]) / 0.012, shaft / 0.025, let_go / 0.1]

    noise = 2e-4 * np.random.default_rng(seed).normal(size=(samples, 2))
    motor, load = (held(rates, np.zeros(5), (torque,), 5e-3)[:, :2] + noise).T
    read = {"motor [rad]": motor, "load [rad]": load}
    return recording(f"turned {seed}", 5e-3, {"torque [N m]": torque}, read)


def stage() -> Model:
    """A spring-guided stage on a voice coil, of which nobody declares sizes or ports."""

    def equations(m: Scope) -> dict[str, Any]:
        force = m.p.force * m.u.current - m.p.damping * m.x.speed - m.p.stiffness * m.x.position
        return {"position": m.x.speed, "speed": force / m.p.mass}

    return machine(
        equations,
        "position m scale=1e-3, speed m/s scale=0.1",
        "current A -3 3",
        "position m",
        "mass kg 0.4, damping N s/m 4 0.2 60, stiffness N/m 1500 200 2e4, force N/A 7 1 40",
    )


def guided(
    seed: int, *, most: float = np.inf, cubic: float = 0.0, dry: float = 0.0, lag: float = 0.0
) -> Recording:
    """Two and a half seconds of a stage: 8 N/A, 3 N s/m, 1800 N/m.

    Args:
        most: Current that the amplifier gives at the most, in A.
        cubic: Cubic stiffness, in N/m3.
        dry: Dry friction, in N.
        lag: Time constant of the sensor, in s.
    """
    rng = np.random.default_rng(seed)
    step, count = 5e-4, 5000
    time = step * np.arange(count)
    tones = [np.sin(2 * np.pi * f * time + rng.uniform(0.0, 6.28)) for f in np.linspace(1, 40, 12)]
    current = 0.55 * np.sum(tones, axis=0)

    def rates(_: float, s: Sequence[float], u: float) -> tuple[float, float, float]:
        x, v, memory = s
        force = 8.0 * u - 3.0 * v - 1800.0 * x - cubic * x**3 - dry * math.tanh(v / 5e-4)
        return v, force / 0.4, (x - memory) / lag if lag else 0.0

    # Friction that turns over within 0.2 ms asks for steps that are shorter than that.
    given = np.clip(current, -most, most).tolist()
    x, _, memory = by_runge_kutta(rates, (0.0, 0.0, 0.0), given, step, 40).T
    read = {"position [m]": (memory if lag else x) + 2e-6 * rng.normal(size=count)}
    return recording(f"stage {seed}", step, {"current [A]": current}, read)


def car() -> Model:
    """The lateral motion of a car; its speed is measured, its steering commanded."""

    def equations(m: Scope) -> Equations:
        slip, rate, speed = m.x.slip, m.x.yaw_rate, m.u.speed
        front = m.p.front * (m.u.steering - slip - 1.2 * rate / speed)
        rear = m.p.rear * (1.5 * rate / speed - slip)
        return (
            {
                "slip": (front + rear) / (1500.0 * speed) - rate,
                "yaw_rate": (1.2 * front - 1.5 * rear) / m.p.inertia,
            },
            {"yaw_rate": rate, "lateral": (front + rear) / 1500.0},
        )

    return machine(
        equations,
        "slip rad, yaw_rate rad/s",
        "steering rad -0.3 0.3, speed m/s 5 50 20 commanded=0",
        "yaw_rate rad/s, lateral m/s2",
        "inertia kg m2 2500 500 1e4, front N/rad 7e4 1e4 3e5, rear N/rad 8e4 1e4 3e5",
    )


@lru_cache
def cornering(seed: int) -> Recording:
    """Drive a car whose tyres saturate, stiffness times 70 mrad the most, by SciPy."""
    rng, dt, n = np.random.default_rng(seed), 0.01, 2400
    steps = np.repeat(rng.uniform(-0.06, 0.06, n // 80), 80)
    steering = np.convolve(steps, np.ones(20) / 20.0, "same")
    speed = 22.0 + 8.0 * np.sin(2.0 * np.pi * np.arange(n) * dt / 23.0 + seed)

    def forces(x: Vector, u: float | Vector, v: float | Vector) -> tuple[Vector, Vector]:
        ahead, behind = u - x[0] - 1.2 * x[1] / v, 1.5 * x[1] / v - x[0]
        return 5320.0 * np.tanh(ahead / 0.07), 6370.0 * np.tanh(behind / 0.07)

    def rates(_: float, x: Vector, u: float, v: float) -> list[float]:
        f, r = forces(x, u, v)
        return [(f + r) / (1500.0 * v) - x[1], (1.2 * f - 1.5 * r) / 2800.0]

    x = held(rates, np.zeros(2), (steering, speed), dt, rtol=1e-8, atol=1e-10).T
    noise = rng.normal(size=(n, 2)) * [0.002, 0.05]
    read = {
        "yaw_rate [rad/s]": x[1] + noise[:, 0],
        "lateral [m/s2]": sum(forces(x, steering, speed)) / 1500.0 + noise[:, 1],
    }
    commands = {"steering [rad]": steering, "speed [m/s]": speed}
    return recording(f"corners {seed}", dt, commands, read)


def pipeline() -> Model:
    """A pump, a pipe, a vessel and a drain, as a newcomer writes them."""

    def equations(m: Scope) -> dict[str, Any]:
        lost = m.p.resistance * m.x.flow
        return {
            "flow": (m.u.pump - m.x.pressure - lost) / m.p.inertance,
            "pressure": (m.x.flow - m.x.pressure * m.p.drain) / m.p.compliance,
        }

    return machine(
        equations,
        "flow m3/s, pressure Pa",
        "pump Pa 0 1e6",
        "pressure Pa, flow m3/s",
        "resistance Pa s/m3 4e6 1e5 5e7, inertance Pa s2/m3 4e6 4e5 4e7, "
        "compliance m3/Pa 4e-7 4e-8 4e-6, drain m3/(s Pa) 1e-7 1e-8 1e-6",
    )


def pumped(seed: int, *, turbulent: float = 0.0, burst: float = np.inf) -> Recording:
    """Eighty seconds of a line: 5e6 Pa s/m3, 3.2e6 Pa s2/m3, 5e-7 m3/Pa, 1.4e-7 m3/(s Pa).

    Args:
        turbulent: Pressure lost over the squared flow, in Pa s2/m6.
        burst: Time from which the vessel loses 5 l/s, in s.
    """

    def rates(t: float, s: Vector, given: float) -> list[float]:
        lost = 5e6 * s[0] + turbulent * s[0] * abs(s[0])
        spilt = 1.4e-7 * s[1] + (5e-3 if t > burst else 0.0)
        return [(given - s[1] - lost) / 3.2e6, (s[0] - spilt) / 5e-7]

    pump = 3e5 + levels(400, seed, 1.5e5, 15, 60)
    seen = held(rates, [0.02, 2e5], (pump,), 0.2)
    seen += np.random.default_rng(seed).normal(0.0, [2e-5, 200.0], seen.shape)
    read = {"pressure [Pa]": seen[:, 1], "flow [m3/s]": seen[:, 0]}
    return recording(f"line {seed}", 0.2, {"pump [Pa]": pump}, read)
