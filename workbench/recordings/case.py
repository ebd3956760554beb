"""A case: recordings of one machine, some to fit on and some held out, and what is known of it.

A case is a folder with ``case.toml``::

    plant = "my_plants:rig"        # a name, or module:object of a module in this folder
    title = "rig with spring"

    [options]                      # of the plant; numbers in the option's unit, or with unit
    mass = "3 kg"

    [[recordings]]                 # or files identify_*.csv and validate_*.csv in the folder
    files = ["a.csv", "b.csv"]
    use = "fit"                    # or "hold_out"
    mapping = "mapping.toml"       # or a table
    resample_Hz = 50
    derivatives = {speed = {of = "position", samples = 11, order = 2}}

    [refit]
    starts = 4
    noise = {position = "0.1 mm"}

Options of the plant may stand outside a table under the keyword of the plant's function, as
``load_kg = 3`` does in the arm's cases.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from workbench.checked_json import (
    Shape,
    TableShape,
    anything,
    flag,
    listed,
    named,
    number,
    one_of,
    read_toml,
    scalar,
    size,
    text,
    whole,
    within,
)
from workbench.data_folder import shipped_cases, shipped_data, shipped_folder
from workbench.display import Rows, Shown, aligned_table
from workbench.errors import WorkbenchError, check_choice, check_range
from workbench.model import Model
from workbench.model.units import of_difference, quantity, to_si
from workbench.plants import DEFAULT_PLANT
from workbench.plants.plant import Plant
from workbench.plants.registry import PLANTS
from workbench.recordings.formats.format import known_suffixes, suffix_of
from workbench.recordings.public_data import public_file
from workbench.recordings.read import MappingLike, mapping_beside, read_recording
from workbench.recordings.recording import Recording, Scalar, Signal
from workbench.recordings.resampling import resample

ROLES = ("identify_open", "identify_closed", "validate_open", "validate_closed")
USES = ("fit", "hold_out", "in_loop")


def _text_or(shape: Shape) -> Shape:
    """Return a shape that accepts text too."""
    return lambda value, place: value if isinstance(value, str) else shape(value, place)


_DERIVATIVE = TableShape(
    {"of": text}, {"samples": within(3, 1e4, whole), "order": within(1, 1e4, whole)}, others=False
)
_RECORDING = TableShape(
    {"files": _text_or(listed(text))},
    {
        "use": one_of(*USES),
        **dict.fromkeys(("name", "plant"), text),
        "mapping": _text_or(named(anything)),
        "rows": listed(whole, length=2),
        "resample_Hz": number,
        "derivatives": named(_DERIVATIVE),
        "constants": named(scalar),
        "centred": listed(text),
    },
    others=False,
)
_REFIT = TableShape(
    {},
    {
        "stages": listed(within(1e-9, 1e9)),
        "starts": within(1, 100, whole),
        "start_samples": within(0, 1e6, whole),
        "noise": named(size),
        "noise_is_model_error": flag,
    },
    others=False,
)
_ABOUT = ("title", "plant", "data", "published_from")
"""Texts that are no setting of the machine."""

_CHANGES = ("effects", "without", "parameters")
_CASE = TableShape(
    {},
    {
        **dict.fromkeys(_ABOUT, text),
        **dict.fromkeys((*_CHANGES, "notes"), listed(text)),
        "options": named(scalar),
        "recordings": listed(_RECORDING),
        "refit": _REFIT,
        "published": named(number),
        "sample_rate_Hz": within(0.1, 1e6),
    },
)
"""Shape of ``case.toml``; options of the plant may stand at its top too."""


@dataclass(frozen=True)
class RefitSettings:
    """How parameters are estimated from recordings.

    Args:
        stages: Process-noise scales, pass by pass, dimensionless; the most likely if none.
        start_samples: Samples over which hidden states at the start of a free run are estimated; 0
            to take the start from the first measurements.
        noise: Standard deviation of outputs by name, in SI, in place of the sensors' data.
        noise_is_model_error: Whether that noise stands for what the equations are expected to
            leave, so that no floor can be reached.
    """

    stages: tuple[float, ...] = ()
    starts: int = 1
    start_samples: int = 0
    noise: Mapping[str, float] = field(default_factory=dict)
    noise_is_model_error: bool = False


@dataclass(frozen=True, eq=False, repr=False)
class Case(Shown):
    """Recordings of one machine with its plant and settings.

    Args:
        uses: What each recording is for: ``"fit"``, ``"hold_out"``, or ``"in_loop"``, held out on
            a plant of its own.
        options: Options of the plant that the case says, parsed.
        changes: Effects, effects left out and parameters, as keywords of `Plant.model`.
        loops: Plants of recordings that have one of their own, by recording.
        published: Values that others identified, by parameter, in SI.
    """

    name: str
    settings: Mapping[str, Scalar]
    recordings: Mapping[str, Recording]
    uses: Mapping[str, str]
    plant: Plant
    options: Mapping[str, Any]
    notes: tuple[str, ...] = ()
    title: str = ""
    changes: Mapping[str, Any] = field(default_factory=dict)
    loops: Mapping[str, Plant] = field(default_factory=dict)
    refit: RefitSettings = field(default_factory=RefitSettings)
    published: Mapping[str, float] = field(default_factory=dict)
    published_from: str = ""
    remarks: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        if not self.fit:
            raise WorkbenchError(
                f"case {self.name} has no recording to fit on; it needs a file identify_*.csv, or"
                ' one of [[recordings]] with use = "fit"'
            )

    def model(self) -> Model:
        """Build the plant as the case describes it."""
        self.check_options(self.options)
        return self.plant.model(self.options, **self.changes)

    def check_options(self, given: Mapping[str, Any]) -> None:
        """Check that every option is given that differs from rig to rig."""
        for option in self.plant.options:
            if option.measured and option.name not in given:
                raise WorkbenchError(
                    f"case.toml of case {self.name} does not give {option.keyword}; add it"
                )

    def used(self, use: str) -> dict[str, Recording]:
        """Return the recordings of one use, by name."""
        return {name: r for name, r in self.recordings.items() if self.uses[name] == use}

    @property
    def fit(self) -> dict[str, Recording]:
        """Recordings to fit on, by name."""
        return self.used("fit")

    @property
    def hold_out(self) -> dict[str, Recording]:
        """Recordings to judge on, by name."""
        return self.used("hold_out")

    def tables(self) -> tuple[Rows, ...]:
        """Return the recordings and what each is for."""
        uses = {name: use.replace("_", " ") for name, use in self.uses.items()}
        rows = [
            (name, uses[name], str(len(r)), f"{r.duration:.6g}", ", ".join(r.names))
            for name, r in self.recordings.items()
        ]
        return (Rows("recordings", ("recording", "use", "samples", "seconds", "signals"), rows),)

    def __str__(self) -> str:
        settings = ", ".join(f"{k} = {v}" for k, v in self.settings.items())
        (table,) = self.tables()
        shown = aligned_table(table.headings, table.rows)
        notes = (f"note: {note}" for note in self.notes)
        return "\n".join([f"case {self.name}: {settings}", shown, *notes])


def machine_cases() -> tuple[str, ...]:
    """Return the names of the shipped descriptions of public recordings of real machines."""
    return tuple(sorted(p.parent.name for p in shipped_folder().glob("machines/*/case.toml")))


def case_folder(name: str | Path) -> Path:
    """Return the folder of a case: a folder's path, a shipped case, or a machine."""
    if Path(name).is_dir():
        return Path(name)
    if str(name) in shipped_cases():
        return shipped_data(str(name))
    if str(name) in machine_cases():
        return shipped_folder() / "machines" / str(name)
    raise WorkbenchError(
        f"{str(name)!r} is neither a folder with a case nor one of"
        f" {', '.join((*shipped_cases(), *machine_cases()))}; single recordings are given with"
        " --fit and --hold-out"
    )


