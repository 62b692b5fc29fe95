"""The states at hand, of which forms of what remains are made."""

from __future__ import annotations

from dataclasses import dataclass

from preisach_jax.quantity import quantity

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
