"""The structure of a model: which equation holds which unknown, and where it says something twice.

Equations that hold more knowledge than unknowns can be checked against each other. The
decomposition of Dulmage and Mendelsohn finds them from the structure alone, without numbers.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import casadi as ca
import numpy as np
import numpy.typing as npt

from workbench.errors import check_choice
from workbench.model import Effect, Model, PortView
from workbench.model.regularisation import Expression

Matrix = npt.NDArray[np.bool_]

_PROBE = "structure_probe"


@dataclass(frozen=True)
class Structure:
    """Equations by unknowns.

    A state and its rate count as one unknown, joined by the passing of time. Every port is an
    unknown with an equation of its own, which does not hold when something is missing there.

    Args:
        holds: Which equation holds which unknown, shape (n_equations, n_unknowns).
        suspects: Rows that may be wrong, by name of the port.
    """

    holds: Matrix
    unknowns: tuple[str, ...]
    suspects: Mapping[str, int] = field(default_factory=dict)

    def checkable(self, without: Sequence[int] = ()) -> Matrix:
        """Return which equations can be checked against others.

        Args:
            without: Rows of equations that are not to be used.

        Returns:
            Flags of the rows in the part with more equations than unknowns, shape
            (n_equations,); false for those that are not used.

        Source:
            Dulmage and Mendelsohn (1958); Krysander and Frisk, "Sensor placement for fault
            diagnosis" (2008).
        """
        from scipy.sparse import csr_array
        from scipy.sparse.csgraph import maximum_bipartite_matching

        rows = np.setdiff1d(np.arange(len(self.holds)), without).astype(int)
        part = self.holds[rows]
        # For each unknown the row that determines it.
        if part.size:
            owner = maximum_bipartite_matching(csr_array(part.astype(np.int8)), perm_type="row")
        else:
            owner = np.full(len(self.unknowns), -1)
        reached = np.ones(len(rows), dtype=bool)
        reached[owner[owner >= 0]] = False
        waiting = list(np.flatnonzero(reached))
        while waiting:
            for column in np.flatnonzero(part[waiting.pop()]):
                row = owner[column]
                if row >= 0 and not reached[row]:
                    reached[row] = True
                    waiting.append(row)
        result = np.zeros(len(self.holds), dtype=bool)
        result[rows[reached]] = True
        return result

    def groups(self) -> tuple[tuple[tuple[str, ...], ...], tuple[str, ...]]:
        """Return the suspects that cannot be told apart, and those that cannot be seen.

        One suspect is told from another if its equation can still be checked when the other's is
        not used.

        Returns:
            Groups of names of ports, and the names of those in no equation that can be checked.
        """
        seen = self.checkable()
        left = [name for name, row in self.suspects.items() if seen[row]]
        unseen = tuple(name for name in self.suspects if name not in left)
        groups = []
        while left:
            still = self.checkable([self.suspects[left[0]]])
            group = tuple(name for name in left if not still[self.suspects[name]])
            groups.append(group)
            left = [name for name in left if name not in group]
        return tuple(groups), unseen

    def with_measurement(self, holds: Sequence[str]) -> Structure:
        """Return the structure with another sensor, which reads what holds some unknowns."""
        row = np.isin(self.unknowns, list(holds))
        return replace(self, holds=np.vstack([self.holds, row]))


@dataclass(frozen=True)
class Cut:
    """A model whose ports are cut: what follows a port holds a symbol, not what made it.

    Args:
        states: Symbols of the states, shape (n_states, 1), in SI.
        inputs: Symbols of the inputs, shape (n_inputs, 1), in SI.
        parameters: Symbols of the parameters, shape (n_parameters, 1), in SI.
        symbols: What leaves each port, shape (n_ports, 1), in the ports' SI units.
        entering: What enters each port, shape (n_ports, 1), in the same units.
        rates: Rates of the states, shape (n_states, 1), in SI per second.
        outputs: Measurements, shape (n_outputs, 1), in SI.
        signals: What else could be read, by name: what enters a port under its name with
            `` before``, published signals, measurements that are not recorded; in SI.
    """

    model: Model
    states: ca.SX
    inputs: ca.SX
    parameters: ca.SX
    symbols: ca.SX
    entering: ca.SX
    rates: ca.SX
    outputs: ca.SX
    signals: Mapping[str, ca.SX]

    @property
    def unknowns(self) -> ca.SX:
        """States, then what leaves the ports, shape (n_states + n_ports, 1), in SI."""
        return ca.vertcat(self.states, self.symbols)


def cut(model: Model) -> Cut:
    """Cut a model at its ports."""
    entering: dict[str, ca.SX] = {}
    symbols: dict[str, ca.SX] = {}

    def transform(at: PortView) -> Expression:
        entering[at.port] = ca.SX(at.value)
        symbols[at.port] = ca.SX.sym(at.port)
        return symbols[at.port]

    ports = tuple(port.name for port in model.ports)
    # The last effect on every port replaces its signal.
    whole = model.with_effect(Effect(_PROBE, ports, transform)).exact if ports else model.exact
    # What the trace adds to every port for its derivatives is zero.
    zero = ca.SX.zeros(whole.perturbation.numel())
    made, left = (
        ca.substitute(ca.vertcat(ca.SX(0, 1), *(of[p] for p in ports)), whole.perturbation, zero)
        for of in (entering, symbols)
    )
    signals = {f"{p} before": made[i] for i, p in enumerate(ports)}
    signals |= {n: whole.signals[i] for i, n in enumerate(whole.signal_names)}
    taken = {q.name for q in model.states}
    signals |= {
        q.name: whole.outputs[i] for i, q in enumerate(model.outputs) if q.name not in taken
    }
    return Cut(model, whole.x, whole.u, whole.p, left, made, whole.rates, whole.outputs, signals)


def structure_of(
    parts: Cut, outputs: Sequence[str]
) -> tuple[Structure, dict[str, tuple[str, ...]]]:
    """Write down which equation of a model holds which unknown.

    Returns:
        The structure, with a suspect per port; and what else could be read: the unknowns in it, by
        name of the state or signal.

    Raises:
        WorkbenchError: If there is no such output.
    """
    model = parts.model
    names = [q.name for q in model.outputs]
    for output in outputs:
        check_choice("output", output, names)
    states = tuple(q.name for q in model.states)
    ports = tuple(port.name for port in model.ports)
    n_x, n_p = len(states), len(ports)
    # A port and a state may bear the same name.
    unknowns = (
        *(f"state {s}" for s in states),
        *(f"before {p}" for p in ports),
        *(f"after {p}" for p in ports),
    )

    def holds(expression: ca.SX) -> Matrix:
        pattern = np.zeros((expression.numel(), len(unknowns)), dtype=bool)
        rows, columns = ca.jacobian_sparsity(expression, parts.unknowns).get_triplet()
        columns = np.asarray(columns, dtype=int)
        pattern[rows, np.where(columns < n_x, columns, columns + n_p)] = True
        return pattern

    rates, made = holds(parts.rates), holds(parts.entering)
    rates[:, :n_x] |= _seen_through(model, rates, made)
    pass_on = np.zeros((n_p, len(unknowns)), dtype=bool)
    pass_on[:, n_x : n_x + n_p] = pass_on[:, n_x + n_p :] = np.eye(n_p, dtype=bool)
    matrix = np.vstack(
        [
            rates | np.eye(n_x, len(unknowns), dtype=bool),
            made | np.eye(n_p, len(unknowns), n_x, dtype=bool),
            pass_on,
            holds(parts.outputs)[[names.index(output) for output in outputs]],
        ]
    )
    readable: dict[str, tuple[str, ...]] = {}
    readable |= {s: (f"state {s}",) for s in states if s not in parts.signals}
    readable |= {f"{p} before": (f"before {p}",) for p in ports}
    readable |= {p: (f"after {p}",) for p in ports}
    for name, expression in parts.signals.items():
        row = holds(expression)[0]
        if name not in readable and name not in outputs and row.any():
            readable[name] = tuple(u for u, held in zip(unknowns, row, strict=True) if held)
    return Structure(matrix, unknowns, {p: n_x + n_p + i for i, p in enumerate(ports)}), readable


def _seen_through(model: Model, rates: Matrix, made: Matrix) -> Matrix:
    """Return states that rates hold although cutting the ports hides them.

    Equations that take the derivative of what left a port, such as the rate of a volume, lose it
    when the port is cut.
    """
    n_x, n_p = len(rates), len(made)
    by_port, by_state = made[:, n_x + n_p :].astype(int), made[:, :n_x].astype(int)
    reach = rates[:, n_x + n_p :]
    for _ in range(n_p):
        reach = reach | (reach.astype(int) @ by_port > 0)
    full = np.zeros((n_x, n_x), dtype=bool)
    rows, columns = ca.jacobian_sparsity(model.exact.rates, model.exact.x).get_triplet()
    full[rows, columns] = True
    return np.asarray(full & ~rates[:, :n_x] & ~(reach.astype(int) @ by_state > 0))
