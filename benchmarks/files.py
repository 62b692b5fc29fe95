"""How fast records are read: a hundred megabytes of each kind, and a look at what was read.

    python benchmarks/files.py [--megabytes 100] [--against TREE]
    python benchmarks/files.py --layouts

With another tree of this repository, each file is read in turn by both, and the ratio of the times
of the processor is noted. The last opens, with no option, each layout of instruments that the tests
know, and the files that people keep, and notes what was taken, whether a question was asked, and
the seconds of a look.

Each kind is read in a process of its own, so that its greatest memory is its own; the file is in
the cache of the disk. Beside the time on the wall stands that of the processor, as other programs
may have run. MB are those of the file, and for packed files those of the text inside.
"""

from __future__ import annotations

import argparse
import gzip
import json
import os
import resource
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np
from common import write_results

KINDS = (
    "csv", "csv_semicolon_comma", "csv_no_names", "txt_spaces", "tektronix.csv", "lvm", "csv.gz",
    "npz", "npy", "mat", "mat73", "h5", "tdms", "parquet", "feather", "xlsx", "qd.dat", "mts.dat",
    "shimadzu.csv", "zwick.TRA",
)  # fmt: skip
ROWS_A_MB = 19_500  # of a CSV of four columns
TESTS = Path(__file__).parent.parent / "tests"
NAMES = ("t_s", "u_V", "z_um", "load_N")


def columns(rows: int) -> dict[str, np.ndarray]:
    """A stage that runs for a while, with noise in every digit."""
    random = np.random.default_rng(0)
    t = np.arange(rows) / 20_000
    u = 37.5 - 37.5 * np.cos(2 * np.pi * 3 * t) + 1e-3 * random.normal(size=rows)
    return dict(zip(NAMES, (t, u, 0.6 * np.abs(u) ** 1.1, random.normal(size=rows)), strict=True))


def text(table: dict[str, np.ndarray], sep: str = ",", decimal: str = ".", head: str | None = None):
    import pandas as pd

    shown = pd.DataFrame(table).to_csv(
        sep=sep, decimal=decimal, index=False, float_format="%.12g", header=head is None
    )
    return (head or "") + shown


def write(kind: str, path: Path, table: dict[str, np.ndarray]) -> None:
    (write_binary if kind in {*_BINARY, "xlsx"} else write_text)(kind, path, table)


def write_text(kind: str, path: Path, table: dict[str, np.ndarray]) -> None:
    if kind == "csv":
        path.write_text(text(table))
    elif kind == "csv_semicolon_comma":
        path.write_text(text(table, ";", ","))
    elif kind == "csv_no_names":
        path.write_text(text(table, head="# Sample rate: 20 kHz\n"))
    elif kind == "txt_spaces":
        path.write_text(text(table, " "))
    elif kind == "tektronix.csv":
        head = "Model,MSO44\nSample Interval,5e-05\nVertical Units,V,V\n\nTIME,CH1,CH2,CH3\n"
        path.write_text(text(table, head=head))
    elif kind == "qd.dat":
        head = "[Header]\nBYAPP,MPMS\n[Data]\nTime,Field (Oe),Long Moment (emu),Temperature (K)\n"
        path.write_text(text(table, head=head))
    elif kind == "mts.dat":
        head = (
            "MTS793|MPT|DEU|1|2|,|.|:|49|1|1|A\n\nDatenerfassung: Zeit\t\t\tZeit:\t10,0\tSek\n"
            "Zeit\tKolbenweg\tKraft\tDehnung\nSek\tmm\tkN\tmm\n"
        )
        path.write_text(text(table, "\t", ",", head))
    elif kind == "shimadzu.csv":
        head = "Name,1 _ 1,,\nTime,Stroke,Force,Strain\nsec,mm,N,mm\n"
        path.write_text(text(table, head=head))
    elif kind == "zwick.TRA":
        head = "Prüfzeit;Standardweg;Standardkraft;Weg 2\ns;mm;N;mm\n"
        path.write_text(text(table, ";", ",", head), encoding="utf-8")
    elif kind == "lvm":
        head = (
            "LabVIEW Measurement\t\nSeparator\tTab\nX_Columns\tOne\n***End_of_Header***\t\n\t\n"
            "Channels\t3\t\nDelta_X\t5E-5\t5E-5\t5E-5\n***End_of_Header***\t\n"
            "X_Value\tu_V\tz_um\tload_N\n"
        )
        path.write_text(text(table, "\t", head=head))
    elif kind == "csv.gz":
        path.write_bytes(gzip.compress(text(table).encode(), 1))


