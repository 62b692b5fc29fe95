"""A sparse form: what the remainder of a model looks like where no effect's name fits."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass, replace
from typing import Any

import numpy as np

from preisach_jax.quantity import number, quantity

LABEL = "form, not cause"
"""What every form is labelled, sparse or learned."""


@dataclass(frozen=True)
class State:
    """A quantity that terms are made of, counted from a centre and in parts of a scale.

    Attributes:
        name: in words.
        symbol: in formulas.
        unit: its unit, empty where it has none.
        centre, scale: in that unit; a term takes (value - centre) / scale.
    """

    name: str
    symbol: str
    unit: str
    centre: float
    scale: float

    @property
    def text(self) -> str:
        """What its symbol stands for, and in parts of what it is counted."""
        if self.scale == 1.0 and not self.unit:
            return f"{self.symbol}: {self.name}"
        start = f" from {quantity(self.centre, self.unit, 3)}" if self.centre else ""
        return f"{self.symbol}: {self.name}{start} in parts of {quantity(self.scale, self.unit, 3)}"


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


LEAST_TOLD = 0.2
"""RMS of a term, over that of the leading one, from which on its physics is told."""


@dataclass(frozen=True)
class Term:
    """One term of a sparse form.

    Attributes:
        formula: of the states, each counted from its centre and in parts of its scale.
        coefficient: of the formula, in output units.
        rms: of the term beside a density that is fitted with it, in output units.
        physics: where to look: what kind of physics makes such a term.
        states: what the symbols of the formula stand for.
    """

    formula: str
    coefficient: float
    rms: float
    physics: str
    states: tuple[State, ...]


@dataclass(frozen=True, eq=False)
class Dependence:
    """The remainder over the leading term, for a picture.

    Attributes:
        label, unit: of the quantity on the axis.
        position: (part,) its mean over parts of equal numbers of rows.
        remainder: (part,) mean of measured minus model, in output units.
        form: (part,) mean of what the form takes away, in output units.
    """

    label: str
    unit: str
    position: np.ndarray
    remainder: np.ndarray
    form: np.ndarray


@dataclass(frozen=True, eq=False)
class SparseForm:
    r"""A sum of few terms of the states at hand that takes up what remains of a model.

    \[ z = \text{model} + \sum_k c_k\,\varphi_k(u, h, \dot u, ...) \]

    It is a form, not a cause: other terms may do nearly as well, and none of them is an effect.

    Attributes:
        terms: the leading one first; empty if none is offered.
        rms_before, rms_after: held-out error without and with it, in `unit`.
        unit: that of the output.
        evidence: the score and the gain behind it; empty if nothing was tried.
        chance: greatest gain of the same search on remainders that were shifted.
        draws: how many of these.
        why_not: why no form is offered; empty if one is.
        notes: what a reader must know of the states.
        dependence: the remainder over the leading term; None if none is offered.
        learned: the learned term that was tried in its place; None if there was no need.
    """

    terms: tuple[Term, ...]
    rms_before: float
    rms_after: float
    unit: str
    evidence: Mapping[str, float]
    chance: float
    draws: int
    why_not: str
    notes: tuple[str, ...]
    dependence: Dependence | None = None
    learned: LearnedTerm | None = None

    def __repr__(self) -> str:
        if self.learned is not None and self.learned.offered:
            return "<SparseForm: none, but a learned term>"
        if not self.terms:
            return f"<SparseForm: none, {self.why_not}>"
        first, last = (quantity(rms, self.unit, 3) for rms in (self.rms_before, self.rms_after))
        return f"<SparseForm: {self.formula}; held-out error {first} -> {last} RMS>"

    @staticmethod
    def none(rms: float, unit: str, why_not: str, notes: tuple[str, ...] = ()) -> SparseForm:
        """No form, and why.

        Arguments:
            rms: held-out error of the model, in output units.
            unit: that of the output.
            why_not: why there is none.
            notes: what a reader must know of the states.
        """
        return SparseForm((), rms, rms, unit, {}, 0.0, 0, why_not, notes)

    @property
    def offered(self) -> bool:
        """Whether there is one."""
        return bool(self.terms)

    @property
    def formula(self) -> str:
        """The terms with their coefficients."""
        parts = [f"{quantity(term.coefficient, self.unit, 3)} · {term.formula}"
                 for term in self.terms]  # fmt: skip
        return " + ".join(parts).replace("+ -", "- ")

    @property
    def sentence(self) -> str:
        """What it would take away, or why there is none."""
        if not self.terms:
            return f"No sparse form is offered: {self.why_not}."
        fall = fall_in_words(
            self.rms_before, self.rms_after, self.unit, self.evidence["gain"], self.chance,
            self.draws,
        )  # fmt: skip
        return f"A sparse form ({LABEL}) {fall}"

    @property
    def state_texts(self) -> list[str]:
        """What the symbols stand for, each once."""
        return [s.text for s in dict.fromkeys(s for term in self.terms for s in term.states)]

    @property
    def physics(self) -> list[str]:
        """Where to look, the leading term first; small terms only mend what the others miss."""
        least = LEAST_TOLD * max((term.rms for term in self.terms), default=0.0)
        return list(dict.fromkeys(term.physics for term in self.terms if term.rms >= least))

    def to_json(self) -> dict[str, Any] | None:
        """The content of the key `form` of `diagnosis.json`; None if nothing is offered."""
        learned = self.learned if self.learned is not None and self.learned.offered else None
        if not self.terms and learned is None:
            return None
        told = self if learned is None else learned
        return {
            "label": LABEL,
            "formula": self.formula,
            "terms": [asdict(term) for term in self.terms],
            "rms_before": told.rms_before,
            "rms_after": told.rms_after,
            "unit": self.unit,
            "evidence": dict(told.evidence),
            "chance": told.chance,
            "draws": told.draws,
            "where_to_look": self.physics if learned is None else list(learned.where_to_look),
            "notes": list(self.notes),
            "learned": None if learned is None else learned.to_json(),
        }
