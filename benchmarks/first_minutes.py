"""From a file of an instrument to a named effect, as a new user would: seconds and questions.

    python benchmarks/first_minutes.py [--out benchmarks/results/first_minutes.json]

Eight files of stages that hide creep or a delay, each as another instrument or program writes it,
are given by their name alone to `preisach look` and `preisach diagnose`, and dropped into the page
in a Chromium without a window.  A question is a refusal that asks for a column, or a menu of the
page that has to be set; its answer is the one written beside the file below.  Beside the seconds on
the wall stand those of the processor, as other programs may run.
"""

from __future__ import annotations

import argparse
import gzip
import json
import os
import re
import resource
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from conditions import write_results

from preisach_jax.plant import simulate_stage

sys.path.append(str(Path(__file__).parents[1] / "tests"))

SECONDS, RATE_HZ = 6.0, 1000.0
PATIENCE_MS = 600_000
Columns = tuple[np.ndarray, np.ndarray, np.ndarray]


@dataclass(frozen=True)
class Given:
    """A file: its name, what it hides, what writes it, and the columns to answer if asked."""

    name: str
    hides: str
    write: Callable[[Path, Columns], object]
    answer: tuple[str, str, str]


def lines(columns: Columns, sep: str, decimal: str = ".") -> str:
    table = np.column_stack(columns).tolist()
    return "".join(sep.join(f"{v:.9g}".replace(".", decimal) for v in row) + "\n" for row in table)


def tektronix(path: Path, columns: Columns) -> None:
    step = columns[0][1] - columns[0][0]
    head = (
        f"Model,MSO44\nFirmware Version,1.28\nSample Interval,{step:.6g}\n"
        f"Record Length,{len(columns[0])}\nVertical Units,V,V\n\nTIME,CH1,CH2\n"
    )
    path.write_text(head + lines(columns, ","))


def german(path: Path, columns: Columns) -> None:
    head = "Prüfstand 3\nDatum: 24.11.2026\n\nZeit [s];Spannung [V];Weg [µm]\n"
    path.write_bytes((head + lines(columns, ";", ",")).encode("cp1252"))


def labview(path: Path, columns: Columns) -> None:
    step = columns[0][1] - columns[0][0]
    head = (
        "LabVIEW Measurement\t\nSeparator\tTab\nX_Columns\tOne\n***End_of_Header***\t\n\t\n"
        f"Channels\t2\t\nDelta_X\t{step:.6g}\t{step:.6g}\n***End_of_Header***\t\n"
        "X_Value\tdrive_V\tposition_um\n"
    )
    path.write_text(head + lines(columns, "\t"))


def tdms(path: Path, columns: Columns) -> None:
    from nptdms import ChannelObject, TdmsWriter

    step = float(columns[0][1] - columns[0][0])
    with TdmsWriter(str(path)) as writer:
        channels = [
            ChannelObject("run 1", name, values, {"unit_string": unit, "wf_increment": step})
            for name, unit, values in (("Voltage", "V", columns[1]), ("Position", "um", columns[2]))
        ]
        writer.write_segment(channels)


def workbook(path: Path, columns: Columns) -> None:
    from openpyxl import Workbook

    book = Workbook(write_only=True)
    sheet = book.create_sheet("Data")
    for row in (["Stage 7"], [], ["Time", "Voltage", "Displacement"], ["s", "V", "um"]):
        sheet.append(row)
    for row in np.column_stack(columns).tolist():
        sheet.append(row)
    book.save(path)


def matrix(path: Path, columns: Columns) -> None:
    from scipy.io import savemat

    savemat(path, {"data": np.column_stack(columns)})


def hdf5(path: Path, columns: Columns) -> None:
    import h5py

    with h5py.File(path, "w") as file:
        for name, values in zip(("t_s", "u_V", "z_um"), columns, strict=True):
            file[f"run3/daq/{name}"] = values
        file["run3/notes"] = "after alignment"


def packed(path: Path, columns: Columns) -> None:
    text = "time (ms)\tinput voltage (V)\tsensor (nm)\n"
    scaled = (1e3 * columns[0], columns[1], 1e3 * columns[2])
    path.write_bytes(gzip.compress((text + lines(scaled, "\t")).encode("utf-16")))


FILES = (
    Given("tek0001.csv", "delay", tektronix, ("TIME", "CH1", "CH2")),
    Given("messung.csv", "creep", german, ("Zeit [s]", "Spannung [V]", "Weg [µm]")),
    Given("run.lvm", "delay", labview, ("X_Value", "drive_V", "position_um")),
    Given("run.tdms", "creep", tdms, ("time", "Voltage", "Position")),
    Given("book.xlsx", "delay", workbook, ("Time", "Voltage", "Displacement")),
    Given("matrix.mat", "creep", matrix, ("1", "2", "3")),
    Given("daq.h5", "delay", hdf5, ("run3/daq/t_s", "run3/daq/u_V", "run3/daq/z_um")),
    Given("log.txt.gz", "creep", packed, ("time (ms)", "input voltage (V)", "sensor (nm)")),
)


