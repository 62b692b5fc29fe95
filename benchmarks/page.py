"""Measure how long a person waits in the interactive page: first plot, fit, ranking, a brush.

    python benchmarks/page.py

drives a Chromium without a window as `tests/test_app_browser.py` does, on stages of 27,000, 100,000
and a million samples that hide creep and a delay, and writes `benchmarks/results/page.json`.  The
first stage meets a server that has just started and has compiled nothing; the second pass over it
has.  The first plot is timed from the drop of the file to the frame in which a canvas has the
pixels of a curve; a brush from the release of the mouse to the next frame that shows all views,
many times.  Beside the seconds on the wall stand those of all processors that the server and the
browser took together, as other programs may run.
"""

from __future__ import annotations

import os
import shutil
import sys
import tempfile
import time
from pathlib import Path

import numpy as np
from common import write_results

from preisach_jax.plant import simulate_stage

sys.path.append(str(Path(__file__).parents[1] / "tests"))

STAGES = {"27000": (20.0, 1350.0), "100000": (50.0, 2000.0), "1000000": (500.0, 2000.0)}
PASSES = (("27000", "cold"), ("27000", "warm"), ("100000", "warm"), ("1000000", "warm"))
RANKED = 200_000
"""Samples up to which the ranking and the first effect are timed, which take minutes beyond."""
PATIENCE_MS = 600_000
BRUSHES = 15

TIMED_BRUSH = """async ([title, x0, x1]) => {
  const models = [...Bokeh.documents.flatMap((d) => [...d._all_models.values()])]
  const figure = models.find((m) => m.type === "Figure" && m.js_event_callbacks.selectiongeometry
    && m.title.text.startsWith(title))
  const begun = performance.now()
  await figure.js_event_callbacks.selectiongeometry[0].execute(
    { final: true, geometry: { type: "rect", x0, x1, y0: -1e9, y1: 1e9 } })
  await new Promise((done) => requestAnimationFrame(() => requestAnimationFrame(done)))
  return performance.now() - begun
}"""


DRAWN = """() => {
  const curve = [0x8C, 0x8C, 0x8C]  // plot.style.MEASURED; labels have few pixels of that shade
  const has_curve = (canvas) => {
    if (!canvas.width || !canvas.height) return false
    const { data } = canvas.getContext("2d").getImageData(0, 0, canvas.width, canvas.height)
    let count = 0
    for (let k = 0; k < data.length; k += 4) {
      if (data[k] === curve[0] && data[k + 1] === curve[1] && data[k + 2] === curve[2]) count++
    }
    return count > 200
  }
  const found = (element) => element.tagName === "CANVAS" && has_curve(element)
    || [...(element.shadowRoot?.children ?? []), ...element.children].some(found)
  return found(document.body)
}"""


def cpu_s() -> float:
    """Processor seconds of all processes that this one has started and that still run."""
    stats = {}
    for path in Path("/proc").glob("[0-9]*/stat"):
        try:
            fields = path.read_text().rpartition(")")[2].split()
        except OSError:
            continue  # it has ended
        stats[int(path.parent.name)] = (int(fields[1]), int(fields[11]) + int(fields[12]))
    ours, total = {os.getpid()}, 0
    for process in sorted(stats):  # parents come first
        parent, ticks = stats[process]
        if parent in ours and process != os.getpid():
            ours.add(process)
            total += ticks
    return total / os.sysconf("SC_CLK_TCK")


def settle(longest_s: float = 120.0) -> None:
    """Wait until the server and the browser have nothing more to do."""
    end = time.monotonic() + longest_s
    before = cpu_s()
    while time.monotonic() < end:
        time.sleep(2)
        now = cpu_s()
        if abs(now - before) < 0.1:
            return
        before = now


def button(page, name):
    """A button by its text."""
    return page.get_by_role("button", name=name, exact=True)


def walk_through(page, path: Path, longest_s: float, is_ranked: bool) -> dict[str, float]:
    """Drop a file, let it be drawn and fitted, add the first effect, brush; the seconds of each."""
    settle()
    begun, spent = time.perf_counter(), cpu_s()
    seconds: dict[str, float] = {}

    def note(what: str) -> None:
        seconds[f"{what}_s"] = time.perf_counter() - begun
        seconds[f"{what}_cpu_s"] = cpu_s() - spent

    page.locator("input[type=file]").first.set_input_files(path)
    page.wait_for_function(DRAWN, polling="raf")
    note("drop_to_first_plot")
    page.locator(".facts").wait_for()
    note("drop_to_facts")
    page.get_by_text("Drag over any view").wait_for()
    note("drop_to_first_fit")
    if is_ranked:
        begun, spent = time.perf_counter(), cpu_s()
        page.locator(".mark").first.wait_for()
        note("ranking")
        name = page.locator(".candidate b").first.inner_text()
        begun, spent = time.perf_counter(), cpu_s()
        button(page, f"Add {name}").click()
        page.locator("ol.ladder").get_by_text(f"+ {name}").wait_for()
        note("add")
    button(page, "Cancel").click()
    settle()
    spent = cpu_s()
    rng = np.random.default_rng(0)
    brushes = []
    for begin in rng.uniform(0, 0.8 * longest_s, BRUSHES):
        span = ["Time", float(begin), float(begin + 0.15 * longest_s)]
        brushes.append(page.evaluate(TIMED_BRUSH, span))
    return {
        **seconds,
        "brush_median_ms": float(np.median(brushes)),
        "brush_worst_ms": float(np.max(brushes)),
        "brush_cpu_ms": 1e3 * (cpu_s() - spent) / BRUSHES,
    }


def main() -> None:
    """Measure, and write `page.json`."""
    from browser import FLAGS, NAMES, served
    from playwright.sync_api import sync_playwright

    chromium = next(filter(None, map(shutil.which, NAMES)), None)
    if chromium is None:
        print("page: no Chromium is installed, nothing is measured")
        return
    rows = {}
    with tempfile.TemporaryDirectory() as folder, sync_playwright() as driver:
        files = {}
        for name, (seconds, rate) in STAGES.items():
            files[name] = Path(folder) / f"stage{name}.csv"
            simulate_stage(3, seconds, ("creep", "delay"), rate).save(files[name])
        browser = driver.chromium.launch(executable_path=chromium, args=FLAGS)
        begun = time.perf_counter()
        with served(folder=folder) as address:
            start = time.perf_counter() - begun
            for name, label in PASSES:
                page = browser.new_page(viewport={"width": 1280, "height": 800})
                page.set_default_timeout(PATIENCE_MS)
                page.goto(address)
                button(page, "Find it for me").wait_for()
                rows[f"{name} samples, {label}"] = walk_through(
                    page, files[name], STAGES[name][0], int(name) <= RANKED
                )
                page.close()
        browser.close()
    for name, row in rows.items():
        print(name, {key: round(value, 2) for key, value in row.items()})
    write_results("page.json", {"server_start_s": start, "rows": rows})


if __name__ == "__main__":
    main()
