"""The linear model: matrices with names, the point they belong to, and a verdict on them."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
import numpy.typing as npt

from workbench.arrays import Complex, Vector
from workbench.display import Drawn, Rows
from workbench.errors import TIMES_S, check_choice, check_range
from workbench.linearisation.exact_delays import channels_of
from workbench.linearisation.modes import Mode, find_modes
from workbench.linearisation.zero_order_hold import zero_order_hold
from workbench.model.linear_system import UNSEEN, Parts, in_series, late_by, reached
from workbench.model.sizes import poles_of
from workbench.model.units import from_si, in_time
from workbench.operating_point import OperatingPoint

OVER = 20.0
"""Rate of what follows an input within a sample, times the sample time: 2e-9 of it is left over."""

Inverse = Callable[[npt.ArrayLike], Vector]
"""Turns an input of the linear model into the input of the plant, in SI."""


_STAYS = 1e-9
"""Growth of what counts as staying, over the fastest rate."""

_RESPONSE = frozenset(
    (
        "frdata", "omega", "ninputs", "noutputs", "input_labels", "output_labels", "sysname",
        "title", "plot_phase", "plot_magnitude", "return_magphase", "squeeze", "isdtime",
        "magnitude", "phase",
    )
)  # fmt: skip
"""What python-control's plots read from a frequency response."""


