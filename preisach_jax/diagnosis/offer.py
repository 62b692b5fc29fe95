"""Whether a form of what remains is offered: what it must do beside its score."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from preisach_jax.diagnosis.evidence import Evidence
from preisach_jax.fit import REFINEMENT, at_levels
from preisach_jax.identify import Point, Problem
from preisach_jax.quantity import quantity

WEAK = 0.9
"""Relative fall of the held-out mean square below which a finer plane must not do as well."""

CONFIRMATION_LEVELS = 50
"""Finest plane that it is compared with."""

LEAST_FORM_GAIN = 0.25
"""Relative fall of the held-out mean square below which no form is offered."""


@dataclass(frozen=True, eq=False)
class Offer:
    """A form that was fitted with the density.

    Attributes:
        problem, point: the record, and the model without the form.
        evidence: what speaks for the form.
        before, after: held-out error without and with it, in output units.
    """

    problem: Problem
    point: Point
    evidence: Evidence
    before: float
    after: float

    @property
    def _falls(self) -> str:
        return f"the best one lowers the held-out mean square by {100 * self.evidence.gain:.0f} %"

    def against(self, discretisation: float) -> str:
        """Why it is not offered, whatever chance reaches; empty if nothing speaks against it.

        Arguments:
            discretisation: RMS of what the grid of the plane adds, in output units.
        """
        if self.evidence.against:
            return self.evidence.against
        if not self.evidence.gain >= LEAST_FORM_GAIN:
            return f"{self._falls}, less than {100 * LEAST_FORM_GAIN:.0f} %"
        removed = float(np.sqrt(self.before**2 - self.after**2))
        if not removed > discretisation:
            unit = self.problem.record.output_unit
            return (
                f"the best one takes away {quantity(removed, unit, 3)} RMS, no more than the "
                f"discretisation of the plane, {quantity(discretisation, unit, 3)}"
            )
        return "" if self.evidence.gain >= WEAK else self._by_the_grid()

    def against_chance(self, chance: float, draws: int) -> str:
        """Why it is not offered beside what chance reaches; empty if it does more."""
        if self.evidence.gain > chance:
            return ""
        return (
            f"{self._falls}, the same search on {draws} shifted remainders by up to "
            f"{100 * chance:.0f} %"
        )

    def _by_the_grid(self) -> str:
        """What says that a finer plane does nearly as well; empty if none does."""
        levels = self.point.chain.plane.levels
        finer = min(round(levels * REFINEMENT), CONFIRMATION_LEVELS)
        if finer <= levels:
            return ""
        plain = at_levels(self.problem.reduced(), self.point, finer)
        left = self.after / self.problem.unit
        if left**2 <= (1 - LEAST_FORM_GAIN) * plain.validation_mean_square:
            return ""
        rms = float(np.sqrt(plain.validation_mean_square)) * self.problem.unit
        shown = quantity(rms, self.problem.record.output_unit, 3)
        return f"a plane of {finer} levels leaves {shown} RMS without it: it mends the grid"
