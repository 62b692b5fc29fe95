"""The page of what was measured, from the results that lie in `benchmarks/results`."""

from __future__ import annotations

import json
from collections.abc import Callable
from contextlib import suppress
from typing import Any

from provenance import RESULTS
from scores import table

Result = dict[str, Any]

HEAD = """# What was measured

*Every number on this page is read, when the site is built, from the committed results in
`benchmarks/results`, each with its commit, device and date. `make claims` makes them anew and says
what no longer holds; compilation is apart unless told. The scores of the diagnosis are on
[a page of their own](scores.md).*
"""


def result(name: str) -> Result:
    """One committed result."""
    content: Result = json.loads((RESULTS / name).read_text(encoding="utf-8"))
    return content


def made(content: Result) -> str:
    """Where, when and at which commit a result was measured."""
    return f"*{content['device']}; {content['date']}; {content['commit'][:7]}.*"


def ms(timing: Result) -> str:
    """A median in milliseconds."""
    return f"{1e3 * timing['median_s']:.3g}"


def diagnoses() -> str:
    """Whole processes with report."""
    content = result("whole_process.json")
    rows = [
        [
            " + ".join(row["hidden"]) or "nothing",
            f"{row['verdict'].replace('_', ' ')}: {' + '.join(row['effects'])}".rstrip(": "),
            f"{1e3 * row['rms_validation']:.2f}",
            f"{row['first_run']['wall_s']:.0f}",
            f"{row['wall_s']:.0f}",
            f"{row['peak_GiB']:.1f}",
        ]
        for row in content["diagnose"]
    ]
    head = ["hidden", "said", "error, nm", "first run, s", "later runs, s", "peak, GiB"]
    predict = content["predict"]
    return f"""## A diagnosis, whole process with report

{content["diagnose"][0]["samples"]:,} samples, two cores, medians. {made(content)}

{table(head, rows)}

`preisach predict` of {predict["samples"]:,} samples: {predict["wall_s"]:.1f} s, whole process."""


def page_and_files() -> str:
    """The first minute of a user: the page, and large files."""
    content, files = result("page.json"), result("files.json")
    rows = [
        [
            name,
            f"{row['drop_to_first_plot_s']:.1f}",
            f"{row['drop_to_first_fit_s']:.0f}",
            f"{row['brush_median_ms']:.0f}",
        ]
        for name, row in content["rows"].items()
    ]
    kinds = [
        [row["kind"], f"{row['file_MB']:.0f}", f"{row['rows']:,}", f"{row['MB_per_cpu_s']:.0f}"]
        for row in files["results"]
    ]
    return f"""## The page, and large files

In a real browser, other work going on. {made(content)}

{table(["record", "drop to first plot, s", "to first fit, s", "a brush, ms"], rows)}

{table(["file", "MB", "rows", "MB per second of one core"], kinds)}"""


def layouts() -> str:
    """What is taken of each layout that is tried."""
    content = result("layouts.json")
    rows = [
        [f"`{row['file']}`", row["source"], taken(row).replace("|", "\\|"), f"{row['look_s']:.2f}"]
        for row in content["layouts"]
    ]
    asked = sum("question" in row for row in content["layouts"])
    refused = sum("refused" in row for row in content["layouts"])
    return f"""## Layouts of files

{len(rows)} small files in layouts of instruments and of people of the field, opened with no option:
{len(rows) - asked - refused} without a question, {asked} with one, {refused} refused with why.
{made(content)}

{table(["file", "described in", "taken", "look, s"], rows)}

From the file to the verdict of a diagnosis with no option, on the command line and by "Find it for
me" in the page; a question was answered by the command that it offers, and by the first loop.
{made(tried := result("doors.json"))}

{table(["file", "questions", "command line, s", "page, s", "verdict"], doors(tried))}"""


def doors(content: Result) -> list[list[str]]:
    """From a file to its verdict."""
    return [
        [
            f"`{row['file']}`", f"{row['command']['questions']}, {row['page']['questions']}",
            f"{row['command']['seconds']:.0f}", f"{row['page']['seconds']:.0f}",
            row["command"]["said"],
        ]
        for row in content["rows"]
    ]  # fmt: skip


def taken(row: Result) -> str:
    """The columns of a file, or the question or the refusal."""
    if "question" in row:
        return f"a question: {row['question']}"
    if "refused" in row:
        return f"refused: {row['refused']}"
    time = "counted samples" if row["clock"] == "none" else row["time"]
    several = f"; {row['records']} records" if row["records"] > 1 else ""
    return f"{row['input']} → {row['output']}; {time}{several}"


