"""What the data of all figures have in common."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, fields
from typing import Any, cast

import numpy as np

Progress = Callable[[str, float], None]
"""Called with what is being done and the part that is done."""

DIGITS = 7


@dataclass(frozen=True, eq=False)
class FigureData:
    """The numbers behind a figure: arrays as they are drawn, and what was fitted to them.

    Names end in the unit: `_v`, `_um`, `_um2` for µm², `_s`, `_hz`, `_db`, `_deg`; a part of
    something, a count and a name have none.
    """

    @property
    def caption(self) -> str:
        """What the figure shows, with the numbers that it shows it by."""
        raise NotImplementedError

    def to_json(self) -> dict[str, Any]:
        """The caption and all numbers, to seven digits, ready for JSON."""
        content = {field.name: getattr(self, field.name) for field in fields(self)}
        return {"caption": self.caption, **{name: _plain(v) for name, v in content.items()}}


def _plain(value: Any) -> Any:
    if hasattr(value, "_asdict"):
        value = value._asdict()
    if isinstance(value, Mapping):
        table = cast(Mapping[Any, Any], value)
        return {str(key): _plain(inner) for key, inner in table.items()}
    if isinstance(value, np.ndarray):
        return _plain(value.tolist())
    if isinstance(value, list | tuple):
        return [_plain(inner) for inner in cast(Iterable[Any], value)]
    if isinstance(value, float | np.floating):
        return float(f"{value:.{DIGITS}g}")
    return value


def report(progress: Progress | None, text: str, part: float) -> None:
    """Tell the caller where the work is, if it asked to be told."""
    if progress is not None:
        progress(text, part)
