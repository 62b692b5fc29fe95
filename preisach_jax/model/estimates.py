"""What a model says of its parameters and of an output, with how sure that is."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class ParameterEstimate:
    """A value with its 95 % interval and its unit."""

    value: float
    low: float
    high: float
    unit: str


@dataclass(frozen=True)
class Prediction:
    """A simulated output with its 95 % band, `(time,)` each, in output units; time in s."""

    time: np.ndarray
    output: np.ndarray
    low: np.ndarray
    high: np.ndarray
