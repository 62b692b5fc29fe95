"""The figures that the pages tell of the bundled record: python benchmarks/bundled.py

Errors of fits of the reversal curves that come with the package, over all rows and at the points to
which the instrument returned before each curve, in % of the range of the output.
"""

from __future__ import annotations

from importlib import import_module
from importlib.resources import files
from pathlib import Path

import numpy as np
from common import write_results

import preisach_jax as pj

OWN_EFFECT = Path(__file__).resolve().parents[1] / "docs" / "how-to" / "own-effect.md"


def fading() -> pj.WeightEffect:
    """The effect of the page on own effects, as its source stands there."""
    text = OWN_EFFECT.read_text(encoding="utf-8")
    source = next(block for block in text.split("```python\n") if "class Fading" in block)
    names = {"pj": pj, "__name__": "__main__"}
    exec(source.partition("```")[0], names)
    return names["Fading"]()


def main() -> None:
    """Fit, and write the errors."""
    record = pj.Record.load(files("preisach_jax") / "bundled" / "conventional_example.forc")
    again = np.flatnonzero(record.measured[1:] & ~record.measured[:-1]) + 1

    def percent(error: np.ndarray) -> float:
        return 100 * np.sqrt(np.nanmean(error**2)) / record.output_range

    def row(**options) -> dict:
        fit = pj.fit(record, **options)
        rate = fit.model.parameters.get("fading", {}).get("rate")
        return {
            "rms_percent": percent(fit.residual),
            "at_calibration_percent": percent(fit.residual[again]),
            "held_out": fit.rms_validation,
            "rate": rate and {"value": rate.value, "low": rate.low, "high": rate.high},
        }  # fmt: skip

    content = {
        "calibration_points": len(again),
        "seconds": record.duration_s,
        "last_over_first": record.output[again[-1]] / record.output[again[0]],
        "plain": row(),
        "levels_50": row(levels=50),
        "ageing": row(effects=("ageing",)),
        "fading": row(effects=(fading(),)),
        "drift": row(effects=("drift",)),
    }
    stepwise = import_module("preisach_jax.fit.stepwise")  # `preisach_jax.fit` is a function
    stepwise.MAX_SHARE_WITH_SPACING = 0.0  # so that unequal thresholds are never taken
    content["equal_cells"] = row()
    write_results("bundled.json", content)


if __name__ == "__main__":
    main()
