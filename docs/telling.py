"""How each effect is shown: the axis that tells it, where its record comes from, what to look for.

`telling.toml` says it; the pages of the effects take the captions, and `pictures.py` the axes.
"""

from __future__ import annotations

import tomllib
from dataclasses import dataclass
from pathlib import Path

STAGE = (
    "`pj.simulate_stage(seed={seed}, seconds={seconds:g}, effects=({name!r},), rate_hz={rate:g})`"
)


@dataclass(frozen=True)
class Telling:
    """How the residual of one hidden effect is shown.

    Attributes:
        axis: what the second panel shows; a function of `pictures.py`.
        look: what to look for, in a sentence or two.
        seed: of the simulated stage.
        seconds, rate_hz: length and sampling rate of its record.
        made: how the record was made, where it was not by `simulate_stage`.
    """

    axis: str
    look: str
    seed: int = 3
    seconds: float = 16.0
    rate_hz: float = 1000.0
    made: str = ""

    def source(self, name: str) -> str:
        """How the record was made, in words or as a call."""
        if self.made:
            return self.made
        hidden = name.removesuffix(":COL")
        call = STAGE.format(name=hidden, seed=self.seed, seconds=self.seconds, rate=self.rate_hz)
        return f"The stage is simulated: {call}."


COLUMNS = {"aux:COL": "aux:load_N", "gain:COL": "gain:temp_C", "cross:COL": "cross:y_V"}
"""Effects of a column as they are named in the simulated stage."""


with Path(__file__).with_suffix(".toml").open("rb") as _file:
    TELLING = {name: Telling(**given) for name, given in tomllib.load(_file).items()}
