"""Measure how long a person waits in the interactive page: first fit, ranking, adding, a brush.

    python benchmarks/run.py page

drives a Chromium without a window as `tests/test_app_browser.py` does, on stages of 27,000 and of
100,000 samples that hide creep and a delay, and writes `benchmarks/results/page.json`.  The first
stage meets a server that has just started and has compiled nothing; the second pass over it has.  A
brush is timed from the release of the mouse to the next frame that shows all views, many times.
"""

from __future__ import annotations

import shutil
import sys
import tempfile
import time
from pathlib import Path

import numpy as np
from conditions import write_results

from preisach_jax.plant import simulate_stage

sys.path.append(str(Path(__file__).parents[1] / "tests"))

STAGES = {"27000": (20.0, 1350.0), "100000": (50.0, 2000.0)}
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


def seconds_until(action, shown) -> float:
    """From an action to what it makes visible."""
    begun = time.perf_counter()
    action()
    shown.wait_for()
    return time.perf_counter() - begun


def button(page, name):
    """A button by its text."""
    return page.get_by_role("button", name=name, exact=True)


def walk_through(page, path: Path, longest_s: float) -> dict[str, float]:
    """Drop a file, fit, rank, add the first effect, brush; the seconds of each."""
    dropped = seconds_until(
        lambda: page.locator("input[type=file]").set_input_files(path),
        button(page, "Use these columns"),
    )
    shown = seconds_until(
        button(page, "Use these columns").click, page.get_by_text("Press Fit").first
    )
    fitted = seconds_until(button(page, "Fit").click, page.get_by_text("Drag over any view"))
    ranked = seconds_until(lambda: None, page.locator(".mark").first)
    name = page.locator(".candidate b").first.inner_text()
    added = seconds_until(button(page, "Add").first.click, page.get_by_text(f"+ {name}"))
    rng = np.random.default_rng(0)
    brushes = []
    for begin in rng.uniform(0, 0.8 * longest_s, BRUSHES):
        span = ["Time", float(begin), float(begin + 0.15 * longest_s)]
        brushes.append(page.evaluate(TIMED_BRUSH, span))
    return {
        "drop_to_columns_s": dropped,
        "columns_to_record_s": shown,
        "fit_s": fitted,
        "drop_to_first_fit_s": dropped + shown + fitted,
        "ranking_s": ranked,
        "add_s": added,
        "brush_median_ms": float(np.median(brushes)),
        "brush_worst_ms": float(np.max(brushes)),
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
            for name, label in (("27000", "cold"), ("27000", "warm"), ("100000", "warm")):
                page = browser.new_page(viewport={"width": 1280, "height": 800})
                page.set_default_timeout(PATIENCE_MS)
                page.goto(address)
                button(page, "Fit").wait_for()
                rows[f"{name} samples, {label}"] = walk_through(
                    page, files[name], STAGES[name][0]
                )  # fmt: skip
                page.close()
        browser.close()
    for name, row in rows.items():
        print(name, {key: round(value, 2) for key, value in row.items()})
    write_results("page.json", {"server_start_s": start, "rows": rows})


if __name__ == "__main__":
    main()
