"""A case: a folder of recordings of one machine, some to fit on and some held out."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from workbench.errors import WorkbenchError, check_choice, check_range
from workbench.recordings.aligned_table import aligned_table
from workbench.recordings.formats.format import known_suffixes, suffix_of
from workbench.recordings.read import MappingLike, mapping_beside, read_recording, read_settings
from workbench.recordings.recording import Recording, Scalar

ROLES = ("identify_open", "identify_closed", "validate_open", "validate_closed")
_RANGES = {
    "load_kg": (0.0, 8.0, "kg"),
    "supply_bar": (0.5, 12.0, "bar"),
    "sample_rate_Hz": (0.1, 1e6, "Hz"),
}


@dataclass(frozen=True, eq=False)
class Case:
    """Recordings of one machine with its settings.

    Args:
        name: Name of the case.
        settings: Content of ``case.toml``: ``load_kg``, ``plane``, ``supply_bar``,
            ``sample_rate_Hz`` and whatever else the machine needs.
        recordings: Recordings by role; those whose role begins with ``identify`` are fitted on,
            those that begin with ``validate`` are held out.
        notes: What is missing.

    Raises:
        WorkbenchError: If there is nothing to fit on.
    """

    name: str
    settings: Mapping[str, Scalar]
    recordings: Mapping[str, Recording]
    notes: tuple[str, ...] = field(default=())

    def __post_init__(self) -> None:
        """Check the settings and that something can be fitted."""
        for key, (low, high, unit) in _RANGES.items():
            if key in self.settings:
                check_range(f"{key} of case {self.name}", self.settings[key], low, high, unit)  # type: ignore[arg-type]
        if "plane" in self.settings:
            check_choice(
                f"plane of case {self.name}",
                str(self.settings["plane"]),
                ("horizontal", "vertical"),
            )
        if not self.fit:
            raise WorkbenchError(
                f"case {self.name} has no recording to fit on; it needs a file identify_*.csv"
            )

    def _setting(self, key: str) -> Scalar:
        if key not in self.settings:
            raise WorkbenchError(f"case.toml of case {self.name} does not give {key}; add it")
        return self.settings[key]

    @property
    def load_kg(self) -> float:
        """Added load, in kg."""
        return float(self._setting("load_kg"))

    @property
    def plane(self) -> str:
        """``horizontal`` or ``vertical``."""
        return str(self._setting("plane"))

    @property
    def supply_bar(self) -> float:
        """Supply pressure, gauge, in bar."""
        return float(self._setting("supply_bar"))

    @property
    def sample_rate_Hz(self) -> float:
        """Sample rate, in Hz."""
        return float(self._setting("sample_rate_Hz"))

    @property
    def fit(self) -> dict[str, Recording]:
        """Recordings to fit on, by role."""
        return {k: r for k, r in self.recordings.items() if k.startswith("identify")}

    @property
    def hold_out(self) -> dict[str, Recording]:
        """Recordings to judge on, by role."""
        return {k: r for k, r in self.recordings.items() if k.startswith("validate")}

    def __str__(self) -> str:
        settings = ", ".join(f"{k} = {v}" for k, v in self.settings.items())
        rows = [
            (
                role,
                "fit" if role in self.fit else "hold out",
                str(len(r)),
                f"{r.duration:.6g}",
                ", ".join(r.names),
            )
            for role, r in self.recordings.items()
        ]
        table = aligned_table(("recording", "use", "samples", "seconds", "signals"), rows)
        return "\n".join(
            [f"case {self.name}: {settings}", table, *(f"note: {note}" for note in self.notes)]
        )


def _files(folder: Path) -> dict[str, Path]:
    found: dict[str, Path] = {}
    for path in sorted(folder.iterdir()):
        role = path.name.split(".", 1)[0]
        if not path.is_file() or suffix_of(path) not in known_suffixes():
            continue
        if role.startswith(("identify", "validate")):
            if role in found:
                raise WorkbenchError(
                    f"case {folder.name} has {found[role].name} and {path.name}; keep one of them"
                )
            found[role] = path
    return {role: found[role] for role in sorted(found, key=_order)}


def _order(role: str) -> tuple[int, str]:
    return (ROLES.index(role) if role in ROLES else len(ROLES), role)


def _gauge(recording: Recording) -> Recording:
    """Say that the pressures of an arm case are gauge pressures, as its format has it."""
    for signal in recording.signals:
        if signal.kind == "pressure":
            recording = recording.with_signal(replace(signal, kind="gauge pressure"))
    return recording


def read_case(
    folder: str | Path,
    *,
    mapping: MappingLike = None,
    signals: Any = None,
    max_rows: int = 2_000_000,
) -> Case:
    """Read a case folder: ``case.toml`` and one file per recording.

    The files are called after their role (``identify_open.csv``, ``validate_closed.csv.gz``, ...).
    Pressures are gauge pressures. A file ``mapping.toml`` in the folder is used if no mapping is
    given; ``identify_open.mapping.toml`` beside a file stands before both.

    Args:
        folder: The folder.
        mapping: Mapping of every file, see `read_recording`.
        signals: Signals wanted of every file, see `read_recording`.
        max_rows: Largest number of rows kept of a file.

    Returns:
        The case; the settings also stand in the metadata of each recording.

    Raises:
        WorkbenchError: If the folder, its settings or a file cannot be read.

    Example:
        >>> from workbench.data_folder import shipped_data
        >>> case = read_case(shipped_data("practice-07"))
        >>> case.load_kg, list(case.fit)
        (3.0, ['identify_open', 'identify_closed'])
    """
    path = Path(folder)
    if not path.is_dir():
        raise WorkbenchError(f"there is no case folder {path}")
    if not (path / "case.toml").is_file():
        raise WorkbenchError(
            f"{path} has no case.toml; write one with load_kg, plane, supply_bar, sample_rate_Hz"
        )
    settings = read_settings(path / "case.toml")
    flat = {k: v for k, v in settings.items() if isinstance(v, (str, int, float, bool))}
    own = path / "mapping.toml"
    if mapping is None and own.is_file():
        mapping = own
    recordings = {}
    for role, file in _files(path).items():
        recording = read_recording(
            file,
            mapping=mapping_beside(file) or mapping,
            signals=signals,
            max_rows=max_rows,
            name=f"{path.name}/{role}",
        )
        recordings[role] = _gauge(replace(recording, metadata={**recording.metadata, **flat}))
    standard = [r for r in ROLES if r in recordings]
    notes = [f"{r} is missing" for r in ROLES if r not in recordings] if standard else []
    if not any(r.startswith("validate") for r in recordings):
        notes.append("nothing is held out, so no claim can be proved")
    return Case(path.name, flat, recordings, tuple(notes))
