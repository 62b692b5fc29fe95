"""A sparse form: what the remainder of a model looks like where no effect's name fits."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from preisach_jax.quantity import number, quantity

LABEL = "form, not cause"
"""What every form is labelled."""


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

    def __repr__(self) -> str:
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
        first, last = (quantity(rms, self.unit, 3) for rms in (self.rms_before, self.rms_after))
        chance = number(100 * max(self.chance, 0.0), 2)
        return (
            f"A sparse form ({LABEL}) would lower the held-out error from {first} to {last} RMS; "
            f"the mean square falls by {100 * self.evidence['gain']:.0f} % (by chance: {chance} % "
            f"at most in {self.draws} draws)."
        )

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
        if not self.terms:
            return None
        return {
            "label": LABEL,
            "formula": self.formula,
            "terms": [asdict(term) for term in self.terms],
            "rms_before": self.rms_before,
            "rms_after": self.rms_after,
            "unit": self.unit,
            "evidence": dict(self.evidence),
            "chance": self.chance,
            "draws": self.draws,
            "where_to_look": self.physics,
            "notes": list(self.notes),
        }