def spent_s() -> float:
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    return used.ru_utime + used.ru_stime


def command(words: list[str], given: Given) -> dict[str, object]:
    """Run a command on a file alone, and once more with an answer where it asks for columns."""
    whole = [sys.executable, "-m", "preisach_jax.cli", *words]
    begun, spent = time.perf_counter(), spent_s()
    done = subprocess.run(whole, capture_output=True, text=True, check=False)
    questions, asked = 0, ""
    if done.returncode == 2:
        questions, asked = 1, done.stderr.strip().splitlines()[-1]
        asked = asked.replace(f"{Path(words[1]).parent}{os.sep}", "")
        options = zip(("--time", "--input", "--output"), given.answer, strict=True)
        whole += [word for pair in options for word in pair]
        done = subprocess.run(whole, capture_output=True, text=True, check=False)
    return {
        "s": time.perf_counter() - begun,
        "cpu_s": spent_s() - spent,
        "questions": questions,
        "asked": asked,
        "code": done.returncode,
        "said": done.stdout if done.returncode == 0 else done.stderr,
    }


def on_the_command_line(path: Path, given: Given, folder: Path) -> dict[str, object]:
    look = command(["look", str(path)], given)
    report = folder / f"report-{given.name}"
    found = command(["diagnose", str(path), "--report", str(report)], given)
    named = ""
    if found["code"] == 0:
        named = ", ".join(json.loads((report / "diagnosis.json").read_text())["effects"])
    return {
        "look": {key: look[key] for key in ("s", "cpu_s", "questions", "asked", "code")},
        "diagnose": {key: found[key] for key in ("s", "cpu_s", "questions", "asked", "code")},
        "named": named,
    }


def in_the_page(browser, address: str, path: Path, given: Given) -> dict[str, object]:
    from page import DRAWN, button, cpu_s, settle

    from preisach_jax.app.columns import NO_COLUMN

    tab = browser.new_page(viewport={"width": 1280, "height": 800})
    tab.set_default_timeout(PATIENCE_MS)
    tab.goto(address)
    button(tab, "Find it for me").wait_for()
    settle()
    begun, spent, questions = time.perf_counter(), cpu_s(), 0
    tab.locator("input[type=file]").first.set_input_files(path)
    tab.get_by_label("Output", exact=True).wait_for()
    for role, column in zip(("Time", "Input", "Output"), given.answer, strict=True):
        if tab.get_by_label(role, exact=True).input_value() in {"", NO_COLUMN}:
            tab.get_by_label(role, exact=True).select_option(column)
            questions += 1
    tab.wait_for_function(DRAWN, polling="raf")
    drawn = time.perf_counter() - begun
    tab.locator(".mark").first.wait_for()
    seconds = {"first_plot_s": drawn, "s": time.perf_counter() - begun, "cpu_s": cpu_s() - spent}
    named = tab.locator(".candidate b").first.inner_text()
    tab.close()
    return {**seconds, "questions": questions, "named": named}


def main() -> None:
    from browser import FLAGS, NAMES, served
    from playwright.sync_api import sync_playwright

    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--only", nargs="*", default=[each.name for each in FILES])
    parser.add_argument("--out", default="first_minutes.json")
    words = parser.parse_args()
    chromium = next(filter(None, map(shutil.which, NAMES)), None)
    rows: dict[str, object] = {}
    with tempfile.TemporaryDirectory() as place, sync_playwright() as driver:
        folder = Path(place)
        browser = driver.chromium.launch(executable_path=chromium, args=FLAGS) if chromium else None
        with served(folder=folder) as address:
            for given in (each for each in FILES if each.name in words.only):
                stage = simulate_stage(5, SECONDS, (given.hides,), RATE_HZ)
                path = folder / given.name
                given.write(path, (stage.time, stage.input, stage.output))
                row = {"hides": given.hides, **on_the_command_line(path, given, folder)}
                if browser is not None:
                    row["page"] = in_the_page(browser, address, path, given)
                rows[given.name] = row
                print(given.name, re.sub(r"(\d\.\d\d)\d+", r"\1", json.dumps(row)), flush=True)
                write_results(words.out, {"samples": int(SECONDS * RATE_HZ), "rows": rows})


if __name__ == "__main__":
    main()
