"""Columns of simulated records as files."""

from __future__ import annotations

import csv
from collections.abc import Mapping
from pathlib import Path

import numpy as np


def save_columns(path: str | Path, columns: Mapping[str, np.ndarray]) -> None:
    """Write columns, (time,) each, comma-separated under their names, with ten digits."""
    texts = [[f"{value:.10g}" for value in column.tolist()] for column in columns.values()]
    with Path(path).open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(columns)
        writer.writerows(zip(*texts, strict=True))
