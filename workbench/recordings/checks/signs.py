"""Do the responses point the way they must?"""

from __future__ import annotations

import math
from collections.abc import Mapping
from itertools import combinations

import numpy as np

from workbench.arrays import Vector
from workbench.recordings.checks.check import Finding, check
from workbench.recordings.checks.delay import response_correlation
from workbench.recordings.checks.expected import Expected
from workbench.recordings.checks.innovations import MEMORY
from workbench.recordings.recording import Recording
from workbench.recordings.resampling import low_pass

_SURE = 6.0
_FAR = 6.0
"""Times a slope of the model; models at one point are wrong by less, units by more."""

Pairs = list[tuple[str, str]]
Signs = Mapping[tuple[str, str], int]
Sizes = Mapping[tuple[str, str], float]


def accelerations(
    recording: Recording, causes: list[str], motion: str
) -> dict[str, tuple[float, float]]:
    """Return how strongly each pressure or force accelerates a motion, and how surely.

    Least squares of the acceleration on the causes, the commands, the position and the speed, all
    low-passed at 8 Hz; the standard errors allow for the correlation that the filter leaves. A
    command that moves a cause as well as the motion would otherwise turn the sign.

    Returns:
        Acceleration over cause, in SI, and the same over its standard error, in sigmas, by cause.
    """
    dt = recording.sample_time
    edge = min(8.0, 0.1 / dt)
    position = low_pass(recording[motion], edge * dt)
    speed = np.gradient(position, dt)
    acceleration = np.gradient(speed, dt)
    known = [*dict.fromkeys((*causes, *recording.moving(recording.commands)))]
    columns = [low_pass(recording[c], edge * dt) for c in known] + [position, speed]
    every = max(1, round(0.5 / (edge * dt)))
    inner = slice(5 * every, -5 * every, every)
    if len(position[inner]) < 3 * len(columns):
        return dict.fromkeys(causes, (0.0, 0.0))
    spread = [np.std(c[inner]) or 1.0 for c in columns]
    X = np.column_stack(
        [(c[inner] - c[inner].mean()) / size for c, size in zip(columns, spread, strict=True)]
    )
    y = acceleration[inner] - acceleration[inner].mean()
    beta, *_ = np.linalg.lstsq(X, y, rcond=1e-8)
    rest = y - X @ beta
    covariance = np.linalg.pinv(X.T @ X) * float(rest @ rest) / (len(y) - X.shape[1])
    errors = np.sqrt(np.maximum(np.diag(covariance), 1e-300))
    return {
        c: (float(beta[i] / spread[i]), float(beta[i] / errors[i])) for i, c in enumerate(causes)
    }


def _strengths(
    recording: Recording, expected: Expected
) -> tuple[dict[tuple[str, str], float], dict[tuple[str, str], float], dict[tuple[str, str], str]]:
    """Return how surely each cause acts, in sigmas, and how strongly it accelerates, in SI.

    Listed last are pairs of which the sign cannot be told, with the reason: what is new in a very
    smooth measurement swings, and its strongest swing does not tell where the measurement goes.
    """
    slopes: dict[tuple[str, str], float] = {}
    found: dict[tuple[str, str], float] = {}
    untold: dict[tuple[str, str], str] = {}
    motions: dict[str, list[str]] = {}
    moving = recording.moving(recording.commands)
    for cause, response in expected.signs:
        present = cause in recording and response in recording
        if not present or len(recording.moving((cause, response))) < 2:
            continue
        if recording.signal(cause).role == "command":
            every = response_correlation(recording, cause, response, max_delay=0.03)
            beside = tuple(c for c in moving if c != cause)
            if beside and _strongest(every) * expected.signs[cause, response] < -_SURE:
                # The answer may be to what moves together with it.
                every = response_correlation(
                    recording, cause, response, max_delay=0.03, beside=beside
                )
            found[cause, response] = _strongest(every)
            if every.min() < -_SURE and every.max() > _SURE:
                untold[cause, response] = "it swings both ways"
        else:
            motions.setdefault(response, []).append(cause)
    for motion, causes in motions.items():
        for cause, (slope, strength) in accelerations(recording, causes, motion).items():
            found[cause, motion], slopes[cause, motion] = strength, slope
    for pair, strength in found.items():
        if expected.unstable and strength * expected.signs[pair] < -_SURE:
            # What pushes the machine off is there before the command that works against it, and
            # goes with that command ever after.
            untold.setdefault(pair, "a loop holds the machine, and the command answers to it")
    return found, slopes, untold


