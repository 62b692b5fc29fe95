"""The page of the blind scores, from the results that lie in `benchmarks/results`."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path
from typing import Any

from blind.rates import WAYS, is_exact, is_in_family, is_visible, short, summary_of
from blind.results import read_results

RESULTS = Path(__file__).resolve().parent.parent / "benchmarks" / "results"
Result = dict[str, Any]

MOST_OVER = 2.0
"""Times the error of the true effects from which on right names do not make a case right."""

SUITES = {"single": "one effect hidden", "pairs": "two hidden", "triples": "three hidden"}
WAY_NAMES = {
    "diagnose": "the diagnosis",
    "criterion": "whitened criterion alone",
    "held_out": "least held-out error alone",
    "correlation": "correlation of the residual with simple signatures",
}

HEAD = """# Blind scores

*Every number on this page is computed from the committed results when the site is built
(`benchmarks/results/blind*/results.jsonl`, `benchmarks/results/measured.json`).*

## How they were made

`python benchmarks/blind/run.py --out DIR` hides known effects, pairs, triples, nothing, and effects
that the library does not have, in stages simulated by independent code: generalised plays with a
history that nobody recorded, on a raster several times finer than the record's, with coloured noise
and a converter. No code is shared with the models. The diagnosis gets the record and nothing else.
Three simpler ways to name an effect are judged on the same records.

The seeds are not those on which the library is developed. But what an early sample got wrong did
lead to changes of the library, so that a case that was diagnosed again is no longer quite blind.