def write_binary(kind: str, path: Path, table: dict[str, np.ndarray]) -> None:
    import pandas as pd

    matrix = np.column_stack(list(table.values()))
    if kind == "npz":
        np.savez(path, **table)
    elif kind == "npy":
        np.save(path, matrix)
    elif kind == "mat":
        from scipy.io import savemat

        savemat(path, table)
    elif kind in {"h5", "mat73"}:
        import h5py

        with h5py.File(path, "w", userblock_size=512 if kind == "mat73" else 0) as file:
            for name, values in table.items():
                file[name] = values
        if kind == "mat73":
            with path.open("r+b") as stream:
                stream.write(b"MATLAB 7.3 MAT-file".ljust(124) + b"\x00\x02IM")
    elif kind == "tdms":
        from nptdms import ChannelObject, TdmsWriter

        with TdmsWriter(str(path)) as writer:
            writer.write_segment([ChannelObject("run", n, v) for n, v in table.items()])
    elif kind == "parquet":
        pd.DataFrame(table).to_parquet(path)
    elif kind == "feather":
        pd.DataFrame(table).to_feather(path)
    elif kind == "xlsx":
        from openpyxl import Workbook

        book = Workbook(write_only=True)
        sheet = book.create_sheet("Data")
        sheet.append(list(table))
        for row in matrix.tolist():
            sheet.append(row)
        book.save(path)


def read(path: Path, first_look: bool) -> dict[str, float]:
    """Times of one file, in a process that reads nothing else."""
    import pandas as pd  # noqa: F401 - loaded once for whatever is read

    from preisach_jax.record.core import Record

    names = {"time": "1", "input": "2", "output": "3"}
    if path.name.startswith(("h5", "mat73", "parquet", "feather")):  # which keep columns by name
        names = {"time": "t_s", "input": "u_V", "output": "z_um"}
    if path.name.startswith("lvm"):
        names = {"input": "u_V", "output": "z_um"}
    begun, spent = time.perf_counter(), _cpu_s()
    record = Record.load(path, **names)
    found = {"read_s": time.perf_counter() - begun, "read_cpu_s": _cpu_s() - spent}
    found["rows"] = len(record)
    if first_look:
        from preisach_jax.look import look

        begun = time.perf_counter()
        look(record)
        found["look_s"] = time.perf_counter() - begun
    found["memory_MB"] = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
    return found


def _cpu_s() -> float:
    """Processor seconds of this process, and of those that it has waited for."""
    used = map(resource.getrusage, (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN))
    return sum(each.ru_utime + each.ru_stime for each in used)


