"""The search for what a model lacks: whole models, each refitted in full, compared by one score.

Beside a few models at a time every effect is tried from all its starts; the models in which it
helps are searched on from.  Of all models that were met, the smallest that predicts as well as the
best one is taken; those of the same size that predict as well are its families.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace

import equinox as eqx
import numpy as np

from preisach_jax.chain.description import Chain
from preisach_jax.cores import on_all_cores
from preisach_jax.diagnosis.evidence import Evidence, by_chance, gain_of, predicted_errors
from preisach_jax.diagnosis.noise import noise_rms
from preisach_jax.diagnosis.plausible import implausible
from preisach_jax.diagnosis.result import Candidate
from preisach_jax.diagnosis.tellable import surveyed, untellable
from preisach_jax.effects.base import (
    AddedEffect,
    Effect,
    OfColumn,
    OutputEffect,
    SensorEffect,
    WeightEffect,
)
from preisach_jax.fit import Progress
from preisach_jax.fit.stepwise import (
    at_levels,
    best_start,
    feeds_back,
    in_silence,
    refit,
    roughly_with,
    without_effect,
)
from preisach_jax.identify.problem import Point, Problem, evaluate
from preisach_jax.identify.signature import Projection, changes_of_output
from preisach_jax.record.jumps import wander_rms

MOST_EFFECTS = 4

BEAM = 3
"""Models of a size that are searched on from."""

REACH = 16.0
"""Mean square, over that of the best model of its size, up to which one is searched on from."""

WORTH_SETTLING = 0.02
"""Mean logarithm of an RMS error by which a model must do better after its first steps, or relative
fall of the held-out mean square, for its parameters to be refined to their end."""

MOST_STARTS = 2
"""Starts of a further term of an effect that are refined."""

NO_UNIQUE_OUTPUT = "not tried: beside weights of both signs its output is not unique"

WITHIN_WHAT_DOES_NOT_MATTER = (
    "what it takes away is within the tolerance, or within what jumps of the sensor leave open"
)

Key = tuple[tuple[str, int], ...]


@dataclass(frozen=True, eq=False)
class Whole:
    """A whole model that was met, and how well it predicts.

    Attributes:
        point: the model, without its regressors: those of all that are met would be gigabytes.
        errors: (stretch,) mean squares that it predicts, in squared output ranges.
    """

    point: Point
    errors: np.ndarray

    @staticmethod
    def of(problem: Problem, point: Point) -> Whole:
        return Whole(point.slim, predicted_errors(problem, point))

    @property
    def names(self) -> tuple[str, ...]:
        """Names of its effects, in the order in which they were added."""
        return tuple(effect.name for effect in self.point.chain.effects)

    @property
    def key(self) -> Key:
        """Its effects, whatever their order, each with the number of its terms."""
        return tuple(sorted((each.name, _terms(each)) for each in self.point.chain.effects))

    @property
    def error(self) -> float:
        """Mean logarithm of the mean squares."""
        return float(np.mean(np.log(np.maximum(self.errors, np.finfo(float).tiny))))


def _terms(effect: Effect) -> int:
    """How many numbers an effect takes from the record."""
    linear = isinstance(effect, AddedEffect | OutputEffect | SensorEffect | WeightEffect)
    return len(effect.parameters()) + (len(effect.coefficients()) if linear else 0)


@dataclass(frozen=True, eq=False)
class Tried:
    """What came of an effect beside a model.

    Attributes:
        effect: its name.
        model: the model with it; None if it could not be tried.
        evidence: what speaks for that.
        objection: why it is no name, or why it was not tried; empty if nothing speaks against it.
        failed: whether its own code failed.
    """

    effect: str
    model: Whole | None
    evidence: Evidence | None
    objection: str
    failed: bool = False


@dataclass(frozen=True, eq=False)
class Selection:
    """The model that a search comes to, and how it came about.

    Attributes:
        problem: the record as it was cut for the search.
        tried: the effects to try.
        path: the models up to the one that was chosen, first that without effects.
        rivals: for each effect, in the order of the path, the models of equal size that predict as
            well with another one in its place, by the names of those.
        steps: what was tried beside each of the models of the path.
        floor: mean square, in squared output ranges, that does not matter.
    """

    problem: Problem
    tried: tuple[Effect, ...]
    path: tuple[Point, ...]
    rivals: tuple[Mapping[str, Point], ...]
    steps: tuple[tuple[Tried, ...], ...]
    floor: float

    @property
    def now(self) -> Point:
        """The model that was chosen."""
        return self.path[-1]

    @property
    def names(self) -> tuple[str, ...]:
        """Names of its effects, in the order of the path."""
        return tuple(_added(*pair) for pair in zip(self.path[:-1], self.path[1:], strict=True))

    @property
    def candidates(self) -> tuple[Candidate, ...]:
        """All that was tried, as rows of a table."""
        rows: list[Candidate] = []
        for position, step in enumerate(self.steps):
            chosen = self.names[position] if position < len(self.names) else ""
            rows += _rows(step, self.path[position], self.problem.unit, chosen)
        return tuple(rows)

    @property
    def failures(self) -> tuple[str, ...]:
        """One sentence an effect of a user's own that failed."""
        failed = {t.effect: t.objection for step in self.steps for t in step if t.failed}
        return tuple(
            f"The effect {name!r} was not tried: it {why}." for name, why in failed.items()
        )

    def without(self, position: int, objection: str) -> Selection:
        """The same without an effect that something speaks against, the others refitted."""
        name = self.names[position]
        later = self.path[position + 2 :]
        others = (without_effect(self.problem, point, name) for point in later)
        # Rivals of later effects were found beside what is gone.
        rivals = (*self.rivals[:position], *[dict[str, Point]()] * len(later))
        steps = list(self.steps[: len(self.path) - 1])
        steps[position] = tuple(
            replace(each, objection=objection) if each.effect == name else each
            for each in steps[position]
        )
        path = (*self.path[: position + 1], *others)
        return replace(self, path=path, rivals=rivals, steps=tuple(steps))

    def on_levels(self, levels: int) -> Selection:
        """The same models on a plane of other levels."""
        path = tuple(at_levels(self.problem, point, levels) for point in self.path)
        rivals = tuple(
            {name: at_levels(self.problem, point, levels) for name, point in own.items()}
            for own in self.rivals
        )
        return replace(self, path=path, rivals=rivals)


