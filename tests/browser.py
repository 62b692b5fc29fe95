"""A page of the application, served by a process of its own, in a real browser without a window."""

import os
import re
import shutil
import subprocess
import sys
import time
from contextlib import contextmanager
from pathlib import Path

import pytest

FLAGS = (
    "--no-sandbox --disable-gpu --disable-quic --no-first-run --disable-background-networking "
    "--disable-component-update --disable-sync"
).split()
NAMES = ("chromium", "chromium-browser", "google-chrome", "google-chrome-stable", "chrome")
REQUIRED = "PREISACH_BROWSER_TESTS"
"""Environment variable; if it is `required`, a missing browser is a failure."""
SHOTS = "PREISACH_SCREENSHOTS"
"""Environment variable: a folder in which the pictures of the pages are kept."""


def browser_path():
    """Where a Chromium is installed; without one, the test is skipped, or fails if it must run."""
    named = os.environ.get("CHROMIUM", "")
    found = named or next(filter(None, map(shutil.which, NAMES)), None)
    if found:
        return found
    reason = f"no Chromium is installed (looked for {', '.join(NAMES)}, and for $CHROMIUM)"
    if os.environ.get(REQUIRED) == "required":
        pytest.fail(reason)
    pytest.skip(reason)


@contextmanager
def served(*arguments, folder, before=""):
    """The whole address of a page that `preisach app` serves, with its token.

    `before` is code that the server runs first.
    """
    code = f"{before}\nimport sys; from preisach_jax.cli import main; sys.exit(main())"
    words = [sys.executable, "-c", code, "app", "--no-browser", "--port", "0"]
    log = Path(folder) / "server.log"
    with log.open("wb") as told:
        process = subprocess.Popen([*words, *map(str, arguments)], stdout=told, stderr=told)
    try:
        yield told_address(process, log)
    finally:
        process.terminate()
        process.wait(timeout=30)


def told_address(process, log):
    for _ in range(3000):  # a machine may be busy
        assert process.poll() is None, log.read_text()
        if found := re.search(r"http://\S+ ", log.read_text()):
            return found[0].strip()
        time.sleep(0.1)
    raise AssertionError(f"the server told no address: {log.read_text()}")


def keep(page, name):
    """Keep a picture of a page, where pictures are asked for."""
    folder = os.environ.get(SHOTS)
    if folder:
        Path(folder).mkdir(parents=True, exist_ok=True)
        page.screenshot(path=str(Path(folder) / f"{name}.png"))