def measure(
    kind: str, megabytes: float, first_look: bool, against: Path | None
) -> dict[str, float | str]:
    ending = kind.split(".", 1)[1] if "." in kind else kind.split("_", maxsplit=1)[0]
    ending = {"mat73": "mat"}.get(ending, ending)
    # A binary file has 32 bytes a row, a workbook about 50.
    rows = int(megabytes * (ROWS_A_MB if kind not in _BINARY else 1e6 / 32))
    if kind == "xlsx":
        rows = min(int(megabytes * 1e6 / 50), 2**20 - 1)  # as many as a sheet has
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / f"{kind.split('.', maxsplit=1)[0]}.{ending}"
        table = columns(rows)
        write(kind, path, table)
        size = path.stat().st_size / 1e6
        inside = len(gzip.decompress(path.read_bytes())) / 1e6 if kind == "csv.gz" else size
        del table
        words = [sys.executable, __file__, "--read", str(path), *(["--look"] * first_look)]
        trees = [Path(__file__).parents[1], *([against] if against else [])]
        found, *others = _read_by(words, trees)
    for other in others:
        found |= {"other_cpu_s": other["read_cpu_s"], "other_memory_MB": other["memory_MB"]}
        found["ratio"] = found["read_cpu_s"] / other["read_cpu_s"]
    found |= {"kind": kind, "file_MB": size, "MB_per_s": inside / found["read_s"]}
    found["MB_per_cpu_s"] = inside / found["read_cpu_s"]
    rates = f"{found['MB_per_s']:8.1f} MB/s, {found['MB_per_cpu_s']:8.1f} MB per s of processor"
    print(f"{kind:22s} {inside:7.1f} MB {found['read_s']:7.2f} s {rates}", flush=True)
    return {key: round(v, 3) if isinstance(v, float) else v for key, v in found.items()}


def _read_by(words: list[str], trees: list[Path]) -> list[dict[str, float]]:
    """The better of two readings by each tree, in turn, of those that read the file."""
    best: dict[Path, dict[str, float]] = {}
    for tree in trees * 2:
        environment = {**os.environ, "PYTHONPATH": str(tree)}
        ours = tree == trees[0]
        done = subprocess.run(words, capture_output=True, text=True, check=ours, env=environment)
        if done.returncode == 0:
            found = json.loads(done.stdout)
            best[tree] = min(found, best.get(tree, found), key=lambda each: each["read_cpu_s"])
    return [best[tree] for tree in trees if tree in best]


_BINARY = {"npz", "npy", "mat", "mat73", "h5", "tdms", "parquet", "feather"}


def layouts() -> None:
    """Open every layout that the tests have typed or keep, as `preisach look FILE` does."""
    sys.path.insert(0, str(TESTS))
    from test_record_layouts import FILES, LAYOUTS

    with tempfile.TemporaryDirectory() as folder:
        typed = {Path(folder) / name: layout[0] for name, layout in LAYOUTS.items()}
        for path, content in typed.items():
            path.write_text(content, encoding="utf-8")
        both = [(path, "typed after a manual or a published file") for path in typed]
        both += [(path, "kept by people of the field") for path in sorted(FILES.iterdir())]
        opened(both[0][0])  # what is loaded once
        rows = [{"file": path.name, "source": source, **opened(path)} for path, source in both]
    write_results("layouts.json", {"layouts": rows})


def opened(path: Path) -> dict[str, object]:
    """What a look takes of a file, or the question or the refusal in its place, and its seconds."""
    from preisach_jax import InputError
    from preisach_jax.look.examination import look_at_file
    from preisach_jax.record.columns import QuestionError

    begun, found = time.perf_counter(), dict[str, object]()
    try:
        seen = look_at_file(path).to_json()
        found = {role: seen["channels"][role]["column"] for role in ("time", "input", "output")}
        found |= {"records": len(seen["records"]), "clock": seen["clock"]["kind"]}
    except QuestionError as question:
        found["question"] = (question.command or "").replace(str(path), path.name)
    except InputError as refusal:
        found["refused"] = str(refusal).removeprefix(f"{path}: ")
    return found | {"look_s": round(time.perf_counter() - begun, 3)}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--megabytes", type=float, default=100.0)
    parser.add_argument("--kinds", nargs="*", default=list(KINDS))
    parser.add_argument("--read", type=Path)
    parser.add_argument("--against", type=Path, metavar="TREE")
    parser.add_argument("--look", action="store_true")
    parser.add_argument("--layouts", action="store_true")
    words = parser.parse_args()
    if words.layouts:
        layouts()
        return
    if words.read:
        print(json.dumps(read(words.read, words.look)))
        return
    results: list[dict[str, float | str]] = []
    for kind in words.kinds:
        first_look = kind in {"csv", "npz"}
        results.append(measure(kind, words.megabytes, first_look, words.against))
        write_results("files.json", {"results": results})


if __name__ == "__main__":
    main()