def _in_place_of(chain: Chain, effect: Effect, other: Effect) -> Chain:
    """A chain with one of its effects in another form."""
    return chain.with_effects(tuple(other if each is effect else each for each in chain.effects))


def _names(point: Point) -> set[str]:
    return {effect.name for effect in point.chain.effects}


def _added(before: Point, after: Point) -> str:
    (name,) = _names(after) - _names(before)
    return name


def candidate(tried: Tried, step: int, unit: float, chosen: str) -> Candidate:
    """The row of a table for what was tried.

    Arguments:
        step: how many effects the model had.
        unit: output range.
        chosen: the effect that was added there; empty if none was.
    """
    if tried.model is None or tried.evidence is None:
        return Candidate(tried.effect, step, 0.0, np.nan, {}, False, tried.objection)
    accepted = tried.effect == chosen and not tried.objection
    why = f"{chosen} does more" if chosen else "whole models with it predict no better"
    return Candidate(
        tried.effect,
        step,
        tried.evidence.gain,
        float(np.sqrt(tried.model.point.validation_mean_square)) * unit,
        tried.evidence.numbers(),
        accepted,
        "" if accepted else tried.objection or why,
    )


def _rows(tried: Iterable[Tried], beside: Point, unit: float, chosen: str) -> list[Candidate]:
    """What was tried beside a model, as rows of a table; a term more is no other effect."""
    present = _names(beside)
    return [
        candidate(each, len(present), unit, chosen) for each in tried if each.effect not in present
    ]


