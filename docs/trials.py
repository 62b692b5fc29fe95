"""The page of what was tried to break the package, from `benchmarks/results/trust`."""

from __future__ import annotations

import json
from typing import Any

from scores import RESULTS, table

TRUST = RESULTS / "trust"

HEAD = """# What was tried to break it

*Every number in a table of this page is read, when the site is built, from the committed results in
`benchmarks/results/trust`. The scripts beside `benchmarks/trust` make them anew.*
"""


def result(name: str) -> dict[str, Any]:
    """One committed result; empty if it was not measured."""
    file = TRUST / name
    return json.loads(file.read_text(encoding="utf-8")) if file.exists() else {}


def laws() -> str:
    """Properties, with the cases in which they were tried."""
    content = result("laws.json")
    by_file: dict[str, list[dict[str, int]]] = {}
    for name, law in content["laws"].items():
        by_file.setdefault(name.partition("::")[0], []).append(law)
    rows = [
        [f"`{file}`", str(len(own)), *_sums(own, "cases", "failures")]
        for file, own in sorted(by_file.items())
    ]
    every = [law for own in by_file.values() for law in own]
    rows.append(["**together**", str(len(every)), *_sums(every, "cases", "failures")])
    names = "\n".join(
        f"- {_words(name)} ({law['cases']:,} cases)"
        for name, law in content["laws"].items()
        if "test_laws" in name
    )
    return f"{table(['tests', 'properties', 'cases', 'failures'], rows)}\n\n{names}"


def _words(name: str) -> str:
    return name.partition("::test_")[2].replace("_", " ")


def _sums(rows: list[dict[str, int]], *keys: str) -> list[str]:
    return [f"{sum(row[key] for row in rows):,}" for key in keys]


def fuzzing() -> str:
    """Executions of each reader by the coverage-guided fuzzer."""
    content = result("fuzz.json")
    rows = [
        [
            reader, f"{own['executions']:,}", f"{own['edges']:,}", f"{own['read']:,}",
            f"{own['refused']:,}", str(len(own["failures"])), f"{own['slowest_s']:.2f} s",
            f"{own['greatest_growth_mib']:.0f} MiB",
        ]
        for reader, own in content["readers"].items()
    ]  # fmt: skip
    head = ["reader", "files", "edges", "read", "refused", "failures", "slowest", "most memory"]
    return table(head, rows)


def faults() -> str:
    """Kills, and what was left."""
    content = result("faults.json")
    rows = [
        [
            own["kind"], str(own["kills"]), str(own["while_writing"]), f"{own['whole_files']:,}",
            str(own["finished"]), str(len(own["failures"])),
        ]
        for own in content["kinds"]
    ]  # fmt: skip
    head = ["work", "kills", "while a file was half written", "whole files", "resumed", "failures"]
    return table(head, rows)


def soak() -> str:
    """Long lives of the online filter."""
    content = result("soak.json")
    rows = []
    for form, name in (("blocks", "blocks"), ("single", "single samples"), ("event", "event form")):
        for own in content[form]["rows"]:
            steps = own.get("checkpoints") or own["runs"]
            drift = max(
                step.get("worst_drift_so_far", step.get("drift_in_parts_of_the_range", 0.0))
                for step in steps
            )
            samples = own.get("samples", steps[-1]["samples"])
            growth = "—"
            if "checkpoints" in own:
                memory = {step["samples"]: step["memory_mib"] for step in steps}
                grown = steps[-1]["memory_mib"] - memory[100_000]
                growth = f"{grown:.1f} MiB" if grown > 0 else "no growth"
            rows.append(
                [name, own["hysteron"], own["precision"], f"{samples:,}", f"{drift:.1e}", growth]
            )
    hours = sum(content[form]["hours"] for form in ("blocks", "single", "event", "faults"))
    bad = content["faults"]["rows"]
    head = ["form", "hysterons", "precision", "samples", "greatest drift of ẑ", "memory since 10⁵"]
    finite = sum(row["finite"] for row in bad)
    return (
        f"{table(head, rows)}\n\n{hours:.1f} hours in all. Of {len(bad)} runs with a faulty sensor "
        f"(lost, stuck, reversed, saturated, spikes of 10⁶ σ), the weights and the output stayed "
        f"finite in {finite}."
    )


def corruption() -> str:
    """Verdicts on spoiled records."""
    content = result("corruption.json")
    counts = {
        "cases (reporting seeds)": "cases",
        "verdict changed": "verdict_changed",
        "names of effects changed": "names_changed",
        "verdict or names changed": "changed",
        "of them neither verdict had said that it was close": "changed_and_not_close",
        "held-out error changed by more than 10 %": "error_changed_by_more_than_a_tenth",
        "outputs left out of the records before they were spoiled": "left_out_of_clean_records",
    }
    rows = [[text, str(content[key])] for text, key in counts.items()]
    for which in ("median", "greatest"):
        change = 100 * content[f"error_change_{which}"]
        rows.append([f"change of the error, {which}", f"{change:+.1f} %"])
    return table([f"spikes: {content['spikes']}; lost: {content['lost']}", ""], rows)


def versions() -> str:
    """Environments in which the package was installed and used."""
    rows = []
    for own in result("versions.json")["outcomes"]:
        kind = own["environment"]
        packages = "oldest allowed" if kind["resolution"].startswith("lowest") else "newest"
        found = own["versions"]
        rows.append(
            [
                kind["python"], f"{packages} (jax {found['jax']}, numpy {found['numpy']})",
                kind["artefact"], own["tests"] or "smoke test", own["failed"] or "passed",
            ]
        )  # fmt: skip
    return table(["Python", "packages", "from", "tests", "outcome"], rows)


def page() -> str:
    """The page in Markdown."""
    return f"""{HEAD}
## Laws

Properties that Hypothesis draws cases for: of Preisach operators, records, models, fits, of the
filter under bad samples, and of what is read and written.

{laws()}

## Damaged files

A coverage-guided fuzzer (Atheris) with structure-aware damage. Each file of at most 1 MB must be
read, or refused with a message, within 2 s and 1 GiB. What it found is mended, and each case is a
test (`tests/test_found_by_fuzzing.py`).

{fuzzing()}

## Faults

The program is killed (SIGKILL) at random moments. Every file that exists must then be whole, and
resumed work must equal undisturbed work to the last bit.

{faults()}

Full disks, folders that cannot be written or vanish, files that change while they are read, and
clocks that jump are tests (`tests/test_faults.py`).

## A long life

The drift is the difference of the output that the filter carries along from a fresh sum of weights
times states, as a share of the output's range.

{soak()}

## Spoiled records

Records of the [blind benchmark](scores.md), four seconds long, diagnosed on 13 levels as they are
and spoiled. Losing samples takes information away, and where the evidence lies close to a threshold
the diagnosis may differ without a spike; such a verdict says that it is close.

{corruption()}

## Versions

{versions()}

The oldest environment ran on a machine under load; what failed there are a count of compilations
that needs a function of later versions (skipped there since) and limits of five seconds.

## Units, threads, devices

Volts or microvolts, metres or nanometres, days or microseconds change neither a verdict nor the fit
by a millionth of a per cent point; one thread or many, by a ten-millionth
(`tests/test_scales_and_threads.py`). On one machine a result repeats to the last bit. A GPU adds in
another order, and its results are compared with those of the processor to a tolerance.
"""
