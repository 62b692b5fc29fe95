"""The diagnosis by hand: see what is left, add an effect, watch the error, or take it back."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from preisach_jax.diagnosis.budget import Floor, budget_of_residual, error_budget, grid_rms
from preisach_jax.diagnosis.conclusion import assembled
from preisach_jax.diagnosis.evidence import compare, compare_fits
from preisach_jax.diagnosis.limits import limits
from preisach_jax.diagnosis.memoryless import Memoryless, memoryless
from preisach_jax.diagnosis.past import of_the_past
from preisach_jax.diagnosis.result import Budget, Candidate, Diagnosis, Finding, Rung
from preisach_jax.diagnosis.search import Search, Whole, candidate
from preisach_jax.diagnosis.selection import effects_to_try
from preisach_jax.diagnosis.wording import notes_on
from preisach_jax.effects.base import Effect
from preisach_jax.errors import InputError
from preisach_jax.fit import Added, Fit, Progress
from preisach_jax.fit.fitted import FINAL_ROWS, on_all_rows
from preisach_jax.fit.stepwise import (
    SEARCH_ROWS,
    checked_levels,
    double_precision,
    effects_for,
    held_out_rms,
    in_reduced_basis,
    in_silence,
    moved_to,
    on_a_coarser_plane,
    plain_model,
    with_effect,
    with_signs,
)
from preisach_jax.hooks import HOOKS
from preisach_jax.identify.problem import Point, Problem, evaluate
from preisach_jax.model import Model
from preisach_jax.record.core import Record
from preisach_jax.record.joined import as_one


@dataclass(frozen=True, eq=False)
class Exploration:
    """A model that grows effect by effect; each step is a value, and remembers the one before.

    Attributes:
        fit: the model of this step, fitted to all rows.
        tried: the effects that are compared and may be added.
        before: the step before, None for the model without effects.
    """

    fit: Fit
    tried: tuple[Effect, ...]
    before: Exploration | None
    _cache: dict[str, Any] = field(default_factory=dict[str, Any], repr=False)

    def __repr__(self) -> str:
        fit = self.fit
        return f"<Exploration of {self.record.name}: {fit.name}, {fit.rms_validation:.4g} RMS>"

    def _repr_html_(self) -> str:
        return HOOKS["Exploration._repr_html_"](self)

    @staticmethod
    def of(found: Diagnosis, effects: Iterable[str | Effect] | None = None) -> Exploration:
        """The steps of a diagnosis, to go on from by hand.

        Arguments:
            found: the diagnosis.
            effects: the effects to compare, as for `explore`.

        Returns:
            The last step; `before` leads back to the first.

        Example:
            >>> Exploration.of(found).add("drift")  # doctest: +SKIP
        """
        record = found.base.record
        tried = effects_to_try(record, effects)
        present = {effect.name: effect for fit in found.steps for effect in fit.model.effects}
        known = _names(tried)
        others = [
            effect
            for name, effect in present.items()
            if name not in known and not effect.inside_mechanics
        ]
        step = None
        for fit in found.steps:
            step = Exploration(fit, (*tried, *others), step)
        assert step is not None  # a diagnosis has at least the model without effects
        return step

    @property
    def record(self) -> Record:
        """The measurement."""
        return self.fit.record

    @property
    def effects(self) -> tuple[str, ...]:
        """Names of the effects in the order in which they were added."""
        return self.fit.effects

    @property
    def steps(self) -> tuple[Exploration, ...]:
        """All steps up to this one, first the model without effects."""
        return (*(self.before.steps if self.before else ()), self)

    @property
    def ladder(self) -> tuple[Rung, ...]:
        """The errors of all steps."""
        return tuple(Rung.of(step.fit) for step in self.steps)

    @property
    def left(self) -> tuple[Effect, ...]:
        """The effects that may still be added: none where the hysteresis is inside mechanics."""
        if self.fit.model.chain.mechanics:
            return ()
        return tuple(effect for effect in self.tried if effect.name not in self.effects)

    @property
    def problem(self) -> Problem:
        """The record as it is cut for the search."""
        first = self.steps[0]
        if "problem" not in first._cache:
            first._cache["problem"] = Problem.of(self.record, SEARCH_ROWS).reduced()
        return first._cache["problem"]

    @property
    def point(self) -> Point:
        """The model of this step on the rows of the search."""
        _check_not_inside(self.fit.model)
        if "point" not in self._cache:
            with double_precision():
                self._cache["point"] = _on_the_rows_of(self.problem, self.fit.point)
        return self._cache["point"]

    def candidates(self, progress: Progress | None = None) -> tuple[Candidate, ...]:
        """Try every effect that is left beside this model, and rank them.

        Those that nothing speaks against come first (see `diagnose`), each group by how well the
        model with it predicts.

        Arguments:
            progress: called with a text and a share done.

        Returns:
            One candidate an effect; `why_not` is empty if nothing speaks against it.

        Example:
            >>> explore(record).candidates()[0].effect  # doctest: +SKIP
            'creep'
        """
        if "candidates" not in self._cache and not self.left:
            self._cache["candidates"] = ()
        if "candidates" not in self._cache:
            self._cache["candidates"] = self._ranked(progress or in_silence)
        return self._cache["candidates"]

    def _ranked(self, progress: Progress) -> tuple[Candidate, ...]:
        with double_precision():
            search = Search.of(self.problem, self.tried, progress=progress)
            trials = search.beside(Whole.of(self.problem, self.point), 0.0, 1.0)
        rows: list[tuple[bool, float, Candidate]] = []
        for tried in trials:
            row = candidate(tried, len(self.effects), self.problem.unit, "")
            error = tried.model.error if tried.model is not None else np.inf
            rows.append((bool(tried.objection), error, replace(row, why_not=tried.objection)))
        rows.sort(key=lambda row: row[:2])
        return tuple(row for *_, row in rows if row.effect not in self.effects)

    def add(self, effect: str | Effect, progress: Progress | None = None) -> Exploration:
        """Add an effect, whatever speaks against it, and refit everything.

        Arguments:
            effect: the name of one of those in `left`, of the library, or one of one's own.
            progress: called with a text and a share done.

        Returns:
            The next step.

        Raises:
            InputError: there is no such effect, or the model has it.

        Example:
            >>> explore(record).add("creep").fit.rms_validation  # doctest: +SKIP
        """
        progress = progress or in_silence
        by_name = {known.name: known for known in self.tried}
        if isinstance(effect, str) and effect in by_name:
            effect = by_name[effect]
        (new,) = effects_for(self.record, [effect])
        if new.name in self.effects:
            raise InputError(f"the model has the effect {new.name!r} already; add another")
        _check_not_inside(self.fit.model, new)
        tried = self.tried if new.name in by_name else (*self.tried, new)
        with double_precision():
            progress(f"fitting {new.name}", 0.0)
            point = with_effect(self.problem, self.point, new)
            progress("fitting all rows", 0.6)
            errors = (held_out_rms(self.problem, each) for each in (self.point, point))
            added = (*self.fit.added, Added((new.name,), *errors))
            fit = replace(on_all_rows(self.record, self.problem, point), added=added)
        progress("done", 1.0)
        return Exploration(fit, tried, self, {"point": point})

    def budget(self) -> Budget:
        """What the held-out error of this step is made of: noise, grid, memory, and the rest.

        Returns:
            The budget.

        Example:
            >>> explore(record).budget().is_met  # doctest: +SKIP
            False
        """
        if self.fit.model.chain.mechanics:
            return budget_of_residual(self.fit)
        if "budget" not in self._cache:
            with double_precision():
                coarse = on_a_coarser_plane(self.problem, self.point)
                grid = grid_rms(self.problem, self.fit, self.point, coarse)
                whole = Problem.of(self.record, FINAL_ROWS)
                floor = Floor.of(whole, self.fit)
                self._cache["budget"] = error_budget(whole, self.fit, floor, grid)
        return self._cache["budget"]

    @property
    def memoryless(self) -> tuple[Memoryless, ...]:
        """What models without hysteresis do on the same rows."""
        first = self.steps[0]
        if "memoryless" not in first._cache:
            first._cache["memoryless"] = memoryless(first.fit)
        return first._cache["memoryless"]

    @property
    def known_candidates(self) -> tuple[Candidate, ...]:
        """The candidates, if they have been compared; else none."""
        return self._cache.get("candidates", ())

    @property
    def known_budget(self) -> Budget | None:
        """The budget, if it has been asked for."""
        return self._cache.get("budget")

    def conclude(self, progress: Progress | None = None) -> Diagnosis:
        """What can be said of this step, as a diagnosis whose effects were chosen by hand.

        The verdict rests on the budget alone: nothing says that another choice would not do as
        well, and a note tells so.

        Arguments:
            progress: called with a text and a share done.

        Returns:
            The diagnosis, for a report or as a file.

        Example:
            >>> explore(record).add("creep").conclude().verdict  # doctest: +SKIP
            'explained'
        """
        budget = self.budget()
        findings = tuple(_finding(step, self.fit) for step in self.steps[1:])
        candidates = tuple(c for step in self.steps for c in _compared(step, self.effects))
        if progress is not None:
            progress("limiting the effects that were not added", 0.5)
        bounds = ()
        if self.left:
            with double_precision():
                whole = Problem.of(self.record, SEARCH_ROWS)
                bounds = limits(whole, with_signs(whole, self.point), self.left)
        notes = [BY_HAND] if findings else []
        return assembled(
            [step.fit for step in self.steps],
            findings,
            budget,
            candidates,
            bounds,
            self.tried,
            (
                *notes,
                *(f"{sentence[0].upper()}{sentence[1:]}." for sentence in self.fit.rises),
                *notes_on(self.record, self.fit.model),
                *of_the_past(self.record, self.fit.model, self.fit.rms_validation),
            ),
        )


BY_HAND = (
    "The effects were chosen by hand: that the error falls with them does not say that no other "
    "effect would do as well."
)


def _check_not_inside(model: Model, *added: Effect) -> None:
    effects = (*model.effects, *added)
    inside = next((effect.name for effect in effects if effect.inside_mechanics), None)
    if inside is not None:
        raise InputError(
            f"the model has {', '.join(effect.name for effect in effects)}: {inside} is fitted "
            "alone, since no other effect acts inside its mechanics; fit it with "
            f"pj.fit(record, effects=({inside!r},)), or go back to the step before it"
        )


def _finding(step: Exploration, last: Fit) -> Finding:
    assert step.before is not None  # the first step has added nothing
    name, before = step.effects[-1], step.before
    if step.fit.model.chain.mechanics:
        evidence = compare_fits(before.fit, step.fit).numbers()
    else:
        evidence = compare(step.problem, before.point, step.point).numbers()
    parameters = last.model.parameters[name]
    errors = (before.fit.rms_validation, step.fit.rms_validation)
    return Finding(name, (name,), parameters, *errors, evidence)


def _compared(step: Exploration, effects: tuple[str, ...]) -> list[Candidate]:
    """What was compared at a step, as far as it was; what was added then is marked."""
    count = len(step.effects)
    added = effects[count] if count < len(effects) else ""
    other = f"{added} was added" if added else "it was not added"
    return [
        replace(
            row, accepted=row.effect == added,
            why_not="" if row.effect == added else row.why_not or other,
        )
        for row in step.known_candidates
    ]  # fmt: skip


def explore(
    record: Record | Sequence[Record],
    effects: Iterable[str | Effect] | None = None,
    levels: int | None = None,
    *,
    progress: Progress | None = None,
) -> Exploration:
    """Fit the rate-independent model to a record, as the first step of a diagnosis by hand.

    Arguments:
        record: the measurement; or several of one specimen, each with a memory of its own.
        effects: effects to compare, by name or as objects; by default the library, without those
            that are tried on request, and all auxiliary columns.
        levels: levels N of the plane; by default 25.
        progress: called with a text and a share done.

    Returns:
        The first step.

    Raises:
        InputError: if an effect is unknown, or levels is not an integer from 2 to 200.

    Example:
        >>> import numpy as np, preisach_jax as pj
        >>> t = np.arange(3000) / 100
        >>> u = 5 - 5 * np.cos(t * (1 + t / 40))
        >>> z = u**1.1 + 0.02 * t + 0.01 * np.random.default_rng(0).normal(size=3000)
        >>> plain = pj.explore(pj.Record.from_arrays(t, u, z), ["drift", "hum"], levels=9)
        >>> [candidate.effect for candidate in plain.candidates()]
        ['drift', 'hum']
        >>> plain.add("drift").fit.rms_validation < plain.fit.rms_validation / 5
        True
    """
    record = as_one(record, asked_by="explore")
    asked = effects_to_try(record, effects)
    tried = tuple(effect for effect in asked if not effect.inside_mechanics)
    if progress is not None:
        progress("fitting the rate-independent model", 0.0)
    with double_precision():
        record, problem, point = plain_model(record, checked_levels(levels))
        problem, point = in_reduced_basis(problem, point)
        fit = on_all_rows(record, problem, point)
    return Exploration(fit, tried, None, {"problem": problem, "point": point})


def _on_the_rows_of(problem: Problem, point: Point) -> Point:
    """The model of a point on the rows of another cut of its record."""
    if point.chain.effects:
        return moved_to(problem, point)
    return evaluate(problem, point.chain, point.values, point.strength, point)


def _names(effects: Iterable[Effect]) -> set[str]:
    return {effect.name for effect in effects}
