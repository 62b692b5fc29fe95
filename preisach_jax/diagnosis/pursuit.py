"""The search for a sparse form of what remains of a model.

The terms are pursued in the remainder one by one (`freed`); the blocks held out say whether more
of them stay, by the score that an effect must have.  Chance is measured by the same search on
remainders that are shifted round parts of the record, each part by a lag of its own: they keep
their course, and lose what they go with.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from preisach_jax.diagnosis.evidence import Evidence, evidence_between
from preisach_jax.diagnosis.form import Dependence, SparseForm, Term
from preisach_jax.diagnosis.freed import FreedTerms, refitted
from preisach_jax.diagnosis.result import Diagnosis
from preisach_jax.diagnosis.terms import Listed, library_of
from preisach_jax.errors import InputError
from preisach_jax.fit import Fit, Progress
from preisach_jax.fit.fitted import FINAL_ROWS, with_regressors
from preisach_jax.fit.stepwise import REFINEMENT, at_levels, double_precision, in_silence
from preisach_jax.identify.problem import VALIDATION, Point, Problem
from preisach_jax.quantity import quantity
from preisach_jax.record.core import Record

DRAWS = 40
"""Shifted remainders by which chance is measured."""

MOST_AGAIN, LEAST_FALL = 3, 0.02
"""How often terms of the output are made anew, and relative fall of the held-out error for that."""

LEAST_FORM_GAIN = 0.25
"""Relative fall of the held-out mean square below which no form is offered."""

WEAK = 0.9
"""Relative fall of the held-out mean square below which a finer plane must not do as well."""

CONFIRMATION_LEVELS = 50
"""Finest plane that it is compared with."""

PARTS = 24
"""Parts of equal numbers of rows of the picture."""


def find_form(
    found: Diagnosis, *, seed: int = 0, draws: int = DRAWS, progress: Progress | None = None
) -> SparseForm:
    r"""Find a sparse form of what a diagnosis leaves unexplained.

    \[ z = \text{model} + \sum_{k \le 4} c_k\,\varphi_k(u, h, \dot u, ...) \]

    The terms are powers, products, saturating functions and first-order memories of the input,
    the output of the model, their rates, path and time since the last reversal, time, and
    auxiliary columns.  The density is fitted anew with them.  A form is offered only if it has
    the score of an effect on the held-out blocks, lowers the held-out mean square by a quarter
    at least, takes away more than the discretisation of the plane, does better than a finer plane,
    and does more than the same search on any of some shifted remainders.  It is a form, not a
    cause, and never among the effects.

    Arguments:
        found: a diagnosis; of one that leaves nothing unexplained no form is sought.
        seed: of the shifts.
        draws: how many shifted remainders measure chance, at least 1.
        progress: called with a text and a share done.

    Returns:
        The form; without terms, and with the reason, where none is offered.

    Raises:
        InputError: if draws is below 1.

    Example:
        >>> import numpy as np, preisach_jax as pj
        >>> t = np.arange(3000) / 100
        >>> u = 5 - 5 * np.cos(t * (1 + t / 40))
        >>> z = u**1.1 + 0.02 * np.gradient(u, t) ** 3
        >>> z += 0.01 * np.random.default_rng(0).normal(size=3000)
        >>> found = pj.diagnose(pj.Record.from_arrays(t, u, z), ["drift"], levels=9)
        >>> found.verdict, pj.find_form(found).terms[0].formula
        ('unexplained', "u'³")
    """
    if not draws >= 1:
        raise InputError(f"draws is {draws}; give an integer of at least 1")

    def none(why_not: str) -> SparseForm:
        return SparseForm.none(found.ladder[-1].rms_validation, found.budget.unit, why_not)

    if not found.leaves_a_part:
        return none(f"the verdict is {found.verdict}, which leaves nothing unexplained")
    if found.model.chain.mechanics is not None:
        return none("the output drives the hysteresis, and a term would change its path")
    with double_precision():
        grid = found.budget.discretisation
        return sought(found.final, grid, seed, draws, progress or in_silence)


def sought(
    fit: Fit, discretisation: float, seed: int, draws: int, progress: Progress = in_silence
) -> SparseForm:
    """The form of what a fit leaves, whatever the verdict on it.

    Arguments:
        discretisation: RMS of what the grid of the plane adds, in output units.
    """
    progress("making terms of the states", 0.0)
    record = fit.record
    problem = Problem.of(record, FINAL_ROWS)
    point = with_regressors(problem, fit)
    kept = np.searchsorted(record.time, problem.record.time)
    library = library_of(record, fit.prediction, kept)
    progress("freeing the terms from the density", 0.1)
    terms = FreedTerms.of(problem, point, library)
    progress("refitting the density with the terms", 0.3)
    trial = _by_its_own_output(_tried(problem, point, terms), record, kept, progress)
    none = SparseForm.none(fit.rms_validation, record.output_unit, "", tuple(library.notes))
    if not trial.chosen:
        return replace(
            none, why_not="no term predicts the record so much better that an effect would be named"
        )
    progress("measuring what chance reaches", 0.6)
    evidence = trial.evidence
    chance = trial.terms.by_chance(seed, draws, evidence.gain)
    measured = replace(none, evidence=evidence.numbers(), chance=chance, draws=draws)
    against = _against(trial, evidence, discretisation)
    if not against and not evidence.gain > chance:
        against = (
            f"{_falls(evidence)}, the same search on {draws} shifted remainders by up to "
            f"{100 * chance:.0f} %"
        )
    if against:
        return replace(measured, why_not=against)
    before, after = trial.rms
    told, dependence = _described(trial)
    return replace(measured, terms=told, rms_before=before, rms_after=after, dependence=dependence)


def _by_its_own_output(
    trial: _Trial, record: Record, kept: np.ndarray, progress: Progress
) -> _Trial:
    """The same search again with the output that the model has beside the terms.

    Terms of the output were made of what the model without them says of it, which holds a part of
    what it lacks.  With the terms it says more of it, and so on as long as the error falls.

    Arguments:
        kept: (sample,) rows of the record that the search has.
    """
    for again in range(MOST_AGAIN):
        if not trial.of_output:
            break
        progress("making terms of the output beside the form", 0.4 + 0.2 * again / MOST_AGAIN)
        library = library_of(record, trial.output_at(record.time), kept)
        terms = FreedTerms.of(trial.problem, trial.point, library)
        other = _tried(trial.problem, trial.point, terms)
        if not other.chosen or other.rms[1] > (1 - LEAST_FALL) * trial.rms[1]:
            break
        trial = other
    return trial


@dataclass(frozen=True, eq=False)
class _Trial:
    """Terms that each have the score of an effect, fitted with the density.

    Attributes:
        problem, point, terms: the record, the model, and all terms beside it.
        chosen: places of those that are taken.
        after: (row,) what is left with them, in output ranges.
        coefficients: (term,) theirs, in output ranges.
    """

    problem: Problem
    point: Point
    terms: FreedTerms
    chosen: list[int]
    after: np.ndarray
    coefficients: np.ndarray

    def with_terms(self, terms: FreedTerms, chosen: Sequence[int]) -> _Trial:
        """The same with other terms."""
        after, coefficients = refitted(self.problem, self.point, terms, chosen)
        return replace(
            self, terms=terms, chosen=list(chosen), after=after, coefficients=coefficients
        )

    def beats(self, simpler: _Trial) -> bool:
        """Whether its score speaks for it against one of fewer terms."""
        return not evidence_between(self.problem, simpler.after, self.after).against

    @property
    def of_output(self) -> bool:
        """Whether a term is made of the output of the model."""
        states = [state for k in self.chosen for state in self.terms.listed[k].states]
        return any(state.symbol in ("h", "h'") for state in states)

    def output_at(self, time: np.ndarray) -> np.ndarray:
        """(time,) output of the model beside the terms, in output units.

        Arguments:
            time: (time,) s.
        """
        problem, order = self.problem, self.problem.in_time
        terms = self.terms.whole[:, self.chosen] @ self.coefficients
        output = problem.target - (self.after + terms) * problem.unit
        return np.interp(time, problem.record.time[problem.rows[order]], output[order])

    @property
    def numbers(self) -> int:
        """How many numbers its terms take from the record."""
        return self.terms.numbers(self.chosen)

    @property
    def evidence(self) -> Evidence:
        """What speaks for all its terms together."""
        before = self.point.residual
        return evidence_between(self.problem, before, self.after)

    @property
    def rms(self) -> tuple[float, float]:
        """Held-out error without and with it, in output units."""
        held_out = self.problem.fold == VALIDATION[0]
        before, after = (
            float(np.sqrt(np.mean(e[held_out] ** 2))) * self.problem.unit
            for e in (self.point.residual, self.after)
        )
        return before, after


def _tried(problem: Problem, point: Point, terms: FreedTerms) -> _Trial:
    """Forward by what explains most of the remainder, and back where one does as well without."""
    now = _Trial(problem, point, terms, [], point.residual, np.zeros(0))
    for wider, chosen in terms.pursued(terms.remainder):
        trial = now.with_terms(wider, chosen)
        if trial.beats(now):
            now = trial
    for term in now.chosen:
        if len(now.chosen) == 1:
            break
        fewer = now.with_terms(now.terms, [other for other in now.chosen if other != term])
        if not now.beats(fewer):
            now = fewer
    return now


def _falls(evidence: Evidence) -> str:
    return f"the best one lowers the held-out mean square by {100 * evidence.gain:.0f} %"


def _against(trial: _Trial, evidence: Evidence, discretisation: float) -> str:
    """Why a form is not offered, whatever chance reaches; empty if nothing speaks against it."""
    if evidence.against:
        return evidence.against
    if not evidence.gain >= LEAST_FORM_GAIN:
        return f"{_falls(evidence)}, less than {100 * LEAST_FORM_GAIN:.0f} %"
    problem, point, unit = trial.problem, trial.point, trial.problem.record.output_unit
    before, after = trial.rms
    removed = float(np.sqrt(before**2 - after**2))
    if not removed > discretisation:
        return (
            f"the best one takes away {quantity(removed, unit, 3)} RMS, no more than the "
            f"discretisation of the plane, {quantity(discretisation, unit, 3)}"
        )
    levels = point.chain.plane.levels
    finer = min(round(levels * REFINEMENT), CONFIRMATION_LEVELS)
    if evidence.gain >= WEAK or finer <= levels:
        return ""
    plain = at_levels(problem.reduced(), point, finer).validation_mean_square
    if (after / problem.unit) ** 2 <= (1 - LEAST_FORM_GAIN) * plain:
        return ""
    shown = quantity(float(np.sqrt(plain)) * problem.unit, unit, 3)
    return f"a plane of {finer} levels leaves {shown} RMS without it: it mends the grid"


def _described(trial: _Trial) -> tuple[tuple[Term, ...], Dependence]:
    """The terms, the one that takes up most first, and the remainder over that one."""
    terms, chosen, unit = trial.terms, trial.chosen, trial.problem.unit
    rows = float(np.count_nonzero(terms.projection.rows))
    sizes = np.abs(trial.coefficients) * terms.size[chosen] / np.sqrt(rows) * unit
    ranked: list[int] = np.argsort(-sizes, kind="stable").tolist()
    told: list[Term] = []
    for k in ranked:
        listed = terms.listed[chosen[k]]
        coefficient = float(trial.coefficients[k]) * unit
        told.append(
            Term(listed.formula, coefficient, float(sizes[k]), listed.physics, listed.states)
        )
    leading = terms.listed[chosen[ranked[0]]]
    before = trial.point.residual
    courses = (before * unit, (before - trial.after) * unit)
    return tuple(told), _dependence(leading, trial.problem.rows, *courses)


def _dependence(
    term: Listed, rows: np.ndarray, remainder: np.ndarray, form: np.ndarray
) -> Dependence:
    """The remainder over a term, or over the state if it is a function of one alone."""
    label, unit, values = f"{term.formula}, each in parts of its scale", "", term.values[rows]
    if term.along is not None:
        state = term.states[0]
        label, unit = state.name, state.unit
        values = state.centre + state.scale * term.along[rows]
    parts = [part for part in np.array_split(np.argsort(values, kind="stable"), PARTS) if len(part)]
    means = [np.array([float(x[part].mean()) for part in parts]) for x in (values, remainder, form)]
    return Dependence(label, unit, *means)