@dataclass(eq=False)
class Search:
    """All models of a record that were met, each computed once.

    Attributes:
        problem: the record as it is cut for the search.
        tried: the effects to try.
        floor: mean square, in squared output ranges, that does not matter.
        progress: called with a text and a share done.
        done: the share that was told last.
        met: the best model of each set of effects.
        tried_beside: what was tried beside the models that were searched on from.
        standing: whether each effect of a model does something in it, as far as that was asked.
    """

    problem: Problem
    tried: tuple[Effect, ...]
    floor: float = 0.0
    progress: Progress = in_silence
    done: float = 0.0
    met: dict[Key, Whole] = field(default_factory=dict[Key, Whole])
    tried_beside: dict[Key, tuple[Tried, ...]] = field(default_factory=dict[Key, tuple[Tried, ...]])
    standing: dict[Whole, bool] = field(default_factory=dict[Whole, bool])

    @staticmethod
    def of(
        problem: Problem,
        tried: Iterable[Effect],
        tolerance: float = 0.0,
        progress: Progress = in_silence,
    ) -> Search:
        """A search in a record.

        Arguments:
            tolerance: RMS error, in output units, that does not matter.
        """
        # Asked before the workers do, who share the problem.
        survey = replace(problem.survey, cycle_s=surveyed(problem).cycle_s)
        problem = replace(problem, survey=survey)
        # What the heights of a sensor's jumps leave open does not speak for an effect.
        floor = (tolerance**2 + wander_rms(problem.record) ** 2) / problem.unit**2
        return Search(problem, tuple(tried), floor, progress)

    def compare(self, simple: Whole, rich: Whole) -> Evidence:
        """Evidence for one model against another."""
        gain = gain_of(simple.point, rich.point, self.floor)
        return Evidence.of(simple.errors, rich.errors, gain, self.floor)

    def run(
        self, root: Whole, watch: Callable[[Point, tuple[Candidate, ...]], object] | None = None
    ) -> Selection:
        """Search from a model without effects on, and choose.

        Arguments:
            watch: called with the best model of each size, and with what was tried beside the best
                one of the size before.
        """
        frontier = [self._meet(root)]
        for size in range(MOST_EFFECTS + 1):
            lead, found = frontier[0], dict[Key, Whole]()
            for position, model in enumerate(frontier):
                span = [(size + k / len(frontier)) / (size + 1.5) for k in (position, position + 1)]
                for each in self.beside(model, *span):
                    if each.model is None or len(each.model.names) > MOST_EFFECTS:
                        continue
                    if not self.compare(model, each.model).against:
                        found[each.model.key] = self.met[each.model.key]
            if not found:
                break
            self._meet_other_forms(min(found.values(), key=lambda each: each.error))
            ranked = sorted((self.met[key] for key in found), key=lambda each: each.error)[:BEAM]
            near = ranked[0].error + np.log(REACH)
            frontier = [each for each in ranked if each.error < near]
            if watch is not None:
                added = min(set(frontier[0].names) - set(lead.names), default="")
                rows = _rows(self.beside(lead), lead.point, self.problem.unit, added)
                watch(frontier[0].point, tuple(rows))
            if self.is_noise(frontier[0]):
                break
        return self._chosen()

    def best_beside(self, model: Whole) -> Point | None:
        """The best model with an effect beside a model that nothing speaks against, if any."""
        self._meet(model)
        passing = [t.model for t in self.beside(model, 0.0, 0.4) if t.model and not t.objection]
        best = min(passing, key=lambda each: each.error, default=None)
        return None if best is None else best.point

    def is_noise(self, model: Whole) -> bool:
        """Whether a model leaves so little beside the noise that nothing can be named any more."""
        noise = noise_rms(self.problem, self.filled(model)) / self.problem.unit
        least = np.full_like(model.errors, noise**2)
        return bool(Evidence.of(model.errors, least, 1.0, self.floor).against)

    def filled(self, model: Whole) -> Point:
        """A model with its regressors."""
        point = model.point
        return evaluate(self.problem, point.chain, point.values, point.strength, point)

    def beside(self, model: Whole, begin: float = 0.9, end: float = 0.95) -> tuple[Tried, ...]:
        """What comes of each effect beside a model, and of a term more in each that it has.

        Arguments:
            begin, end: share of all work that is done before and after.
        """
        if model.key not in self.tried_beside:
            present = set(model.names)
            left = [effect for effect in self.tried if effect.name not in present]
            every, point = [*left, *model.point.chain.effects], self.filled(model)
            found: list[Tried] = []
            work = on_all_cores(lambda effect: self._tried(model, point, effect), every)
            for position, (effect, tried) in enumerate(zip(every, work, strict=True)):
                self.done = max(self.done, begin + (end - begin) * position / len(every))
                self.progress(f"tried {effect.name}", self.done)
                if tried is not None:
                    if tried.model is not None:
                        self._meet(tried.model)
                    found.append(tried)
            self.tried_beside[model.key] = tuple(found)
        return self.tried_beside[model.key]

    def _tried(self, model: Whole, point: Point, effect: Effect) -> Tried | None:
        """An effect beside a model, or with a term more in it; None if it has none.

        Arguments:
            point: the model with its regressors.
        """
        name, problem = effect.name, self.problem
        is_new = effect not in point.chain.effects
        if is_new and (reason := self._why_not(point, effect)):
            return Tried(name, None, None, reason)
        try:
            trial = roughly_with(problem, point, effect) if is_new else self._larger(point, effect)
            if trial is None:
                return None
            rough = Whole.of(problem, trial)
            evidence = self.compare(model, rough)
            log_gain = (model.error - rough.error) / 2
            if not max(log_gain, evidence.gain) > WORTH_SETTLING:
                return Tried(name, rough, evidence, evidence.against)
            trial = refit(problem, trial)
            whole = Whole.of(problem, trial)
        except (FloatingPointError, np.linalg.LinAlgError) as error:
            return Tried(name, None, None, f"could not be fitted: {error}")
        except Exception as error:
            if type(effect).__module__.startswith("preisach_jax."):
                raise
            # A user's own effect must not take the diagnosis of the others with it.
            return Tried(name, None, None, f"failed: {type(error).__name__}: {error}", failed=True)
        evidence = self.compare(model, whole)
        against = evidence.against
        if against and not replace(self, floor=0.0).compare(model, whole).against:
            against = WITHIN_WHAT_DOES_NOT_MATTER
        against = against or implausible(problem, trial, name)
        against = against or by_chance(problem, trial, name)
        return Tried(name, whole, evidence, against)

    def _why_not(self, point: Point, effect: Effect) -> str:
        """Why an effect cannot be tried beside a model; empty if it can."""
        if reason := untellable(self.problem, effect):
            return reason
        if point.chain.signed and feeds_back(effect):
            return NO_UNIQUE_OUTPUT
        if isinstance(effect, OfColumn) and np.ptp(self.problem.record.aux[effect.column]) == 0:
            value = self.problem.record.aux[effect.column][0]
            return f"the column is constant ({value:g}): nothing can be seen"
        return ""

    def _larger(self, point: Point, effect: Effect) -> Point | None:
        """A model with a term more in one of its effects; None if that has none."""
        name = effect.name
        found = effect.enlarged(self.problem.survey_of(point, effect), point.values[name])
        if found is None:
            return None
        more, starts = found
        chain = _in_place_of(point.chain, effect, more)
        if len(starts) > MOST_STARTS:
            starts = self._sized(point, chain, more, effect, starts)
        return best_start(self.problem, point, chain, name, starts, MOST_STARTS)

    def _sized(
        self,
        point: Point,
        chain: Chain,
        more: Effect,
        effect: Effect,
        starts: Sequence[dict[str, float]],
    ) -> list[dict[str, float]]:
        """The starts of a term that explain most of a residual, each in the size that suits it."""
        known = {parameter.name for parameter in effect.parameters()}
        sizes = [p for p in more.parameters() if p.name not in known and not p.log]
        projection = Projection(self.problem, point)
        changes = changes_of_output(
            self.problem, point, point.chain, chain, point.coefficients(), more.name, list(starts)
        )
        found: list[tuple[float, dict[str, float]]] = []
        for start, change in zip(starts, changes, strict=True):
            seen = projection.see(change, start)
            if np.isfinite(seen.deviation):
                sized = {p.name: p.from_search(start[p.name] * seen.size) for p in sizes}
                left = seen.size * seen.rms * np.sqrt(1 - seen.absorbed)
                found.append((float(left), {**start, **sized}))
        found.sort(key=lambda each: -abs(each[0]))
        return [start for _, start in found[:MOST_STARTS]] or list(starts[:MOST_STARTS])

    def _meet(self, model: Whole) -> Whole:
        """A model, or that of the same effects which was met before and predicts better."""
        known = self.met.get(model.key)
        if known is None or model.error < known.error:
            self.met[model.key] = model
        return self.met[model.key]

    def _meet_other_forms(self, model: Whole) -> None:
        """Try the forms of effects again beside what was added after them."""
        if len(model.names) < 2:
            return
        point = self.filled(model)
        for present in point.chain.effects:
            values = point.values[present.name]
            for form in self.problem.forms_of(present, point):
                known = {parameter.name for parameter in form.parameters()} == values.keys()
                if not known or eqx.tree_equal(form, present):
                    continue
                chain = _in_place_of(point.chain, present, form)
                trial = best_start(self.problem, point, chain, present.name, [values], 1)
                if Whole.of(self.problem, trial).error < model.error:
                    self._meet(Whole.of(self.problem, refit(self.problem, trial)))

    def _without(self, model: Whole, name: str) -> Whole:
        """A model that lacks one of its effects."""
        kept = tuple(each for each in model.key if each[0] != name)
        if kept not in self.met:
            self._meet(Whole.of(self.problem, without_effect(self.problem, model.point, name)))
        return self.met[kept]

    def _smaller(self, model: Whole) -> list[Whole]:
        """The models that lack an effect, or a term of one."""
        found = [self._without(model, name) for name in model.names]
        for effect in model.point.chain.effects:
            for less, start in effect.reduced(model.point.values[effect.name]):
                chain = _in_place_of(model.point.chain, effect, less)
                trial = best_start(self.problem, model.point, chain, effect.name, [start], 1)
                found.append(self._meet(Whole.of(self.problem, trial)))
        return found

    def _stands(self, model: Whole) -> bool:
        """Whether each effect of a model is plausible, and does something beside the others."""
        if model not in self.standing:
            point = self.filled(model)
            self.standing[model] = not any(
                implausible(self.problem, point, name) for name in model.names
            ) and not any(self.compare(less, model).against for less in self._smaller(model))
        return self.standing[model]

    def _best(self) -> Whole:
        """The smallest model that predicts as well as the best one, of those that stand."""
        ranked = sorted(self.met.values(), key=lambda model: model.error)
        best = next(model for model in ranked if self._stands(model))
        alike = [m for m in ranked if m is best or self.compare(m, best).against]

        def cost(model: Whole) -> tuple[int, int, int, float]:
            effects = model.point.chain.effects
            special = sum(effect.special for effect in effects)
            return len(effects), special, sum(n for _, n in model.key), model.error

        return next(model for model in sorted(alike, key=cost) if self._stands(model))

    def _chosen(self) -> Selection:
        """The best model, once everything was tried that could take the place of an effect."""
        best = self._best()
        while True:
            self._meet_other_forms(best)
            for name in best.names:
                self.beside(self._without(best, name))
            other = self._best()
            if other is best:
                break
            best = other
        path, names = [best], list(best.names)
        while names:
            # Last comes the effect without which the model predicts best.
            gone = min(names, key=lambda name: self._without(path[0], name).error)
            names.remove(gone)
            path.insert(0, self._without(path[0], gone))
        selection = Selection(
            self.problem,
            self.tried,
            tuple(model.point for model in path),
            (),
            (
                *(self._with_chosen(*pair) for pair in itertools.pairwise(path)),
                () if best.names and self.is_noise(best) else self.beside(best),
            ),
            self.floor,
        )
        rivals = tuple(self._rivals(best, name) for name in selection.names)
        return replace(selection, rivals=rivals)

    def _with_chosen(self, before: Whole, after: Whole) -> tuple[Tried, ...]:
        """What was tried beside a model, with the effect that was chosen as it was chosen."""
        (name,) = set(after.names) - set(before.names)
        chosen = Tried(name, after, self.compare(before, after), "")
        return tuple(chosen if each.effect == name else each for each in self.beside(before))

    def _rivals(self, best: Whole, name: str) -> dict[str, Point]:
        """The models that predict as well as the best one with another effect in place of one."""
        rest = self._without(best, name)
        found: dict[str, Point] = {}
        for tried in self.beside(rest):
            if tried.model is None or tried.objection or tried.effect in best.names:
                continue
            rival = self.met[tried.model.key]
            if self.compare(rival, best).against:
                found[tried.effect] = rival.point
        return found
