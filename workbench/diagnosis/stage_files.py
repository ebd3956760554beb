"""The stages of a diagnosis as files: written whole when reached, read again by a later call.

One JSON file per stage. Arrays stand in it compressed; a model is the effects that were attached to
the nominal model (or taken away) and the parameter values, and is built again from the plant. Each
file carries a key of everything that it depends on: the code, the plant, the recordings, the
priors, the options of the stages up to it. A file with another key is left aside.
"""

from __future__ import annotations

import base64
import dataclasses
import hashlib
import json
import time
import zlib
from collections.abc import Callable, Mapping, Sequence
from importlib import import_module
from pathlib import Path
from typing import Any, TypedDict, TypeVar

import numpy as np

from workbench.computing.counted import Work, add, done, since
from workbench.diagnosis.estimation.priors import Prior
from workbench.diagnosis.experiment.menu import Experiment
from workbench.diagnosis.nonparametric.result import EFFECT_NAME
from workbench.files import digest_of_code, write_whole
from workbench.model import Effect, Model
from workbench.physics.library import Hypothesis
from workbench.recordings.recording import Recording

Stage = TypeVar("Stage")

FORMAT = "workbench.stage/2"

FOLDER = "stages"
"""Folder of the stages within that of the results."""


def fingerprint(
    model: Model, recordings: Sequence[Recording], priors: Sequence[Prior], *, split: int
) -> str:
    """Return what tells one diagnosis from another: plant, recordings, priors.

    Args:
        recordings: Recordings to fit on, then those to judge on.
    """
    equations = model.exact.function("key", model.exact.rates, model.exact.outputs)
    digest = hashlib.sha256(equations.serialize().encode())
    digest.update(digest_of_code())
    quantities = (model.states, model.inputs, model.outputs, model.parameters, model.ports)
    digest.update(repr((FORMAT, model.name, quantities, tuple(priors), split)).encode())
    for recording in recordings:
        digest.update(repr((recording.name, recording.names)).encode())
        digest.update(recording.matrix(list(recording.names)).tobytes())
        digest.update(recording.time.tobytes())
    return digest.hexdigest()


class _Spent(TypedDict):
    seconds: float
    work: Work