def _strongest(every: Vector) -> float:
    """Return the strongest correlation at a lag, in sigmas; at lag zero a controller may answer."""
    early = every[1:]
    return float(early[np.argmax(np.abs(early))])


def _of_another_size(right: Pairs, slopes: Sizes, known: Sizes) -> list[str]:
    """Return what accelerates a motion far more or less than the model says."""
    said = []
    for cause, motion in right:
        ratio = slopes.get((cause, motion), math.nan) / known.get((cause, motion), math.nan)
        if ratio > _FAR or ratio < 1 / _FAR:
            times = f"{max(ratio, 1 / ratio):.2g} times"
            more = f"{times} as much as" if ratio > 1 else f"{times} less than"
            look = "look at the units and gains of both"
            said.append(f"{cause} accelerates {motion} {more} the model says: {look}")
    return said


@check("signs", 130, fix="correct the sign or the order of the columns in a mapping (--mapping)")
def check_signs(recording: Recording, expected: Expected) -> Finding:
    """Check that causes act in the expected direction, and accelerate as the model says."""
    if not expected.signs or len(recording) < 10 * MEMORY:
        why = "no model says which way a response goes" if not expected.signs else "too short"
        return Finding("not checked", why)
    found, slopes, untold = _strengths(recording, expected)
    told = {k: s * expected.signs[k] for k, s in found.items() if k not in untold}
    wrong = [k for k, s in told.items() if s < -_SURE]
    # Exchanged columns accelerate as much as the model says. Where the motion is so slow that
    # pressures and friction balance, a regression of the acceleration tells nothing.
    faint = [k for k in wrong if abs(slopes.get(k, math.inf)) < expected.slopes.get(k, 0.0) / _FAR]
    wrong = [k for k in wrong if k not in faint]
    right = [k for k, s in told.items() if s > _SURE]
    exchanged = _exchanged(wrong, expected.signs) if not right and len(wrong) > 2 else ""
    turned = [] if exchanged else _turned(wrong, right)
    strength = {f"{c}->{r}": s for (c, r), s in found.items()}
    # What else a command goes with may answer for it; a regression takes that out.
    unsure = turned if all(pair not in slopes for pair in wrong) else []
    values = {"strength": strength, "turned": unsure}
    if exchanged or turned:
        listed = ", ".join(f"{c} -> {r}" for c, r in wrong)
        mistake = f"{' or '.join(turned)} is probably reversed (sign = -1 in the mapping)"
        mistake = f"{exchanged} are probably exchanged" if exchanged else mistake
        return Finding("unfit", f"the response has the wrong sign: {listed}; {mistake}", values)
    open_ = [f"the sign of {c} -> {r} cannot be told: {why}" for (c, r), why in untold.items()]
    doubts = [f"the sign of {c} -> {r} cannot be told: it hardly acts" for c, r in faint]
    doubts += [
        f"{c} -> {r} has the wrong sign, which no reversed or exchanged column explains"
        for c, r in wrong
    ]
    doubts += _of_another_size(right, slopes, expected.slopes)
    if not right:
        note = "; ".join([*open_, *doubts]) or "too little motion to tell"
        return Finding("not checked", note, values, doubt=bool(doubts))
    seen = ", ".join(f"{c} -> {r}" for c, r in right)
    note = "; ".join([f"as expected: {seen}", *open_, *doubts])
    return Finding("pass", note, values, doubt=bool(doubts))


def _exchanged(wrong: Pairs, signs: Signs) -> str:
    """Return two names whose exchange turns every sign round that is wrong, ``""`` if none."""
    names = sorted({n for pair in wrong for n in pair})
    for a, b in combinations(names, 2):
        swap = {a: b, b: a}
        if all(signs.get((swap.get(c, c), swap.get(r, r))) == -signs[c, r] for c, r in wrong):
            return f"{a} and {b}"
    return ""


def _turned(wrong: Pairs, right: Pairs) -> list[str]:
    """Return columns of which one, if reversed, explains wrong signs and turns no right one."""
    sound = {n for pair in right for n in pair}
    if any(sound.issuperset(pair) for pair in wrong):
        return []
    return sorted({n for pair in wrong for n in pair} - sound)