@dataclass(frozen=True, repr=False, eq=False)
class LinearModel(Drawn):
    """A linear model around an operating point.

    ``dx/dt = drift + A (x - x0) + B (u - u0)``, ``y = y0 + C (x - x0) + D (u - u0)``.

    ``control.bode_plot`` takes it as it is; everything else of python-control takes its ``system``.

    Args:
        A: State matrix, shape (n_states, n_states), in SI.
        B: Input matrix, shape (n_states, n_inputs), in SI.
        C: Output matrix, shape (n_outputs, n_states), in SI.
        D: Feedthrough, shape (n_outputs, n_inputs), in SI.
        operating_point: Where the plant stands; its input is always the plant's own.
        input_names: Names of the inputs; ``opening`` where the valve's curve is inverted.
        x0: States at the point, shape (n_states,), in SI.
        u0: Inputs at the point, shape (n_inputs,), in SI, in the inputs of this model.
        y0: Outputs at the point, shape (n_outputs,), in SI.
        drift: Rates of the states at the point, shape (n_states,), in SI per second; zero at a
            true equilibrium.
        ends: Ends of the inputs that move with states, as of an inner loop that is clipped, shape
            (2, n_inputs, 1 + n_states): lower and upper, at the point as deviations from ``u0``,
            infinite for none, and their slopes by states, in SI; none by default. An input whose
            curve bends to its end has one where a straight line would do as much.
        inverse: For an input that is not the plant's own: turns it into the plant's, in SI;
            a controller that thinks in the model's input sends its command through it.
        verdict: How far the model may be trusted (`workbench.linearisation.validity.Validity`), or
            None.

    Example:
        >>> from workbench.linearisation import linearise
        >>> from workbench.operating_point import operating_point
        >>> from workbench.plants.servo_axis import servo_axis
        >>> model = linearise(operating_point(servo_axis(), {"position": 0.0}))
        >>> model.state_names, model.B.ravel().round(4).tolist()
        (('position', 'speed'), [0.0, 0.0105])
    """

    A: Vector
    B: Vector
    C: Vector
    D: Vector
    operating_point: OperatingPoint
    state_names: tuple[str, ...]
    input_names: tuple[str, ...]
    output_names: tuple[str, ...]
    x0: Vector
    u0: Vector
    y0: Vector
    drift: Vector
    ends: Vector | None = None
    inverse: Inverse | None = None
    verdict: Any = None

    @cached_property
    def system(self) -> Any:
        """The same as a ``control.StateSpace`` with the signal names, which a design takes too."""
        import control as ct

        found = ct.ss(
            self.A,
            self.B,
            self.C,
            self.D,
            states=list(self.state_names),
            inputs=list(self.input_names),
            outputs=list(self.output_names),
            name=self.operating_point.model.name,
        )
        # Its operating point goes with it (`workbench.linearisation.state_space.linear_model`).
        found.linear_model = self
        return found

    def __getattr__(self, name: str) -> Any:
        """Return what python-control's Bode plots read from a frequency response."""
        if name not in _RESPONSE:
            raise AttributeError(f"{type(self).__name__!r} has no attribute {name!r}")
        return getattr(self._response, name)

    @cached_property
    def _response(self) -> Any:
        import control as ct

        return ct.frequency_response(self.system)

    @property
    def poles(self) -> Complex:
        """Poles, shape (n_states,), in rad/s."""
        return poles_of(self.A)

    @property
    def state_scales(self) -> Vector:
        """Typical sizes of the states, shape (n_states,), in SI."""
        model = self.operating_point.model
        scales = {q.name: q.scale for q in (*model.inputs, *model.states)}
        return np.array([scales[name] for name in self.state_names])

    @cached_property
    def modes(self) -> tuple[Mode, ...]:
        """Modes from slow to fast, each with its frequency, damping and main states."""
        return find_modes(self.A, self.state_names)

    def mode_of(self, state: str) -> Mode:
        """Return the oscillation in which a state takes the largest part; if none, the mode."""
        check_choice("state", state, self.state_names)
        swinging = [m for m in self.modes if m.damping < 1.0] or list(self.modes)
        return max(swinging, key=lambda mode: mode.share(state))

    def to_plant(self, u: npt.ArrayLike) -> Vector:
        """Turn inputs of this model into inputs of the plant, of the same shape, in SI.

        Args:
            u: Inputs of this model, any shape, in SI.
        """
        return self.inverse(u) if self.inverse else np.asarray(u, dtype=float)

    def select(
        self, *, inputs: Sequence[str] | None = None, outputs: Sequence[str] | None = None
    ) -> LinearModel:
        """Return a model with fewer inputs or outputs, in the order given, all by default.

        Inputs that are left out stay at the operating point.
        """
        i = _indices("input", inputs, self.input_names)
        o = _indices("output", outputs, self.output_names)
        return replace(
            self,
            B=self.B[:, i],
            C=self.C[o],
            D=self.D[np.ix_(o, i)],
            input_names=tuple(self.input_names[k] for k in i),
            output_names=tuple(self.output_names[k] for k in o),
            u0=self.u0[i],
            y0=self.y0[o],
            ends=None if self.ends is None else self.ends[:, i],
            inverse=self.inverse if len(i) == len(self.input_names) else None,
            verdict=None,
        )

    def without_unseen(self) -> LinearModel:
        """Return the model without what no output depends on, now or later.

        Such as the way that a ship has covered, where its heading is controlled. Of states that
        show by their differences alone, such as the angles of two bodies on one shaft whose speed
        is measured, one is left out, and those left count from it.
        """
        size = self.state_scales
        _, hidden = reached((self.A * size / size[:, None]).T, (self.C * size).T)
        if not hidden.shape[1]:
            return self
        left = _pivots(hidden)
        kept = np.delete(np.arange(len(size)), left)
        # x_kept - W x_left, where W = V_kept V_left^-1 and V spans what does not show.
        W = _combined(hidden[kept], hidden[left]) * size[kept, None] / size[left]
        change = np.zeros((len(kept), len(size)))
        change[:, kept], change[:, left] = np.eye(len(kept)), -W
        back: Vector = np.eye(len(size))[:, kept]
        return self._with_states(kept, change @ self.A @ back, change @ self.B, back)

    def without_unreached(self) -> LinearModel:
        """Return the model without what no input moves, now or later, and that does not grow.

        Such as a tank that another pump fills, the difference of two equal tanks that one fills, or
        what two tanks hold together that a pump empties into one another.
        """
        size = self.state_scales
        A = self.A * size / size[:, None]
        moved, rest = reached(A, self.B / size[:, None])
        if not rest.shape[1]:
            return self
        rates = np.linalg.eigvals(rest.T @ A @ rest)
        if np.any(rates.real > _STAYS * np.max(np.abs(np.linalg.eigvals(A)))):
            return self
        kept = np.sort(_pivots(moved))
        back = _combined(moved, moved[kept]) * size[:, None] / size[kept]
        return self._with_states(kept, self.A[kept] @ back, self.B[kept], back)

    def read_after_holding(self, sample_time: float) -> LinearModel:
        """Return the model whose outputs answer each input as it was held before they are read.

        A loop that is sampled reads what the last command did, not what the next one will. The
        inputs that were held are states.

        Args:
            sample_time: Time between readings, in s.
        """
        (at,) = np.nonzero(np.any(self.D, axis=0))
        if not len(at):
            return self
        (n, m), rate = self.B.shape, OVER / sample_time
        one, none = np.eye(m)[at], np.zeros((len(at), n))
        A = np.block([[self.A, none.T], [none, -rate * np.eye(len(at))]])
        B, C = np.vstack([self.B, rate * one]), np.hstack([self.C, self.D[:, at]])
        return self._with_followers((A, B, C, np.zeros_like(self.D)), at.tolist())

    def late(self, delay: float) -> LinearModel:
        """Return the model whose inputs act late, by Pade functions whose states come last.

        Args:
            delay: Time by which they are late, in s.
        """
        k = len(self.input_names)
        found = in_series((self.A, self.B, self.C, self.D), late_by((delay,) * k))
        return self._with_followers(found, np.repeat(range(k), 3).tolist())

    def _with_followers(self, system: Parts, inputs: list[int]) -> LinearModel:
        """Return the model as a system that has further states, the last: each follows an input."""
        A, B, C, D = system
        names = (*self.state_names, *(self.input_names[k] for k in inputs))
        rest, drift = np.append(self.x0, self.u0[inputs]), np.pad(self.drift, (0, len(inputs)))
        ends = self.ends
        if ends is not None:
            ends = np.pad(ends, ((0, 0), (0, 0), (0, len(inputs))))
        found = replace(self, A=A, B=B, C=C, D=D, ends=ends)
        return replace(found, state_names=names, x0=rest, drift=drift)

    def at_once(self) -> LinearModel:
        """Return the model without the delays of its commands, where they are known."""
        own = channels_of(self)
        if own is None:
            return self
        A, B, C, D = own.at_once(len(self.input_names))
        return replace(self._of_states(np.array(own.kept, dtype=int)), A=A, B=B, C=C, D=D)

    def _with_states(
        self, k: npt.NDArray[np.int_], A: Vector, B: Vector, back: Vector
    ) -> LinearModel:
        ends = self.ends
        if ends is not None:
            ends = np.concatenate([ends[..., :1], ends[..., 1:] @ back], axis=-1)
        return replace(self._of_states(k), A=A, B=B, C=self.C @ back, ends=ends)

    def _of_states(self, k: npt.NDArray[np.int_]) -> LinearModel:
        """Return the model with the names and the rest of some states, in their order."""
        names = tuple(self.state_names[i] for i in k)
        return replace(self, state_names=names, x0=self.x0[k], drift=self.drift[k])

    def discretise(self, sample_time: float) -> tuple[Vector, Vector, Vector, Vector]:
        """Return the matrices for inputs that are held over a sample, in s."""
        h = check_range("sample time", sample_time, *TIMES_S, "s")
        return *zero_order_hold(self.A, self.B, h), self.C.copy(), self.D.copy()

    def response(self, u: npt.ArrayLike, sample_time: float) -> Vector:
        """Simulate outputs from the operating point, without drift, shape (n, n_outputs), in SI.

        Args:
            u: Inputs held over each sample, shape (n, n_inputs), or (n,) for one input, in SI.
            sample_time: Time between samples, in s.
        """
        Ad, Bd, C, D = self.discretise(sample_time)
        table = np.asarray(u, dtype=float)
        held = table.reshape(len(table), -1) - self.u0
        x = np.zeros(len(Ad))
        y = np.empty((len(held), len(C)))
        for k, v in enumerate(held):
            y[k] = self.y0 + C @ x + D @ v
            x = Ad @ x + Bd @ v
        return y

    def tables(self) -> tuple[Rows, ...]:
        """Return the modes, and the verdict as far as it needs no simulation."""
        modes = [(*m.figures, ", ".join(m.main_states)) for m in self.modes]
        heads = ("frequency in Hz", "damping", "time constant in s", "main states")
        words = self.verdict.summary() if self.verdict is not None else ["none was asked for"]
        return (
            Rows(f"modes from {', '.join(self.input_names)} on", heads, modes),
            Rows("verdict", ("how far it holds",), [(line,) for line in words]),
        )

    def __str__(self) -> str:
        point = self.operating_point
        shown = {q.name: q.display_unit for q in point.model.outputs if q.display_unit != "1"}
        held = ", ".join(
            f"{name} {float(from_si(value, shown[name])):z.4g} {shown[name]}"
            if name in shown
            else f"{name} {value:z.4g}"
            for name, value in zip(self.output_names, self.y0, strict=True)
        )
        lines = [
            f"linear model of {point.model.name} at {held}",
            f"  {', '.join(self.input_names)} -> {', '.join(self.output_names)}",
        ]
        if np.any(self.drift):
            lines.append(f"  at a point that drifts: {point.drift_in_words()}")
        lines += [f"  {line}" for line in self._told_modes()]
        if self.verdict is not None:
            lines += [f"  {line}" for line in self.verdict.summary()]
        return "\n".join(lines)

    def _told_modes(self) -> list[str]:
        """Return a line for each mode, those of Pade functions apart, and for what is late."""
        own = channels_of(self)
        if own is None:
            return [str(mode) for mode in self.modes]
        modes = find_modes(own.A, tuple(self.state_names[k] for k in own.kept))
        # What each command does to each output after each of its delays, in states' scales.
        size = self.state_scales[list(own.kept)]
        a, b, c = own.A * size / size[:, None], own.B / size[:, None], own.C * size
        rate, moved = np.abs(a).max(initial=0.0) or 1.0, np.abs(own.D)
        for _ in a:
            moved, b = np.maximum(moved, np.abs(c @ b)), a @ b / rate
        moves = moved > UNSEEN * moved.max(axis=0)
        said = []
        for j, command in enumerate(self.input_names):
            each = {
                output: tuple(
                    in_time(time)
                    for time, k, acts in sorted(zip(own.delays, own.commands, row, strict=True))
                    if k == j and acts and time
                )
                for output, row in zip(self.output_names, moves, strict=True)
                if any(k == j and acts for k, acts in zip(own.commands, row, strict=True))
            }
            alike = len(set(each.values())) == 1
            late = {out: f"{' and '.join(times)} late" for out, times in each.items() if times}
            words = [text if alike else f"{text} on {out}" for out, text in late.items()]
            if words:
                said.append(f"{command} acts {', '.join(dict.fromkeys(words))}")
        return [*map(str, modes), *said]


def _indices(kind: str, wanted: Sequence[str] | None, names: tuple[str, ...]) -> list[int]:
    if wanted is None:
        return list(range(len(names)))
    if isinstance(wanted, str):
        wanted = (wanted,)
    for name in wanted:
        check_choice(kind, name, names)
    return [names.index(name) for name in wanted]


def _combined(rows: Vector, basis: Vector) -> Vector:
    """Return what rows take of each row of a basis; what rounding makes of nothing is nothing."""
    found = np.linalg.solve(basis.T, rows.T).T
    return np.where(np.abs(found) > UNSEEN, found, 0.0)


def _pivots(columns: Vector) -> npt.NDArray[np.int_]:
    """Return as many rows as columns that tell them best apart."""
    from scipy.linalg import qr

    order = qr(columns.T, mode="r", pivoting=True)[1]
    return np.asarray(order[: columns.shape[1]])
