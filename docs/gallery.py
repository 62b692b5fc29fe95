"""The page of measured records, and its pictures: `PYTHONPATH=benchmarks python docs/gallery.py
FOLDER`.

FOLDER holds the records, which are no part of the project; `benchmarks/measured/expectations.toml`
names their sources and licences.
"""

from __future__ import annotations

import json
import sys
import tomllib
from pathlib import Path
from typing import Any

import matplotlib as mpl
import numpy as np
from matplotlib.figure import Figure
from provenance import RESULTS
from scores import table

import preisach_jax as pj
from preisach_jax.plot.axes import with_unit
from preisach_jax.plot.style import AFTER, STYLE
from preisach_jax.quantity import scaled

HERE = Path(__file__).resolve().parent
OUT = HERE / "assets" / "gallery"
EXPECTED = HERE.parent / "benchmarks" / "measured" / "expectations.toml"
MOST_POINTS = 12_000

TITLES = {
    "mrdamper_mts_5mm3Hz.csv": "Magnetorheological damper, 3 Hz, five coil currents",
    "mrdamper_mts_25mm0x5Hz.csv": "The same damper, 0.5 Hz",
    "faster_beam_force_disp.csv": "Beam, driven at random",
    "fsm_piezo_300mV.csv": "Fast piezo mirror, multisine on three axes",
    "forc_feco_nanowire.csv": "Reversal curves of FeCo nanowires",
    "forc_agm_pmagpy.csv": "Reversal curves of a rock sample",
}
"""The records that were measured, in the order of the page."""

HEAD = """# Gallery of measured records

*What the diagnosis says of records that others have measured and published. What a physicist
expects was written down before the run; tables and sentences are read from
`benchmarks/results/measured.json` when the site is built. Errors are those of held-out rows, in per
cent of the stroke; ARX, NARX, Prandtl-Ishlinskii and the velocity model saw the same rows. Where it
went wrong, it says so.*
"""

OUTCOMES = {
    "right": "as expected",
    "partly": "partly as expected",
    "missed": "not what was expected: something was missed",
    "wrong": "not what was expected: a name too many or another one",
}


def page() -> str:
    """The page in Markdown."""
    content: dict[str, Any] = json.loads((RESULTS / "measured.json").read_text(encoding="utf-8"))
    found = {row["file"]: row for row in content["records"]}
    parts = [HEAD]
    parts += [_entry(found[file], title) for file, title in TITLES.items() if file in found]
    parts.append(
        "To see one of your own like this: `preisach look FILE`, then `preisach diagnose FILE`; "
        "what the verdicts mean is on [Method](method/index.md), what was measured of the program "
        "itself on [What was measured](method/measurements.md).\n"
    )
    return "\n".join(parts)


def _entry(row: dict[str, Any], title: str) -> str:
    name = row["file"]
    rows = [
        ["Preisach model" + "".join(f" + {e}" for e in rung["effects"]), _percent(rung)]
        for rung in row["ladder"]
    ]
    rows += [
        [name, "not run" if value is None else f"{value:.2g}"]
        for name, value in row["baselines_percent_of_stroke"].items()
    ]
    columns = " ".join(f"--aux {each}" for each in _expectation(name)["aux"])
    units = " ".join(f"--unit {k}={u}" for k, u in _expectation(name)["units"].items())
    command = f"preisach diagnose {name} --input x --output z {columns} {units}".replace("  ", " ")
    return f"""## {title}

![Loop and output over time of {name}](assets/gallery/{Path(name).stem}.png)

{row["samples"]:,} rows; {row["source"]}.

**Expected:** {row["physicist"]}.

**Said** ({OUTCOMES.get(row["outcome"], row["outcome"])}): {row["sentence"]}

{table(["model", "error, % of stroke"], rows)}

```sh
{command}
```
"""


def _percent(rung: dict[str, Any]) -> str:
    return f"{rung['percent_of_stroke']:.2g}"


def _expectation(file: str) -> dict[str, Any]:
    records = tomllib.loads(EXPECTED.read_text(encoding="utf-8"))["record"]
    return next(each for each in records if each["file"] == file)


@mpl.rc_context(STYLE)
def draw(path: Path) -> Figure:
    """The loop of a record, and its output over time."""
    expected = _expectation(path.name)
    units = {"input": expected["units"]["x"], "output": expected["units"]["z"]}
    record = pj.Record.load(
        path, time="t", input="x", output="z", aux=tuple(expected["aux"]), units=units
    )
    figure = Figure(figsize=(8.2, 3.3), layout="constrained")
    loop, course = figure.subplots(1, 2, width_ratios=[1, 1.25])
    across, in_unit = scaled(float(np.abs(record.input).max()), record.input_unit)
    up, out_unit = scaled(float(np.nanmax(np.abs(record.output))), record.output_unit)
    step = slice(None, None, max(len(record) // MOST_POINTS, 1))
    current = next((values for name, values in record.aux.items() if name.endswith("_A")), None)
    points: dict[str, Any] = {"s": 1.2, "lw": 0, "rasterized": True}
    u, z = across * record.input[step], up * record.output[step]
    if current is None:
        loop.scatter(u, z, color=AFTER, **points)
    else:
        shown = loop.scatter(u, z, c=current[step], cmap="viridis", **points)
        figure.colorbar(shown, ax=loop, label="coil current (A)")
    loop.set_xlabel(with_unit("input", in_unit))
    loop.set_ylabel(with_unit("output", out_unit))
    loop.set_title("Loop")
    course.plot(record.time[step], z, color=AFTER, lw=0.4)
    course.set_xlabel("time (s)")
    course.set_ylabel(with_unit("output", out_unit))
    course.set_title("Output over time")
    course.margins(x=0.01)
    return figure


if __name__ == "__main__":
    from pictures import saved

    OUT.mkdir(exist_ok=True)
    for file in TITLES:
        where = saved(draw(Path(sys.argv[1]) / file), OUT / f"{Path(file).stem}.png")
        sys.stdout.write(f"{where}\n")
