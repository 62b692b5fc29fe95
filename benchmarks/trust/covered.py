"""Sum up which lines and branches of the package its tests run.

    pip install pytest-cov
    pytest -n 2 --cov=preisach_jax --cov-branch --cov-report=json:covered.json
    python benchmarks/trust/covered.py covered.json

Writes the shares of each part of the package to `benchmarks/results/trust/coverage.json`.
"""

from __future__ import annotations

import json
import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from conditions import write_results


def shares(files: list[dict[str, int]]) -> dict[str, float | int]:
    """Lines and branches that were run, in per cent, and both together as `coverage` sums them."""
    lines, branches = (
        (sum(each[f"covered_{kind}"] for each in files), sum(each[f"num_{name}"] for each in files))
        for kind, name in (("lines", "statements"), ("branches", "branches"))
    )
    return {
        "lines": 100 * lines[0] / max(lines[1], 1),
        "branches": 100 * branches[0] / branches[1] if branches[1] else 100.0,
        "together": 100 * (lines[0] + branches[0]) / max(lines[1] + branches[1], 1),
        "statements": lines[1],
    }


def main() -> None:
    """Read what pytest-cov has written, and sum it up."""
    content = json.loads(Path(sys.argv[1]).read_text(encoding="utf-8"))
    parts: dict[str, list[dict[str, int]]] = {}
    for name, file in content["files"].items():
        inside = Path(name).parts
        inside = inside[inside.index("preisach_jax") + 1 :]
        part = inside[0] if len(inside) > 1 else "the modules beside"
        parts.setdefault(part, []).append(file["summary"])
    every = [file for files in parts.values() for file in files]
    least = sorted(
        (file["summary"]["percent_covered"], Path(name).name)
        for name, file in content["files"].items()
    )
    write_results(
        "trust/coverage.json",
        {
            "parts": {part: shares(files) for part, files in sorted(parts.items())},
            "whole": shares(every),
            "least": [f"{name}: {share:.0f} %" for share, name in least[:10]],
        },
    )


if __name__ == "__main__":
    main()