def _files(folder: Path) -> dict[str, Path]:
    """Return the recordings of a folder that are called after their role, by role."""
    found: dict[str, Path] = {}
    for path in sorted(folder.iterdir()):
        role = path.name.split(".", 1)[0]
        known = path.is_file() and suffix_of(path) in known_suffixes()
        if known and role.startswith(("identify", "validate")):
            if role in found:
                raise WorkbenchError(
                    f"case {folder.name} has {found[role].name} and {path.name}; keep one of them"
                )
            found[role] = path
    return {role: found[role] for role in (*ROLES, *sorted(found)) if role in found}


def _gauge(recording: Recording) -> Recording:
    """Say that the pressures of a case are gauge pressures, as the format has it."""
    for signal in recording.signals:
        if signal.kind == "pressure":
            recording = recording.with_signal(replace(signal, kind="gauge pressure"))
    return recording


def read_case(folder: str | Path, *, mapping: MappingLike = None, data: Path | None = None) -> Case:
    """Read a case folder: ``case.toml`` and its recordings.

    Recordings are those of ``[[recordings]]``, or the files that are called after their role
    (``identify_open.csv``, ``validate_closed.csv.gz``, ...). Pressures are gauge pressures. A file
    ``mapping.toml`` in the folder is used if no mapping is given.

    Args:
        data: Folder with public recordings, for a machine; None reads ``WORKBENCH_DATA``.

    Example:
        >>> case = read_case("practice-07")
        >>> case.options["load"], list(case.fit)
        (3.0, ['identify_open', 'identify_closed'])
    """
    path = case_folder(folder)
    if not (path / "case.toml").is_file():
        raise WorkbenchError(
            f'{path} has no case.toml; write one with plant = "NAME" and [options], or for the arm'
            " with load_kg, plane, supply_bar, sample_rate_Hz"
        )
    settings = read_toml(path / "case.toml", "case", _CASE)
    plain = {k: v for k, v in settings.items() if isinstance(v, (str, int, float, bool))}
    flat = {k: v for k, v in plain.items() if k not in _ABOUT}
    plant = PLANTS.get(settings.get("plant", DEFAULT_PLANT), folder=path)
    options = _options(path.name, plant, flat, settings.get("options", {}))
    own = path / "mapping.toml"
    if mapping is None and own.is_file():
        mapping = own
    recordings, uses, loops, notes = {}, {}, {}, []
    for file, entry in _entries(path, settings, data):
        given = entry.get("mapping", mapping_beside(file) or mapping)
        if isinstance(given, str):
            given = path / given
        name = entry.get("name", entry["file_name"])
        full = name if "recordings" in settings else f"{path.name}/{name}"
        recording = read_recording(file, mapping=given, name=full)
        if "name" in entry:
            name = _filled(name, recording)
            recording = replace(recording, name=name)
        recording = _prepared(_gauge(recording), entry, f"recording {name} of case {path.name}")
        if name in recordings:
            raise WorkbenchError(
                f"case {path.name} has two recordings {name!r}; give one of them another name"
            )
        recordings[name] = replace(recording, metadata={**recording.metadata, **flat})
        uses[name] = entry["use"]
        if "plant" in entry:
            loops[name] = PLANTS.get(entry["plant"], folder=path)
    if "recordings" not in settings and not recordings.keys().isdisjoint(ROLES):
        notes = [f"{r} is missing" for r in ROLES if r not in recordings]
    if "hold_out" not in uses.values():
        notes.append("nothing is held out, so no claim can be proved")
    changes: dict[str, Any] = {k: tuple(settings[k]) for k in _CHANGES if k in settings}
    return Case(
        path.name,
        flat,
        recordings,
        uses,
        plant,
        options,
        tuple(notes),
        settings.get("title", ""),
        {**changes, "folder": path},
        loops,
        _refit_settings(plant, settings.get("refit", {})),
        settings.get("published", {}),
        settings.get("published_from", ""),
        tuple(settings.get("notes", ())),
    )


