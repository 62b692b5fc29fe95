"""How far a diagnosis is, and how much of it is still to be expected."""

from __future__ import annotations

from preisach_jax.diagnosis.walk import SCREENING
from preisach_jax.fit import Progress

BEGINNING, SCREENED, REFITTED, PLAIN_FIT, FIT_OF_AN_EFFECT, LIMITS = 1.5, 2.5, 5.0, 1.2, 4.0, 2.3
"""Typical work, in seconds of one core for 36,000 samples: the plain model; a round of all effects,
screened and refitted; the plain model on all rows; that with an effect more; budget and limits."""

PERHAPS = 0.4
"""Effects that are to be expected before any has been looked for, or beside those found."""


class Pace:
    """Share of a diagnosis that is done; it never goes back, whatever the search decides to try."""

    def __init__(self, progress: Progress):
        self._progress = progress
        self._told = 0.0
        self._before, self._named = 0.0, 0
        self._stage = self._beginning

    def begin_round(self, named: int) -> None:
        """All effects are tried beside a model that has some."""
        self._before = BEGINNING + named * (SCREENED + REFITTED)
        self._named, self._stage = named, self._round

    def begin_conclusion(self, named: int) -> None:
        """No further effect is looked for."""
        self._before = BEGINNING + named * REFITTED + (named + 1) * SCREENED
        self._named, self._stage = named, self._conclusion

    def tell(self, text: str, share: float) -> None:
        """Tell what is done now, and the share of the present stage that lies behind."""
        done, expected = self._stage(share)
        whole = BEGINNING + (expected + 1) * SCREENED + expected * REFITTED
        whole += PLAIN_FIT + expected * FIT_OF_AN_EFFECT + LIMITS
        self._told = max(self._told, (self._before + done) / whole)
        self._progress(text, min(self._told, 1.0))

    def _beginning(self, share: float) -> tuple[float, float]:
        return share * BEGINNING, PERHAPS

    def _round(self, share: float) -> tuple[float, float]:
        """Work done in a round, and effects to be expected: one more once any leads."""
        if share <= SCREENING:
            return share / SCREENING * SCREENED, self._named + PERHAPS
        refitted = (share - SCREENING) / (1 - SCREENING)
        return SCREENED + refitted * REFITTED, self._named + 1.0

    def _conclusion(self, share: float) -> tuple[float, float]:
        whole = PLAIN_FIT + self._named * FIT_OF_AN_EFFECT + LIMITS
        return share * whole, float(self._named)