class StageFiles:
    """The files of one diagnosis, with the key, time and work that grow from stage to stage."""

    def __init__(self, folder: Path | None, model: Model, entries: Sequence[Hypothesis]) -> None:
        self._folder = None if folder is None else folder / FOLDER
        self._model = model
        self._entries = {entry.name: entry for entry in entries}
        self._effects: dict[str, Effect] = {e.name: e.effect for e in entries}
        self._built: dict[str, Model] = {}
        self._key, self._began, self._before = "", time.perf_counter(), 0.0
        self._done = done()

    @property
    def spent(self) -> _Spent:
        """Time, in s, and work of this call and of the stages that earlier ones reached."""
        seconds = self._before + time.perf_counter() - self._began
        return {"seconds": seconds, "work": since(self._done)}

    def add(self, what: str) -> None:
        """Let the stages from here on depend on something else."""
        self._key = hashlib.sha256(f"{self._key} {what}".encode()).hexdigest()

    def reached(self, kind: type[Stage], do: Callable[[], Stage]) -> Stage:
        """Return a stage: read if it is there, else done and written."""
        stage = self.read(kind)
        if stage is None:
            stage = do()
            self.write(stage)
        return stage

    def write(self, stage: Any) -> None:
        """Write a stage that was reached."""
        if self._folder is None:
            return
        name = type(stage).__name__
        term = getattr(stage, "nonparametric", None)
        data = {
            "format": FORMAT,
            "stage": name,
            "key": self._key,
            **self.spent,
            "law": self._plain(term.law) if term is not None else None,
            "data": self._plain(stage),
        }
        write_whole(self._path(name), json.dumps(data, indent=1, ensure_ascii=False) + "\n")

    def read(self, kind: type[Stage]) -> Stage | None:
        """Return a stage that an earlier call wrote with the same key."""
        if self._folder is None:
            return None
        try:
            data = json.loads(self._path(kind.__name__).read_text(encoding="utf-8"))
            if data["format"] != FORMAT or data["key"] != self._key:
                return None
            if data["law"] is not None:
                self._effects[EFFECT_NAME] = self._whole(data["law"]).effect
            work = {str(unit): int(amount) for unit, amount in data["work"].items()}
            stage: Stage = self._whole(data["data"])
            seconds = float(data["seconds"])
        # A file that cannot be used, whatever it leads to, is as good as none.
        except Exception:  # noqa: BLE001
            return None
        now = self.spent
        self._before += max(seconds - now["seconds"], 0.0)
        add({unit: max(n - now["work"].get(unit, 0), 0) for unit, n in work.items()})
        return stage

    def _path(self, name: str) -> Path:
        assert self._folder is not None
        return self._folder / f"{name.lower()}.json"

    def _plain(self, value: Any) -> Any:
        if isinstance(value, Model):
            return {"#": "Model"} | self._plain_model(value)
        if isinstance(value, Hypothesis):
            return {"#": "Hypothesis", "name": value.name, "effect": _quantities(value.effect)} | {
                f.name: self._plain(getattr(value, f.name))
                for f in dataclasses.fields(value)
                if f.name != "effect"
            }
        if isinstance(value, np.ndarray):
            packed = base64.b64encode(zlib.compress(np.ascontiguousarray(value).tobytes(), 1))
            return {
                "#": "array",
                "dtype": value.dtype.str,
                "shape": list(value.shape),
                "packed": packed.decode("ascii"),
            }
        if isinstance(value, Experiment):
            # What a model would read in it is not read again.
            value = dataclasses.replace(value, planned=None)
        if dataclasses.is_dataclass(value) and not isinstance(value, type):
            fields = {
                f.name: self._plain(getattr(value, f.name)) for f in dataclasses.fields(value)
            }
            return {"#": _class_name(value)} | fields
        if isinstance(value, tuple) and hasattr(value, "_fields"):
            fields = {name: self._plain(getattr(value, name)) for name in value._fields}
            return {"#": _class_name(value)} | fields
        if isinstance(value, Mapping):
            return {str(k): self._plain(v) for k, v in value.items()}
        if isinstance(value, (list, tuple)):
            return [self._plain(v) for v in value]
        return value.item() if isinstance(value, np.generic) else value

    def _plain_model(self, model: Model) -> dict[str, Any]:
        own = [e.name for e in self._model.effects]
        now = [e.name for e in model.effects]
        return {
            "without": [name for name in own if name not in now],
            "effects": {e.name: _quantities(e) for e in model.effects if e.name not in own},
            "values": model.values.tolist(),
        }

    def _whole(self, value: Any) -> Any:
        if isinstance(value, list):
            return tuple(self._whole(v) for v in value)
        if not isinstance(value, dict):
            return value
        kind = value.get("#")
        if kind is None:
            return {k: self._whole(v) for k, v in value.items()}
        if kind == "array":
            raw = zlib.decompress(base64.b64decode(value["packed"]))
            return np.frombuffer(raw, dtype=value["dtype"]).reshape(value["shape"]).copy()
        if kind == "Model":
            return self._whole_model(value)
        fields = {k: self._whole(v) for k, v in value.items() if k != "#"}
        if kind == "Hypothesis":
            entry = self._entries[fields.pop("name")]
            effect = _with_quantities(entry.effect, fields.pop("effect"))
            return dataclasses.replace(entry, effect=effect, **fields)
        return _class_of(kind)(**fields)

    def _whole_model(self, data: Mapping[str, Any]) -> Model:
        # Writing the equations down takes time; models that differ by values share them.
        key = json.dumps([data["without"], data["effects"]])
        if key not in self._built:
            effects = [
                _with_quantities(self._effects[name], self._whole(rows))
                for name, rows in data["effects"].items()
            ]
            model = self._model.without(*data["without"]) if data["without"] else self._model
            self._built[key] = model.with_effect(*effects) if effects else model
        model = self._built[key]
        names = [q.name for q in model.parameters]
        return model.with_parameters(dict(zip(names, data["values"], strict=True)))


def _class_name(value: Any) -> str:
    return f"{type(value).__module__}:{type(value).__name__}"


def _class_of(name: str) -> Any:
    """Return the class of a frozen part of a stage: one of the workbench, whatever a file says."""
    module, _, own = name.partition(":")
    found = getattr(import_module(module), own) if module.startswith("workbench.") else None
    if not (dataclasses.is_dataclass(found) or hasattr(found, "_fields")):
        raise KeyError(name)
    return found


def _quantities(effect: Effect) -> dict[str, list[float]]:
    return {q.name: [q.value, q.lower, q.upper] for q in effect.parameters}


def _with_quantities(effect: Effect, rows: Mapping[str, Sequence[float]]) -> Effect:
    return dataclasses.replace(
        effect,
        parameters=tuple(
            dataclasses.replace(
                q, value=rows[q.name][0], lower=rows[q.name][1], upper=rows[q.name][2]
            )
            for q in effect.parameters
        ),
    )