def _options(
    case: str, plant: Plant, flat: Mapping[str, Any], table: Mapping[str, Any]
) -> dict[str, Any]:
    given = {o.keyword: flat[o.keyword] for o in plant.options if o.keyword in flat}
    found = {}
    for name, value in {**given, **table}.items():
        option = plant.option(name)
        found[option.name] = replace(option, label=f"{name} of case {case}").parse(value)
    return found


def _entries(
    folder: Path, settings: Mapping[str, Any], data: Path | None
) -> Iterator[tuple[Path, dict[str, Any]]]:
    """Yield file and settings of every recording."""
    if "recordings" not in settings:
        for role, path in _files(folder).items():
            use = "fit" if role.startswith("identify") else "hold_out"
            yield path, {"file_name": role, "use": use}
        return
    public = "data" in settings
    for entry in settings["recordings"]:
        for file in [entry["files"]] if isinstance(entry["files"], str) else entry["files"]:
            yield (
                public_file(f"{settings['data']}/{file}", data=data) if public else folder / file,
                {"use": "fit", **entry, "file_name": Path(file).name.split(".", 1)[0]},
            )


def _filled(name: str, recording: Recording) -> str:
    """Fill words of the recording's metadata into a name such as ``"{trajectory} {kp}"``."""
    try:
        return name.format_map(recording.metadata)
    except (KeyError, ValueError, IndexError):
        raise WorkbenchError(
            f"name {name!r} asks for what {recording.name} does not say; it says:"
            f" {', '.join(recording.metadata) or 'nothing'}"
        ) from None