The samples were drawn one after another, while the library changed. Each tells of the state in
which it was drawn; the last one is nearest to the present state. **Some cases of a later sample are
cases of an earlier one, diagnosed again, so the columns must not be added up.** No sample is large:
an interval in brackets (Clopper and Pearson, 95 %) says how little a count proves. One case takes
minutes; the whole benchmark has some thousands of cases, and has not been run.
"""


def samples() -> dict[str, list[Result]]:
    """The cases of each sample, by its folder, in the order in which they were finished."""
    found = {folder.name: read_results(folder) for folder in RESULTS.glob("blind*")}
    kept = {name: rows for name, rows in found.items() if rows}
    return dict(sorted(kept.items(), key=lambda item: item[1][-1]["finished"]))


def table(head: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    """A table in Markdown."""
    lines = [head, ["---"] * len(head), *rows]
    return "\n".join("| " + " | ".join(cells) + " |" for cells in lines)


def share(hits: dict[str, float]) -> str:
    """A count with its interval in words; empty if there is no case."""
    if not hits["of"]:
        return ""
    low, high = 100 * hits["low"], 100 * hits["high"]
    interval = f"<span class='nowrap'>[{low:.0f}–{high:.0f} %]</span>"
    return f"{hits['count']:.0f} of {hits['of']:.0f}<br>{interval}"


def overview(drawn: dict[str, list[Result]]) -> str:
    """Rates of each sample."""
    parts = [summary_of(rows) for rows in drawn.values()]
    rows: list[tuple[str, Callable[[dict[str, Any]], str]]] = [
        ("cases (failed)", lambda part: f"{part['cases']} ({part['failed']})"),
    ]
    for suite, name in SUITES.items():
        rows += [
            (f"{name}: all named and nothing else", lambda p, s=suite: share(p["exact"][s])),
            (
                f"{name}: the same, where the true effect lowers the held-out error at all",
                lambda p, s=suite: share(p["exact_where_visible"][s]),
            ),
            (
                f"{name}: a name that is not there",
                lambda p, s=suite: share(p["wrong_name"][s]),
            ),
        ]
    rows += [
        (
            f"nothing hidden, something named: {WAY_NAMES[way]}",
            lambda p, w=way: share(p["false_alarms"][w]),
        )
        for way in WAYS
    ]
    rows += [
        (
            f"one hidden, first name right: {WAY_NAMES[way]}",
            lambda p, w=way: share(p["first_name_right"][w]),
        )
        for way in WAYS
    ]
    rows += [
        ("outside the library: admitted as unexplained", lambda p: share(p["admitted_outside"])),
        ("outside the library: something named", lambda p: share(p["wrong_name_outside"])),
        ("95 % intervals that hold the truth", lambda p: share(p["coverage"])),
        ("held-out error over that of the true effects, median", _over_oracle),
        ("seconds a diagnosis, median", lambda p: f"{p['seconds']['median']:.0f}"),
    ]
    head = ["", *numbers(drawn)]
    return table(head, [[name, *(cell(part) for part in parts)] for name, cell in rows])


def which(drawn: dict[str, list[Result]]) -> str:
    """What each sample is."""
    rows = []
    for number, (name, own) in enumerate(drawn.items(), start=1):
        kinds = [row["excitation"] for row in own]
        rows.append(
            [
                str(number),
                f"`benchmarks/results/{name}`",
                own[-1]["finished"][:10],
                ", ".join(sorted({row["commit"][:7] for row in own})),
                str(len(own)),
                ", ".join(f"{kinds.count(kind)} {kind}" for kind in sorted(set(kinds))),
            ]
        )
    return table(["sample", "results", "finished", "commit", "cases", "excitation"], rows)


def numbers(drawn: dict[str, list[Result]]) -> list[str]:
    """What the columns of the samples are called."""
    return [f"sample {number}" for number in range(1, len(drawn) + 1)]


def _over_oracle(part: dict[str, Any]) -> str:
    row = part["over_oracle"]
    return f"{row['median']:.2f}" if row["cases"] else ""


def by_effect(drawn: dict[str, list[Result]]) -> str:
    """What was said of each effect that was hidden alone."""
    rows = []
    everything = [row for own in drawn.values() for row in own]
    alone = [row for row in everything if row["suite"] in ("single", "outside")]
    known = sorted({(not _inside(row), short(row["hidden"][0])) for row in alone})
    for outside, name in known:
        cells = []
        for own in drawn.values():
            mine = [
                row
                for row in own
                if row["suite"] in ("single", "outside")
                and short(row["hidden"][0]) == name
                and _inside(row) != outside
            ]
            cells.append("; ".join(map(said, mine)))
        rows.append([name + (" (not in the library)" if outside else ""), *cells])
    return table(["hidden", *numbers(drawn)], rows)


def _inside(row: Result) -> bool:
    return bool(row["in_library"])


def said(row: Result) -> str:
    """What the diagnosis said of a case, in a few words."""
    names = " + ".join(short(name) for name in row["effects"])
    if row["hidden"] and is_exact(row):
        return "right"
    return f"**{row['verdict']}**" + (f": {names}" if names else "")


def failures(drawn: dict[str, list[Result]]) -> str:
    """Every case that was not right, with its errors."""
    rows = []
    for number, own in enumerate(drawn.values(), start=1):
        for row in own:
            if right(row):
                continue
            held = row["held_out"]
            hidden = " + ".join(row["hidden"]) or f"nothing ({row['circumstances']['nothing']})"
            rows.append(
                [
                    str(number),
                    hidden + ("" if _inside(row) or not row["hidden"] else " (not in the library)"),
                    f"{row['verdict']}: {' + '.join(row['effects'])}".rstrip(": "),
                    f"{1e3 * held['base']:.3g}",
                    f"{1e3 * held['final']:.3g}",
                    f"{1e3 * held['oracle']:.3g}",
                    row["oracle_is"],
                ]
            )
    head = ["sample", "hidden", "said", "without effects", "final", "what could be reached"]
    return table([*head, "which is"], rows)


def right(row: Result) -> bool:
    """Whether the right names were given, or none where nothing or nothing known is hidden."""
    if not row["hidden"]:
        return row["verdict"] == "adequate"
    if _inside(row):
        # Names that are right beside a verdict that something remains are right.
        return is_exact(row) and row["held_out"]["final"] < MOST_OVER * row["held_out"]["oracle"]
    return not row["effects"] and row["verdict"] == "unexplained"


def measured() -> str:
    """The measured records: what was expected, what was said, and what baselines reach."""
    content = json.loads((RESULTS / "measured.json").read_text(encoding="utf-8"))
    ways = list(content["records"][0]["baselines_percent_of_stroke"])
    rows = []
    for record in content["records"]:
        first, last = record["ladder"][0], record["ladder"][-1]
        names = "; ".join(" or ".join(family) for family in record["families"])
        error = f"{first['percent_of_stroke']:.3g}"
        if last is not first:
            error += f" → {last['percent_of_stroke']:.3g}"
        reached = record["baselines_percent_of_stroke"]
        rows.append(
            [
                f"`{record['file']}`<br>{record['source']}",
                record["physicist"],
                f"{record['outcome']}: *{record['verdict'].replace('_', ' ')}*"
                + (f" ({names})" if names else ""),
                error,
                *(_reached(reached, way) for way in ways),
            ]
        )
    head = ["record", "what a physicist expects", "said", "held-out error, % of range", *ways]
    return table(head, rows)


def _reached(percent: dict[str, float | None], way: str) -> str:
    """The error of a baseline; empty if it was not run."""
    if way not in percent:
        return ""
    error = percent[way]
    return "diverges" if error is None else f"{error:.3g}"


def page() -> str:
    """The page in Markdown."""
    drawn = samples()
    absorbed = [
        row
        for rows in drawn.values()
        for row in rows
        if row["suite"] == "single" and _inside(row) and not is_visible(row)
    ]
    family = sum(
        is_in_family(row) for rows in drawn.values() for row in rows if row["suite"] == "single"
    )
    exact = sum(
        is_exact(row) for rows in drawn.values() for row in rows if row["suite"] == "single"
    )
    return f"""{HEAD}
{which(drawn)}

