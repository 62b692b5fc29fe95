"""`preisach` alone: what to type first, with the files that lie here."""

from __future__ import annotations

from pathlib import Path

from preisach_jax.cli import screen

_READ = frozenset(
    ".csv .txt .dat .tsv .asc .lvm .tdms .xlsx .xls .ods .h5 .hdf5 .mat .npz .npy .parquet "
    ".feather .forc .frc .gz .zip".split()
)
_MOST_SHOWN = 5
_MOST_LISTED = 2_000
_MODEL_BYTES = 400

_NOTHING_HERE = (
    ("preisach demo", "a diagnosis of a measured record that comes with the program"),
    ("preisach simulate --effects creep --out stage.csv", "a record of a simulated stage"),
    ("preisach diagnose stage.csv", "which effect is missing in it, with a report"),
)


def start(folder: Path | None = None) -> int:
    """Print the first commands, with the records and models in a folder as their arguments."""
    records, models, reports = _found(folder or Path())
    screen.say("preisach finds out which physical effect a hysteresis model lacks.\n")
    lines = list(_NOTHING_HERE)
    if records:
        shown = ", ".join(path.name for path in records[:_MOST_SHOWN])
        more = f" and {len(records) - _MOST_SHOWN} more" if len(records) > _MOST_SHOWN else ""
        screen.say(f"Files here that may be records: {shown}{more}\n")
        name = _quoted(records[0].name)
        lines = [
            (f"preisach look {name}", "what it holds and what it can tell, in seconds"),
            (f"preisach diagnose {name}", "which effect is missing, with a report"),
            (f"preisach app {name}", "the same by hand, in a page on this machine"),
        ]
    else:
        screen.say("There is no record here (CSV, Excel, TDMS, HDF5, MAT, ...). To begin:\n")
    if models and records:
        model = _quoted(models[0].as_posix())
        text = "an existing model against a record"
        lines.append((f"preisach compare {model} {_quoted(records[0].name)}", text))
    if reports:
        text = "what to record next, from the last diagnosis"
        lines.append((f"preisach design {_quoted(reports[0].as_posix())} --out next.csv", text))
    lines.append(("preisach --help", "all commands"))
    width = max(len(line) for line, _ in lines)
    for line, text in lines:
        screen.say(f"  {line:{width}}  {text}")
    return 0


def _found(folder: Path) -> tuple[list[Path], list[Path], list[Path]]:
    """Records, the newest first; models; and folders with a report."""
    records: list[tuple[float, Path]] = []
    models: list[Path] = []
    reports: list[Path] = []
    try:
        entries = sorted(folder.iterdir())[:_MOST_LISTED]
    except OSError:
        return [], [], []
    for path in entries:
        try:
            if path.is_dir():
                if (path / "diagnosis.json").is_file():
                    reports.append(path)
                if (path / "model.json").is_file() and _is_model(path / "model.json"):
                    models.append(path / "model.json")
            elif path.suffix.lower() in _READ and path.stat().st_size:
                records.append((path.stat().st_mtime, path))
            elif path.suffix.lower() == ".json" and _is_model(path):
                models.append(path)
        except OSError:
            continue
    return [path for _, path in sorted(records, reverse=True)], models, reports


def _is_model(path: Path) -> bool:
    with path.open("rb") as file:
        return b"preisach" in file.read(_MODEL_BYTES)


def _quoted(name: str) -> str:
    return f'"{name}"' if set(name) - _PLAIN else name


_PLAIN = frozenset("abcdefghijklmnopqrstuvwxyzABCDEFGHIJKLMNOPQRSTUVWXYZ0123456789._-/")