def drive() -> str:
    """Tracking with the inverse model."""
    content = result("drive.json")
    bounds = f"of {content['stages']}"
    rows = [
        [
            name, f"{each['within_1.2']} {bounds}", f"{each['within_0.3_percent']} {bounds}",
            f"{each['median_ratio']:.2f} ({each['most_ratio']:.2f})",
            f"{each['median_ratio_to_rows_alike']:.2f} ({each['most_ratio_to_rows_alike']:.2f})",
            f"{each['median_percent_of_stroke']:.3f} ({each['most_percent_of_stroke']:.3f})",
            f"{each['median_affine_percent']:.1f}",
        ]
        for name, each in content["courses"].items()
    ]  # fmt: skip
    head = [
        "course", "within 1.2", "within 0.3 %", "over the held-out error", "over that of like rows",
        "% of stroke", "affine map, %",
    ]  # fmt: skip
    stages = [
        [
            " + ".join(row["effects"]) or "none", str(row["seed"]),
            f"{1e3 * row['held_out_rms_um']:.1f}", f"{1e3 * row['noise_rms_um']:.1f}",
            *(f"{1e3 * each['tracking_rms_um']:.1f} ({each['ratio']:.2f})"
              for each in row["followed"]),
        ]
        for row in content["rows"]
    ]  # fmt: skip
    names = ["hidden", "seed", "held out, nm", "noise, nm", *content["courses"]]
    return f"""## The drive

{content["stages"]} stages simulated by independent code, with up to three hidden effects, were
measured for 12 s, fitted, and driven along courses by the inverse of the model. Tracking errors are
those of the stage itself, without the noise of its sensor; the held-out error of the model contains
that noise. The first course consists of the motions of the record in their shares, with other
turning points. The second moves nearly all the time, while the record rests in nearly half of its
rows, where every model errs least; so beside the held-out error stands that of the rows like those
of the course. Medians, and the greatest in brackets. {made(content)}

{table(head, rows)}

{content["unreachable_courses_told"]} of {content["unreachable_courses"]} courses that cannot be
reached were told in every row that is far off.

{table(names, stages)}"""


def exported() -> str:
    """The exported code: against `predict`, and its speed."""
    code = result("export.json")
    rows = [
        [kind, course.replace("_", " "), *(f"{each[key]:.3g}" for key in each)]
        for kind, courses in code["ns_a_sample"].items()
        for course, each in courses.items()
    ]
    online = [
        [
            row["name"], str(row["levels"]), "yes" if row["learns"] else "no",
            f"{row['p50_us']:.0f}", f"{row['p99_us']:.0f}",
        ]
        for row in result("inverse.json")["rows"]
    ]  # fmt: skip
    return f"""## The code in C

{code["models"]} exported models against `predict` over {code["samples"]:,} samples each, in double
precision: {code["relays_alone_equal_to_the_bit"]} of {code["relays_alone"]} models of relays alone
are equal to the bit; {code["ramps_within_1e-12"]} of {code["ramps"]} of ramps are within 1e-12 of
the range, at most {code["worst_double"]:.1e} apart. In single precision
{code["float_without_jumps_within_1e-5"]} of the {code["float_without_jumps"]} whose output does not
jump are within 1e-5, at most {code["worst_float_without_jumps"]:.1e} apart. {made(code)}

Nanoseconds a sample, N = 37, beside a kernel written by hand for a plain relay plane:

{table(["hysteron", "input", "by hand", "step", "inverse", "adapt"], rows)}

Microseconds a sample of `OnlineInverse`, called from Python on one core beside other work, which
the 99th percentile shows:

{table(["model", "levels", "learns", "median", "99 %"], online)}"""


def controller() -> str:
    """Instructions on a microcontroller."""
    content = result("controller.json")
    rate = content["rate_hz"]
    rows = []
    for row in content["rows"]:
        most = {
            name: max(course["most"] for course in courses.values())
            for name, courses in row["instructions"].items()
        }
        rows.append(
            [
                row["name"], str(row["levels"]),
                f"{row['flash_bytes'] / 1024:.1f}", f"{row['memory_bytes'] / 1024:.1f}",
                *(f"{count:,} ({1e-6 * rate * count:.0f})" for count in most.values()),
            ]
        )  # fmt: skip
    head = ["model", "levels", "flash, KiB", "memory, KiB", "step", "inverse", "adapt"]
    return f"""## The code on a microcontroller

{content["controller"]}, single precision, `{content["compiler"].split(" (")[0]} -O2`: the most
instructions that one of {content["samples"]} samples took on three courses, and in brackets
millions a second at {rate / 1e3:.0f} kHz. A Cortex-M4 at 168 MHz has 168 million cycles a second;
most instructions take one, and waiting for flash memory comes on top. {made(content)}

{table(head, rows)}"""


