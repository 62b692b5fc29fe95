"""Measure what one sample costs `OnlineInverse`, from Python.

    python benchmarks/inverse.py

writes `benchmarks/results/inverse.json` with device, versions and date.  A smooth course at 2 kHz
is followed sample by sample, in double precision, by one thread that is pinned to one core; once by
itself, and once with the reading of a sensor beside it, from which the inverse learns.  The times
are those of single calls; the first call, which may compile, is told apart.
"""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
from common import latency, one_core, write_results

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "tests"))
from exported import HIGH, LOW, drawn, predicted, smooth

import preisach_jax as pj

LEVELS, RATE_HZ, SAMPLES = (9, 19, 37), 2000.0, 5000
CHAINS: dict[str, list[str]] = {
    "hysteresis": [],
    "with creep and an amplifier's lag": ["creep", "input_lag"],
    "with creep, rate dependence and a resonance": ["creep", "rate_corners_all", "resonance"],
}


def main() -> None:
    """Measure, print, and write the figures."""
    with one_core():
        write_results("inverse.json", {"rate_hz": RATE_HZ, "rows": measure()})


def measure() -> list[dict]:
    """A row for every chain, plane, and with or without learning."""
    rows = []
    for name, effects in CHAINS.items():
        for levels in LEVELS:
            model = drawn(effects, 1, levels)
            z = predicted(model, smooth(SAMPLES, 3, LOW + 2, HIGH - 2)).tolist()
            for learns in (False, True):
                inverse = pj.OnlineInverse(model, rate_hz=RATE_HZ, limits=(LOW, HIGH))

                def drive(wanted: float, measured: float, own=inverse, reads=learns) -> float:
                    return own(wanted, measured=measured) if reads else own(wanted)

                readings = [z[0], *z[:-1]]
                noisy = (np.asarray(readings) + 1e-3 * np.sin(np.arange(SAMPLES))).tolist()
                found = latency(drive, z, noisy)
                row = {"name": name, "effects": effects, "levels": levels, "learns": learns}
                rows.append(row | found)
                print(name, levels, "learns" if learns else "", found, flush=True)
    return rows


if __name__ == "__main__":
    main()
