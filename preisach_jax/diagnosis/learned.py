"""A learned term: what remains of a model as a small network of the states at hand."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass, replace
from typing import Any

import numpy as np

from preisach_jax.diagnosis.state import LABEL, State
from preisach_jax.quantity import number, quantity


@dataclass(frozen=True, eq=False)
class Curve:
    r"""How a learned term depends on one of its states.

    The partial dependence, \(\bar g(x) = \frac1n \sum_k g(x, \text{other states of row } k)\)
    (J. H. Friedman, Ann. Stat. 29 (2001) 1189-1232), and the same where another state is low and
    where it is high: a product of two states has no dependence on either of them alone.

    Attributes:
        state: the state.
        share: of the power of the term that is lost where this state is drawn anew; several may
            add up to more than one.
        position: (point,) values of the state, in its unit.
        mean: (point,) mean of the term, in output units.
        beside: the other state.
        beside_low, beside_high: its values, in its unit: quantiles of 10 % and 90 %.
        low, high: (point,) mean of the term where it has these.
        physics: what kind of physics depends on the state.
    """

    state: State
    share: float
    position: np.ndarray
    mean: np.ndarray
    beside: State
    beside_low: float
    beside_high: float
    low: np.ndarray
    high: np.ndarray
    physics: str

    def to_json(self) -> dict[str, Any]:
        """The curve as numbers and texts."""
        arrays = {
            name: getattr(self, name).tolist() for name in ("position", "mean", "low", "high")
        }
        return asdict(replace(self, position=np.zeros(0))) | arrays


def fall_in_words(
    before: float, after: float, unit: str, gain: float, chance: float, draws: int
) -> str:
    """How far the held-out error would fall with a form, and how far it falls by chance.

    Arguments:
        before, after: held-out error without and with the form, in `unit`.
        unit: that of the output.
    """
    first, last = (quantity(rms, unit, 3) for rms in (before, after))
    return (
        f"would lower the held-out error from {first} to {last} RMS; the mean square falls by "
        f"{100 * gain:.0f} % (by chance: {number(100 * max(chance, 0.0), 2)} % at most in "
        f"{draws} draws)."
    )


@dataclass(frozen=True, eq=False)
class LearnedTerm:
    """A small network of the states at hand that takes up what remains of a model.

    It is a form, not a cause, and no effect: it is not part of any model.  Its curves hold nothing
    of the input alone and of the output alone, most of which the density takes up.

    Attributes:
        states: what it is made of.
        numbers: how many numbers it takes from the record.
        rms_before, rms_after: held-out error without and with it, in `unit`.
        unit: that of the output.
        evidence: the score and the gain behind it.
        chance: greatest gain of the same training on shifted remainders.
        draws: how many of these.
        curves: how it depends on the states that matter most, the first one most.
        where_to_look: what kind of physics depends on them, alone or in pairs.
        why_not: why it is not offered; empty if it is.
    """

    states: tuple[State, ...]
    numbers: int
    rms_before: float
    rms_after: float
    unit: str
    evidence: Mapping[str, float]
    chance: float
    draws: int
    curves: tuple[Curve, ...]
    where_to_look: tuple[str, ...]
    why_not: str

    @property
    def offered(self) -> bool:
        """Whether it is offered."""
        return not self.why_not

    @property
    def state_texts(self) -> list[str]:
        """What the symbols of the states that matter most stand for."""
        return [curve.state.text for curve in self.curves]

    @property
    def sentence(self) -> str:
        """What it would take away, or why it is not offered."""
        if self.why_not:
            return f"No learned term is offered either: {self.why_not}."
        fall = fall_in_words(
            self.rms_before, self.rms_after, self.unit, self.evidence["gain"], self.chance,
            self.draws,
        )  # fmt: skip
        *states, last = (curve.state.name for curve in self.curves)
        return (
            f"A learned term ({LABEL}), a network of {self.numbers} numbers, {fall} "
            f"It depends most on {', '.join(states)} and {last}."
        )

    def to_json(self) -> dict[str, Any]:
        """The term as numbers and texts."""
        return {
            "numbers": self.numbers,
            "states": [asdict(state) for state in self.states],
            "curves": [curve.to_json() for curve in self.curves],
        }