def operator() -> str:
    """Simulation and identification beside C."""
    content = result("relays.json")
    rows = []
    for plane in content["planes"]:
        for name, task in (("simulate", "simulate"), ("identify one output", "one_lane")):
            own, c = plane[task]["event_form"], plane[task]["c"]
            rows.append(
                [
                    str(plane["levels"]), name, ms(own), f"{own['median_s'] / c['median_s']:.1f}",
                    f"{plane[task]['dense_form']['median_s'] / own['median_s']:.0f}",
                ]
            )  # fmt: skip
        own, c = (plane["many_lanes"][name] for name in ("vmap_of_run", "c"))
        name = f"identify {content['lanes']} outputs, `vmap`"
        ratio = f"{own['median_s'] / c['median_s']:.1f}"
        rows.append([str(plane["levels"]), name, ms(own), ratio, ""])
    head = ["levels", "task", "ms", "times C", "dense form, times this"]
    return f"""## The operator of relays

A Bernoulli ramp of {content["samples"]:,} samples at 2 kHz, one core, double precision; C
written for this alone, in the same run, gives the same weights. C does what `run` does, from raw
samples to weights and the output of each, and one output after the other. {made(content)}

{table(head, rows)}

## Which variants there are

A variant of the operator stays if it is quicker than what would serve in its place.

{table(["variant", "serves", "in its place", "times as quick"], _variants(content))}"""


def _variants(content: dict[str, Any]) -> list[list[str]]:
    """The variants of the operator, and how much each gains over the scan of steps."""
    few, many = (
        next(plane for plane in content["planes"] if plane["levels"] == levels)
        for levels in (37, 75)
    )

    def gain(task: str, name: str, other: str) -> str:
        times = (
            plane[task][other]["median_s"] / plane[task][name]["median_s"] for plane in (few, many)
        )
        return " and ".join(f"{time:.3g}" for time in times) + " (N = 37, 75)"

    return [
        ["branches between turning points", "`simulate`, ramps", "scan of steps",
         gain("ramps", "simulate", "simulate_dense")],
        ["the same", "`simulate`, relays", "scan of steps",
         gain("simulate", "event_form", "dense_form")],
        ["blocks of the cells that switch", "`run`, relays", "scan of steps",
         gain("one_lane", "event_form", "dense_form")],
        ["lines that an input moves", "`run`, ramps, from 50 levels", "scan of steps",
         gain("ramps", "one_lane", "one_lane_dense")],
        ["NumPy in place", "`OnlineFilter`", "`step` under `jit`",
         "[see below](#one-sample-a-call)"],
        ["scan of steps", "what has no other; the tests' reference", "", ""],
    ]  # fmt: skip


def sweep() -> str:
    """The sweep of Fig. 8."""
    content = result("sweep.json")
    run = content["sweep"]
    identifications = run["outputs"] * len(run["levels"])
    return f"""## The sweep of Fig. 8

{identifications} identifications of {run["samples"]:,} samples, experiments included:
{run["run"]["median_s"]:.2f} s, compiled once in {run["compile_s"]:.0f} s; a loop over the filter in
its dense form would take {content["ratio"]:.0f} times as long. {made(content)}"""


def streaming() -> str:
    """Latency of single samples."""
    content = result("streaming.json")
    rows = [
        [row["way"], row["hysteron"], str(row["levels"]),
         f"{row['p50_us']:.3g}", f"{row['p99_us']:.3g}", f"{row['most_us']:.3g}"]
        for row in content["rows"]
    ]  # fmt: skip
    head = ["way", "hysteron", "levels", "median, µs", "99th percentile, µs", "most, µs"]
    return f"""## One sample a call

Input at {content["rate_hz"]:g} Hz, one core. {made(content)}

{table(head, rows)}"""


def broken_sensor() -> str:
    """How long the filter takes to forget."""
    content = result("broken_sensor.json")
    rows: dict[str, dict[str, list[str]]] = {}
    for row in content["rows"]:
        said = f"{row['samples']:,}" if row["samples"] >= 0 else "never"
        rows.setdefault(row["fault"], {}).setdefault(row["filter"], []).append(said)
    head = ["for 5,000 samples", *next(iter(rows.values()))]
    lines = [[fault, *map(", ".join, each.values())] for fault, each in rows.items()]
    return f"""## A broken sensor

A stage of 9 levels, noise of 1 % of the output's range, some nine samples a level; after 120,000
samples the sensor fails for 5,000. Samples from its return until the prediction errs as little as
if the output had just been missing, for relays and for ramps, in windows of 1,000. {made(content)}

{table(head, lines)}"""


