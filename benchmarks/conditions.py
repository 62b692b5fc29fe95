"""Where and when something was measured, and its results as a JSON file."""

from __future__ import annotations

import json
import os
import platform
from datetime import date
from importlib.metadata import version
from pathlib import Path

import jax
import numpy as np

RESULTS = Path(__file__).parent / "results"


def write_results(name: str, content: dict) -> Path:
    """Write measured figures with device, versions and date into `benchmarks/results`."""
    conditions = {
        "date": date.today().isoformat(),
        "device": f"{platform.machine()} {jax.devices()[0].device_kind}, {os.cpu_count()} cores, "
        f"{platform.system()}",
        "backend": jax.default_backend(),
        "python": platform.python_version(),
        "versions": {
            package: version(package)
            for package in ("preisach_jax", "jax", "jaxlib", "numpy", "scipy", "equinox")
        },
        "load_average_at_end": os.getloadavg(),
    }
    RESULTS.mkdir(parents=True, exist_ok=True)
    path = RESULTS / name
    text = json.dumps(conditions | content, indent=1, default=np.ndarray.tolist)
    path.write_text(text + "\n")
    print(f"written to {path}")
    return path