*Rich* excitation has ramps at several rates, holds and minor loops; *poor* is what many records
are.

## Rates

{overview(drawn)}

Counting a name as right when the truth is in its family changes {family - exact} of the singles.
In {len(absorbed)} singles the model with the true effect lowers the held-out mean square by less
than 5 %, so that the record shows nothing of it, though the machine has the effect.

The simpler ways give the right name about as often where an effect *is* hidden. What the two tests
are for stands in the rows of records with nothing hidden.

## What was said of each effect that was hidden alone

{by_effect(drawn)}

## Every case that was not right

Held-out errors in nanometres. For effects within the library, what could be reached is the error of
the library's own model with the true effects; else the noise.

{failures(drawn)}

What they teach:

- **Feedback (`moving`), the steps of a sensor and faint bends of it are called adequate.** They
  hardly change the error: free weights absorb them. The table of limits in each report says how
  great they could be.
- **Stages of some dozens of relays or of narrow ridges** are called unexplained though nothing is
  hidden, because no plane of 50 levels holds them.
- **Rate dependence was named beside ageing** in two samples (the same record); the held-out test is
  asked on all rows since, and the strength of the prior is compared.
- **A hum of a frequency wrong by 0.07 Hz** passed as *explained* although its error was 32 times
  that of the true effects: the verdict does not see that, where what it leaves looks like noise.
- **A resonance and a drift hid each other** and stayed unexplained.
- **A sensor that jumps, and a gain that wanders, were called drift or ageing**: names of the
  library that come nearest to what it does not have. Such slow waves must leave little unexplained
  since.
- **Backlash is called adequate**: it is a play, which the density represents.

## Measured records

Expectations were written before the run (`benchmarks/measured/expectations.toml`): *right* is every
required name, none that is not allowed, and a fitting verdict; *wrong* a name that is not there;
*missed* the rest. The baselines simulate the same held-out rows from the inputs alone
(`benchmarks/measured/baselines.py` says how each is fitted).

{measured()}
"""
