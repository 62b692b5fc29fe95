"""A step of a diagnosis: the model so far, how it came about, and what was tried beside it."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from preisach_jax.diagnosis.budget import by_another_plane, refined_levels
from preisach_jax.diagnosis.evidence import simple_ratio
from preisach_jax.diagnosis.noise import noise_rms
from preisach_jax.diagnosis.result import Candidate
from preisach_jax.diagnosis.trial import Row, Trial
from preisach_jax.effects.base import Effect
from preisach_jax.fit import FINAL_ROWS, at_levels, on_a_coarser_plane, with_effect, with_signs
from preisach_jax.identify import Point, Problem
from preisach_jax.record import Record

REFINEMENT_PAYS = 0.1
"""Relative fall of the held-out mean square for which a finer plane is kept."""


@dataclass(frozen=True, eq=False)
class Named:
    """An effect that was added, and those that did as well.

    Attributes:
        trial: the effect as it was tried, and what spoke for it.
        rivals: the models with each of the others in its place, by their names.
    """

    trial: Trial
    rivals: dict[str, Point]

    @property
    def name(self) -> str:
        """The effect's name."""
        return self.trial.effect.name


@dataclass(frozen=True, eq=False)
class Step:
    """A model on the way of a diagnosis; the next step is another value.

    Attributes:
        record: the record without its spikes.
        problem: the record as it was cut for the search.
        all_hysterons: the same cut, for models with all hysterons.
        tried: the effects to try.
        path: the models up to this one, first that without effects.
        named: the effects that were added, in the order of the path.
        trials: what was tried beside each of the models.
        other: this model on a finer or a coarser plane; None if it has not been asked for.
    """

    record: Record
    problem: Problem
    all_hysterons: Problem
    tried: tuple[Effect, ...]
    path: tuple[Point, ...]
    named: tuple[Named, ...] = ()
    trials: tuple[Row, ...] = ()
    other: Point | None = None

    @property
    def now(self) -> Point:
        """The model of this step."""
        return self.path[-1]

    @property
    def position(self) -> int:
        """How many effects the model has."""
        return len(self.now.chain.effects)

    @property
    def left(self) -> list[Effect]:
        """The effects that are worth trying beside this model.

        On a refined plane, those that made things much worse on the coarser one are left out.
        """
        present = {effect.name for effect in self.now.chain.effects}
        hopeless = {
            trial.effect.name
            for trial, _, _ in self.trials
            if trial.step == self.position and trial.hopeless
        }
        return [effect for effect in self.tried if effect.name not in present | hopeless]

    @property
    def candidates(self) -> tuple[Candidate, ...]:
        """All that was tried, as rows of a table."""
        return tuple(
            trial.candidate(self.problem.unit, accepted, better)
            for trial, accepted, better in self.trials
        )

    @property
    def is_within_budget(self) -> bool:
        """Whether noise and discretisation explain half of the held-out mean square or more."""
        return self.above_budget <= 2

    @property
    def above_budget(self) -> float:
        """Held-out mean square over what noise and discretisation make of it."""
        grid = by_another_plane(self.problem, self.now, self.compared.other or self.now)
        noise = noise_rms(self.problem, self.now)
        error = self.now.validation_mean_square * self.problem.unit**2
        budget = noise**2 + grid**2
        return error / budget if budget else np.inf

    @property
    def compared(self) -> Step:
        """The same step, with its model on another plane."""
        if self.other is not None:
            return self
        return replace(self, other=on_a_coarser_plane(self.problem, self.now))

    def with_named(self, trial: Trial, rivals: dict[str, Point] | None = None) -> Step:
        """The step with an effect more, as it was tried beside its model."""
        named = (*self.named, Named(trial, rivals or {}))
        return replace(self, named=named, path=(*self.path, trial.point), other=None)

    def effect(self, name: str) -> Effect:
        """The effect to try of that name, as it is before it is fitted."""
        return next(effect for effect in self.tried if effect.name == name)

    def fitted(self, position: int, least_gain: float) -> list[Trial]:
        """The effects that were fitted beside one of the models and helped, the best first."""
        found = [
            trial
            for trial, _, _ in self.trials
            if isinstance(trial, Trial)
            and trial.step == position
            and trial.evidence.gain >= least_gain
        ]
        return sorted(found, key=lambda trial: trial.point.validation_mean_square)

    def ladder(self, names: Sequence[str]) -> tuple[Point, ...]:
        """The models in which some of the effects are added one by one, after the first one."""
        points = [self.path[0]]
        for name in names:
            points.append(with_effect(self.problem, points[-1], self.effect(name)))
        return tuple(points)


def on_a_refined_plane(
    step: Step, levels_are_given: bool, announce: Callable[[str], object]
) -> Step:
    """The step on a finer plane, as long as the held-out error falls with it.

    Arguments:
        levels_are_given: whether the plane must stay as it is.
    """
    while True:
        rows = min(len(step.record), FINAL_ROWS)
        finer = refined_levels(rows, step.now.chain.plane.levels)
        if finer is None:
            return replace(step, other=None).compared
        announce(f"trying a plane of {finer} levels")
        other = at_levels(step.problem, step.now, finer)
        fall = 1 - simple_ratio(other.validation_mean_square, step.now.validation_mean_square)
        if levels_are_given or not fall > REFINEMENT_PAYS:
            return replace(step, other=other)
        before = [at_levels(step.problem, point, finer) for point in step.path[:-1]]
        step = replace(step, path=(*before, other), other=None)


def signed_planes(step: Step) -> tuple[Point, Point]:
    """The model of a step on both planes that it was compared on, with weights of one sign."""
    now = with_signs(step.all_hysterons, step.now)
    return now, now if step.other is None else with_signs(step.all_hysterons, step.other)


def refined_with_signs(step: Step) -> Step:
    """The step on the finer plane that it was compared on, if this pays with weights of one sign.

    In a reduced basis weights have any sign, and a finer plane is not always worth its weights;
    the final model has all hysterons with signs, of which a finer plane may do with more.
    """
    now, other = step.now, step.other
    if other is None or other.chain.plane.levels <= now.chain.plane.levels:
        return step
    if other.columns.vectors is None or step.is_within_budget:
        return step
    coarse, fine = signed_planes(step)
    fall = 1 - fine.validation_mean_square / coarse.validation_mean_square
    if not fall > REFINEMENT_PAYS:
        return step
    before = [at_levels(step.problem, point, other.chain.plane.levels) for point in step.path[:-1]]
    return replace(step, path=(*before, other), other=now)
