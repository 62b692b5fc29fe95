"""From a file that people keep to a verdict, in the page and on the command line.

    python benchmarks/doors.py [FILE ...]

opens the files of `tests/files` that hold a record as a new user does, with no option: how many
questions were asked, what was said, and the seconds.  A question is answered by the command that it
offers, and in the page by its first loop.  Writes `benchmarks/results/doors.json`.
"""

from __future__ import annotations

import shlex
import shutil
import subprocess
import sys
import tempfile
import time
from pathlib import Path

from common import write_results

TESTS = Path(__file__).parent.parent / "tests"
sys.path.append(str(TESTS))
PATIENCE_MS = 300_000


def on_command_line(path: Path) -> dict:
    """`preisach diagnose FILE`, then the command that a question offers."""
    words, questions, begun = ["diagnose", str(path)], 0, time.perf_counter()
    while True:
        command = [sys.executable, "-m", "preisach_jax", *words, "--quiet"]
        done = subprocess.run(command, capture_output=True, text=True, check=False)
        _, asked, offered = done.stderr.strip().rpartition("as in: preisach ")
        if done.returncode != 2 or not asked or questions == 2:
            break
        questions, words = questions + 1, shlex.split(offered)
    said = (done.stdout + done.stderr).strip().splitlines()
    seconds = round(time.perf_counter() - begun, 1)
    return {"questions": questions, "seconds": seconds, "said": said[0] if said else ""}


def in_page(page, path: Path) -> dict:
    """Drop the file, press the first loop where that is asked, and "Find it for me"."""
    begun, questions = time.perf_counter(), 0
    page.locator("input[type=file]").first.set_input_files(path)
    fitted, asked = (
        page.locator("ol.ladder li").first,
        page.get_by_text("press the loop that is right"),
    )
    fitted.or_(asked).first.wait_for()
    if asked.count() and asked.first.is_visible():
        questions = 1
        page.get_by_role("button", name="→").first.click()
        fitted.wait_for()
    shown = round(time.perf_counter() - begun, 1)
    find = page.get_by_role("button", name="Find it for me", exact=True)
    find.click()
    page.locator(".verdict b").first.wait_for()
    cancel = page.get_by_role("button", name="Cancel", exact=True)
    for awaited in (True, False):  # the search begins, and ends
        while cancel.is_enabled() is not awaited:
            time.sleep(0.1)
    said = " ".join(page.locator(".verdict").inner_text().split())
    seconds = round(time.perf_counter() - begun, 1)
    return {"questions": questions, "fitted_s": shown, "seconds": seconds, "said": said}


def main() -> None:
    from browser import FLAGS, NAMES, served
    from playwright.sync_api import sync_playwright

    files = [Path(each) for each in sys.argv[1:]]
    files = files or [p for p in sorted((TESTS / "files").iterdir()) if "trap" not in p.name]
    chromium = next(filter(None, map(shutil.which, NAMES)))
    rows = []
    with tempfile.TemporaryDirectory() as folder, sync_playwright() as driver:
        browser = driver.chromium.launch(executable_path=chromium, args=FLAGS)
        with served(folder=folder) as address:
            for path in files:
                page = browser.new_page(viewport={"width": 1280, "height": 800})
                page.set_default_timeout(PATIENCE_MS)
                page.goto(address)
                page.get_by_role("button", name="Find it for me", exact=True).wait_for()
                row = {
                    "file": path.name,
                    "command": on_command_line(path),
                    "page": in_page(page, path),
                }
                page.close()
                rows.append(row)
                print(row, flush=True)
        browser.close()
    write_results("doors.json", {"rows": rows})


if __name__ == "__main__":
    main()