def peers() -> str:
    """Soft relays trained with Adam, as today's differentiable packages do it."""
    content = result("peers.json")
    rows = [
        [row["method"], str(row["levels"]), f"{row['median_s']:.2f}",
         f"{row['rms_held_out']:.4f}"]
        for row in content["identification"]
    ]  # fmt: skip
    return f"""## Beside soft relays, trained by gradient

{content["samples"]:,} samples with noise of {content["noise"]:g}, output ±0.65, a stage on neither
grid, one core; the peer is written after the way differentiable packages work. {made(content)}

{table(["method", "levels", "s", "held-out error"], rows)}"""


def bands() -> str:
    """Coverage of the 95 % bands of predictions."""
    content = result("bands.json")
    kinds = {"inside": "blocks inside", "forecast": "the 3 s behind", "new": "another record"}
    rows = []
    for hidden, found in content["hidden"].items():
        for kind, name in kinds.items():
            if kind in found:
                slices = dict(found[kind]["slices"])
                whole = slices.pop("all")
                poorest = min(slices, key=lambda each: slices[each]["percent"])
                rows.append(
                    [
                        hidden.replace("_", " "), name, str(found[kind]["records"]),
                        f"{whole['percent']:.1f}", f"{whole['worst']:.0f}",
                        f"{slices[poorest]['percent']:.1f} ({poorest})",
                        f"{found[kind]['width']:.2f}",
                    ]
                )  # fmt: skip
    pairs = [each for found in content["hidden"].values() for each in found["intervals"]]
    inside = sum(low <= truth <= high for _, _, low, high, truth in pairs)
    seeds = {seed for found in content["hidden"].values() for seed in found["seeds"]}
    told = (
        f" {inside} of {len(pairs)} intervals that `pj.fit` states hold the truth." if pairs else ""
    )
    head = ["hidden", "rows", "records", "inside, %", "worst record, %", "worst slice, %", "width"]
    return f"""## The band of a prediction

Records of 12 s by independent code, seeds {min(seeds)} to {max(seeds)}, none of which was looked
at before. 9 s but some blocks were fitted with {content["levels"]} levels and the effect that is
hidden; `predict` states a band that should hold 95 % of the measured rows. Slices are thirds by the
speed of the input, by the time since it turned, by how often the place on the plane was visited,
and seconds of the forecast. The width is the median of half the band over 1.96 times the RMS
error.{told} {made(content)}

{table(head, rows)}"""


def accelerator() -> str:
    """What an accelerator does for each driver, beside the processor of its machine."""
    content = result("accelerator.json")
    said = {
        "sweep": "sweep of Fig. 8, {seeds} seeds",
        "sweep_of_many": "sweep of Fig. 8, {seeds} seeds",
        "lanes": "recursion over events, {lanes:,} outputs of one input, {levels} levels",
        "filter": "one filter, a scan of {samples:,} samples, {levels} levels",
        "fleet": "{records} filters of {records} records, {samples:,} samples, {levels} levels",
        "gradient": "gradient of a model in its weights, {levels} levels",
        "diagnosis": "a diagnosis of {rows:,} samples",
    }
    rows: list[list[str]] = []
    for task, found in content["tasks"].items():
        gpu, cpu, agreed = found["cuda"], found["cpu"], found["difference"]
        here = cpu["run"]["median_s"]
        if "run" in gpu:
            there = gpu["run"]["median_s"]
            cells = [f"{there:.3g}", f"{here:.3g}", f"{float(f'{there / here:.2g}'):g}"]
        else:
            cells = [f"more than {gpu['not finished in s']:.0f}", f"{here:.3g}", ""]
        cells.append("" if agreed is None else f"{agreed:.0e}")
        rows.append([said[task].format_map(cpu["what"]), *cells])
    devices = content["tasks"]["sweep"]
    head = [
        devices["cuda"]["devices"]["kind"] + ", s",
        f"{devices['cpu']['devices']['count']} cores, s",
    ]
    return f"""## On a GPU

Double precision, medians behind the first call. Short steps one after another wait for a GPU; many
outputs at once do not. Fits and diagnoses run on the processor beside it, unless JAX is told
otherwise: on the GPU the same diagnosis did not end in 80 s. {made(content)}

{table(["what", *head, "ratio", "largest difference, of the largest value"], rows)}"""


SECTIONS: tuple[Callable[[], str], ...] = (
    diagnoses, page_and_files, layouts, drive, exported, controller, operator, streaming, sweep,
    broken_sensor, peers, bands, accelerator,
)  # fmt: skip


def page() -> str:
    """The page in Markdown, without the sections whose results are not there."""
    parts = [HEAD]
    for section in SECTIONS:
        with suppress(FileNotFoundError):
            parts.append(section())
    return "\n\n".join(parts) + "\n"
