"""What must work wherever the package is installed: `python smoke.py FOLDER`, which is empty.

It imports the installed package alone, and ends by an assertion where something fails.
"""

from __future__ import annotations

import json
import subprocess
import sys
from importlib.metadata import version
from pathlib import Path

import jax
import numpy as np

import preisach_jax as pj


def fit_and_predict(folder: Path) -> None:
    """A record with a drift is fitted, saved, loaded and predicted."""
    t = np.arange(1500) / 100
    u = 5 - 5 * np.cos(t * (1 + t / 15))
    z = u**1.1 + 0.3 * np.exp(-0.5 * t)  # a drift, so that there is something to be found
    rows = ["t_s,u_V,z_um", *(f"{a:.2f},{b:.6f},{c:.6f}" for a, b, c in zip(t, u, z, strict=True))]
    (folder / "stage.csv").write_text("\n".join(rows) + "\n")
    record = pj.Record.load(folder / "stage.csv")
    fitted = pj.fit(record, effects=("drift",), levels=9)
    fitted.model.save(folder / "model.json")
    loaded = pj.Model.load(folder / "model.json")
    np.testing.assert_array_equal(
        loaded.predict(record).output, fitted.model.predict(record).output
    )
    assert fitted.fit_percent > 90, fitted.fit_percent


def filter_online(folder: Path) -> None:
    """The online filter goes on from its file, in both precisions."""
    for precision in ("float32", "float64"):
        with jax.enable_x64(precision == "float64"):
            x = np.asarray(5 + 5 * np.sin(np.arange(400) / 9) * np.cos(np.arange(400) / 41))
            x, z = x.astype(precision), (3 * x).astype(precision)
            online = pj.OnlineFilter(pj.AdaptiveFilter(pj.Plane(levels=9, low=0.0, high=10.0)))
            online.block(x[:200], z[:200])
            online.save(folder / f"{precision}.npz")
            again = pj.OnlineFilter.load(folder / f"{precision}.npz")
            after = online.block(x[200:], z[200:]), again.block(x[200:], z[200:])
            assert after[0].dtype == precision
            np.testing.assert_array_equal(*after)


def sweep(folder: Path) -> None:
    """A sweep of two levels is saved and read."""
    found = pj.sweep(jax.random.key(0), levels=(5, 3), noise=(0.1, 1.0), seeds=2, samples=2000)
    found.save(folder / "sweep.npz")
    np.testing.assert_array_equal(pj.Sweep.load(folder / "sweep.npz").events, found.events)


def command_line(folder: Path) -> None:
    """`preisach` says its version, and writes a report."""

    def run(*words: str) -> str:
        command = [str(Path(sys.executable).with_name("preisach")), *words]
        done = subprocess.run(command, cwd=folder, capture_output=True, text=True, check=False)
        assert done.returncode == 0, done.stderr
        return done.stdout

    assert run("--version") == f"preisach {version('preisach_jax')}\n"
    run("diagnose", "stage.csv", "--effects", "creep,drift", "--levels", "9", "--report", "report")
    assert json.loads((folder / "report/diagnosis.json").read_text())["ladder"]
    assert (folder / "report/report.html").read_text().rstrip().endswith("</html>")


def main() -> None:
    """Try everything in the folder that was named."""
    folder = Path(sys.argv[1])
    assert not list(folder.iterdir()), f"{folder} is not empty"
    for part in (fit_and_predict, filter_online, sweep, command_line):
        part(folder)
        print(part.__name__, "works")


if __name__ == "__main__":
    main()
