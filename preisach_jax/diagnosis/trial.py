"""One effect tried beside a model: what came of it, and what speaks for it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace

import numpy as np

from preisach_jax.diagnosis.evidence import Evidence
from preisach_jax.diagnosis.result import Candidate
from preisach_jax.effects.base import Effect
from preisach_jax.identify import Point
from preisach_jax.identify.confidence import Certainty

HOPELESS = 0.5
"""Relative rise of the held-out mean square beyond which an effect is not tried again."""

NOT_CERTAIN = "the 95 % intervals of its amounts include zero"

BY_THE_GRID = "not confirmed on a finer plane; it only compensates discretisation"

BY_THE_PRIOR = "with the same smoothness of the density, the model is as good without it"

WITHIN_BUDGET = (
    "the error without it is within noise and discretisation, and it removes less than half of that"
)

NOT_ON_ALL_ROWS = "it improves the rows used in the search, but too little on the whole record"

WITH_ANOTHER = "it is no better than an effect that was removed again"

TOO_LITTLE = (
    "with all effects found, the model still misses most of the output: no effect can be named "
    "reliably"
)

TOO_SLIGHT = (
    "it removes less than a fifth of the unexplained error: no effect can be named reliably"
)

WITHOUT_A_LAW = (
    "it follows no law, and much of what it should explain remains: no effect can be named reliably"
)


@dataclass(frozen=True, eq=False)
class Trial:
    """An effect tried beside those of a point, and what speaks for it.

    Attributes:
        effect, step: the effect, and how many the point has.
        point: the model with it.
        evidence: what the two tests measured.
        certain: whether its amounts are surely not zero, one alone or all together.
        objection: what was seen later and speaks against it.
    """

    effect: Effect
    step: int
    point: Point
    evidence: Evidence
    certain: Certainty
    objection: str = ""

    @property
    def passes_both_tests(self) -> bool:
        """Whether it passes both tests, and nothing was seen later that speaks against it."""
        return not self.evidence.against and not self.objection

    @property
    def passes(self) -> bool:
        """Whether it passes both tests, and its amounts are surely not zero."""
        return any(self.certain) and self.passes_both_tests

    @property
    def hopeless(self) -> bool:
        """Whether the error grew so much that a finer plane will not help."""
        return self.evidence.gain < -HOPELESS

    def candidate(self, unit: float, accepted: bool, better: str) -> Candidate:
        """The row of the table of candidates."""
        against = self.evidence.against or ("" if any(self.certain) else NOT_CERTAIN)
        against = against or self.objection
        return Candidate(
            self.effect.name,
            self.step,
            self.evidence.gain,
            float(np.sqrt(self.point.validation_mean_square)) * unit,
            self.evidence.numbers(),
            accepted,
            "" if accepted else against or f"{better} does more",
        )


@dataclass(frozen=True, eq=False)
class NotFitted:
    """An effect that was left, or could not be tried.

    Attributes:
        reason: why.
        hopeless: whether a finer plane will not help.
        failed: whether its own code failed.
        evidence: numbers behind the reason.
        gain: relative fall of the held-out mean square that it promises to first order.
    """

    effect: Effect
    step: int
    reason: str
    hopeless: bool = True
    failed: bool = False
    evidence: Mapping[str, float] = field(default_factory=dict[str, float])
    gain: float = 0.0

    @staticmethod
    def passed_over(effect: Effect, step: int, gain: float, enough: float) -> NotFitted:
        """An effect that promises too little, or less than others, or what fails the tests."""
        promised = f"it promises to lower the held-out mean square by {100 * gain:.1f} %"
        if not gain > 0:
            reason = "not fitted: it does not promise to lower the held-out error"
        elif gain < enough:
            reason = f"not fitted: {promised}, less than the {100 * enough:.2g} % asked for"
        else:
            reason = f"not fitted: {promised}, others promise more, or more reliably"
        return NotFitted(
            effect, step, reason, hopeless=False, evidence={"promise": gain}, gain=gain
        )

    def candidate(self, unit: float, accepted: bool, better: str) -> Candidate:
        """The row of the table of candidates."""
        del unit, better
        name, evidence = self.effect.name, dict(self.evidence)
        return Candidate(name, self.step, self.gain, np.nan, evidence, accepted, self.reason)


Row = tuple[Trial | NotFitted, bool, str]
"""A trial, whether its effect was added, and the effect that was added instead."""


def given_up_rows(rows: list[Row], given_up: list[Trial], objection: str) -> list[Row]:
    """The trials after some effects that had been added are given up, and why."""
    names = {trial.effect.name for trial in given_up}
    after: list[Row] = []
    for trial, accepted, better in rows:
        if isinstance(trial, Trial) and trial in given_up:
            after.append((replace(trial, objection=objection), False, ""))
        elif better in names:
            told = replace(trial, objection=WITH_ANOTHER) if isinstance(trial, Trial) else trial
            after.append((told, accepted, ""))
        else:
            after.append((trial, accepted, better))
    return after


def accepted_rows(rows: list[Row], names: list[str], step: int) -> list[Row]:
    """The trials after effects that did not pass alone were added with another."""
    after: list[Row] = []
    for trial, accepted, better in rows:
        here = trial.step == step
        added = here and trial.effect.name in names
        after.append((trial, accepted or added, names[0] if here else better))
    return after


def failures(rows: list[Row]) -> tuple[str, ...]:
    """One sentence an effect of a user's own that failed."""
    failed = {t.effect.name: t.reason for t, *_ in rows if isinstance(t, NotFitted) and t.failed}
    return tuple(f"The effect {name!r} was not tried: it {why}." for name, why in failed.items())


def with_rival(rows: list[Row], displaced: Trial, rival: Trial) -> list[Row]:
    """The trials after a rival has taken the place of an effect."""
    gone, name = displaced.effect.name, rival.effect.name
    after: list[Row] = []
    for trial, accepted, better in rows:
        if (trial.effect.name, trial.step) == (name, rival.step):
            after.append((rival, True, ""))
        elif trial is displaced:
            after.append((trial, False, name))
        else:
            after.append((trial, accepted, name if better == gone else better))
    return after