def _prepared(recording: Recording, entry: Mapping[str, Any], what: str) -> Recording:
    """Do what a case asks for with a recording: resample, differentiate, add, centre."""
    if "rows" in entry:
        recording = recording.take(slice(*entry["rows"]))
    if "resample_Hz" in entry:
        recording = resample(recording, rate_Hz=entry["resample_Hz"])
    for name, rule in entry.get("derivatives", {}).items():
        recording = recording.with_signal(_derivative(recording, name, **rule))
    for name, value in entry.get("constants", {}).items():
        if isinstance(value, str) and value not in recording.metadata:
            raise WorkbenchError(
                f"{what} takes {name} from {value!r}, which it does not say; it says:"
                f" {', '.join(recording.metadata) or 'nothing'}"
            )
        number = float(recording.metadata[value] if isinstance(value, str) else value)
        held = np.full(len(recording), number)
        recording = recording.with_signal(Signal(name, held, "1", role="command"))
    for name in entry.get("centred", ()):
        # A command that was compared at an instant is taken in the middle of each sample: held
        # while the machine moves on, it would lag by half a sample.
        signal = recording.signal(name)
        middle = signal.values + 0.5 * np.diff(signal.values, append=signal.values[-1])
        recording = recording.with_signal(replace(signal, values=middle))
    return recording


def _derivative(
    recording: Recording, name: str, of: str, samples: int = 11, order: int = 2
) -> Signal:
    """Differentiate a signal by polynomials over a few samples (Savitzky and Golay 1964)."""
    from scipy.signal import savgol_filter

    source = recording.signal(of)
    check_range(f"order of the derivative {name}", order, 1, samples - 1)
    step = float(np.median(np.diff(recording.time)))
    rate = savgol_filter(source.values, samples | 1, order, deriv=1, delta=step)
    return Signal(name, np.asarray(rate), f"{source.unit}/s", role="command")


def _refit_settings(plant: Plant, table: Mapping[str, Any]) -> RefitSettings:
    noise = noise_of(plant.model(), table["noise"]) if table.get("noise") else {}
    given = {"start_samples": plant.start_samples, **table, "noise": noise}
    return RefitSettings(**given | {"stages": tuple(table.get("stages", ()))})


def noise_of(model: Model, given: Mapping[str, Any]) -> dict[str, float]:
    """Return the noise of outputs, in SI, given as numbers in their display unit or with units."""
    outputs = {q.name: q for q in model.outputs}
    found = {}
    for name, value in given.items():
        check_choice("output with noise", name, outputs)
        unit = of_difference(outputs[name].display_unit)
        given_size = quantity(f"noise of {name}", value, unit, difference=True)
        size = check_range(f"noise of {name}", given_size, 1e-300, 1e300, unit)
        found[name] = to_si(size, unit)
    return found
