"""The diagnosis: screen all effects, add the best that opens both locks, repeat, stop."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from preisach_jax.confidence import differs_from_nothing, with_grid_error
from preisach_jax.diagnosis.budget import (
    discretisation_rms,
    error_budget,
    refined_levels,
)
from preisach_jax.diagnosis.candidates import try_beside
from preisach_jax.diagnosis.evidence import LEAST_GAIN, compare
from preisach_jax.diagnosis.judgement import alike, judged
from preisach_jax.diagnosis.limits import limits
from preisach_jax.diagnosis.margin import close_calls
from preisach_jax.diagnosis.remainder import relations
from preisach_jax.diagnosis.result import Budget, Candidate, Diagnosis, Finding, Rung
from preisach_jax.diagnosis.tellable import notes as untellable_notes
from preisach_jax.diagnosis.tolerance import tolerance_of
from preisach_jax.diagnosis.trial import (
    NOT_ON_ALL_ROWS,
    TOO_LITTLE,
    TOO_SLIGHT,
    WITHOUT_A_LAW,
    Row,
    Trial,
    accepted_rows,
    failures,
    given_up_rows,
    with_rival,
)
from preisach_jax.diagnosis.wording import located, next_experiment, notes_on, sentence
from preisach_jax.effects import OF_COLUMNS, library, resolve
from preisach_jax.effects.base import Effect
from preisach_jax.effects.gain import Gain
from preisach_jax.fit import (
    FINAL_ROWS,
    Fit,
    Progress,
    at_levels,
    aux_units,
    begun,
    checked_levels,
    double_precision,
    finished,
    freed_of_spikes,
    in_reduced_basis,
    in_silence,
    moved_to,
    on_a_coarser_plane,
    on_all_rows,
    settled,
    with_effect,
    with_signs,
    without_effect,
)
from preisach_jax.identify import Point, Problem, evaluate
from preisach_jax.model import Model
from preisach_jax.record import Record
from preisach_jax.record.joined import as_one

Watch = Callable[[Fit, tuple[Candidate, ...]], object]
"""Called with a fit on the way of a diagnosis, and with all that was tried before it."""

BEGINNING_WORK, ROUND_WORK, RUNG_WORK, CLOSING_WORK = 1.0, 4.0, 3.0, 3.0
"""Typical seconds of the plain model, a round of all effects, a fit to all rows, and the rest."""

MOST_EFFECTS = 4

GAIN_TO_LOOK_AHEAD = 0.2
"""Relative fall of the held-out mean square from which on an effect that does not pass alone is
tried beside a second one."""

MOST_LOOKED_BEHIND = 2
"""Effects beside which a second one is looked for."""

MOST_MISSED = 0.3
"""RMS error of a final model, over the spread of the output, beyond which no effect is named."""

MOST_LEFT_BY_THE_LAWLESS = 0.1
"""Unexplained RMS error, over that which a form without a law takes up, beyond which it is no name
for what was there."""

LEAST_BESIDE_THE_UNEXPLAINED = 0.1
"""Mean square that the last effect must take away, over that which stays unexplained beside it."""

REFINEMENT_PAYS = 0.1
"""Relative fall of the held-out mean square for which a finer plane is kept."""


def diagnose(
    record: Record | Sequence[Record],
    effects: Iterable[str | Effect] | None = None,
    levels: int | None = None,
    *,
    hold_out: Sequence[Record] = (),
    tolerance: str | None = None,
    progress: Progress | None = None,
    watch: Watch | None = None,
) -> Diagnosis:
    """Find out which physical effects a rate-independent model of a record lacks.

    Every effect whose signature, freed from what the density can take up, is in the residual is
    refitted jointly with the density and judged on held-out blocks.  The best is
    added if both locks open (`evidence`), and the search goes on from there; effects that later
    ones have made superfluous are taken out again.

    Arguments:
        record: the measurement, or several of one machine: one model, with a memory for each.
        effects: effects to try, by name or as objects; by default the library, without those that
            are tried on request, and all auxiliary columns.  To try one's own beside the library:
            `[*pj.effects().values(), Mine()]`.
        levels: levels N of the plane; by default 25, and finer where that pays.
        hold_out: further records that are held out whole, in place of blocks of the others.
        tolerance: an error that does not matter, in per cent of the stroke (`"0.1%"`) or with the
            output's unit (`"20 nm"`): what is below it is told, and does not change the verdict.
        progress: called with a text and a share done.
        watch: called with each fit on the way, and with what was tried beside the one before.

    Returns:
        The diagnosis.

    Raises:
        InputError: if what is given is no record, several of them do not belong together, an
            effect is unknown, levels is not an integer from 2 to 200, or the
            tolerance has no unit, another one than the output, or is not below the stroke.

    Example:
        >>> import numpy as np, preisach_jax as pj
        >>> t = np.arange(3000) / 100
        >>> u = 5 - 5 * np.cos(t * (1 + t / 40))
        >>> z = u**1.1 + 0.01 * np.random.default_rng(0).normal(size=3000)
        >>> pj.diagnose(pj.Record.from_arrays(t, u, z), ["drift"], levels=9).verdict
        'adequate'
    """
    record = as_one(record, hold_out, "diagnose")
    tried = effects_to_try(record, effects)
    least = tolerance_of(tolerance, record)
    with double_precision():
        return freed_of_spikes(
            record,
            lambda given: _Search(given, tried, levels, least, progress or in_silence, watch).run(),
            lambda found: found.steps[-1],
        )


def effects_to_try(record: Record, effects: Iterable[str | Effect] | None) -> tuple[Effect, ...]:
    """The effects that are asked for, or the library; with one for each auxiliary column."""
    everything = [name for name, effect in library().items() if not effect.on_request]
    asked: list[str | Effect] = list(everything if effects is None else effects)
    names = [item if isinstance(item, str) else item.name for item in asked]
    of_columns = [kind.prefix for kind in OF_COLUMNS if f"{kind.prefix}:COL" in names]
    # The library's placeholders: one effect a column.
    asked = [item for item, name in zip(asked, names, strict=True) if not name.endswith(":COL")]
    for prefix in of_columns:
        each = [f"{prefix}:{column}" for column in record.aux]
        asked += [name for name in each if name not in names]
    return resolve(asked, aux_units(record))


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


class _Search:
    """Forward selection with a backward check, on one record."""

    def __init__(
        self,
        record: Record,
        tried: tuple[Effect, ...],
        levels: int | None,
        tolerance: float,
        progress: Progress,
        watch: Watch | None,
    ):
        self.tolerance = tolerance
        self.levels_are_given = levels is not None
        self.levels = checked_levels(levels)
        self.tried = tried
        self._report = progress
        self._watch = watch
        self._reported = 0.0
        self.progress("fitting the rate-independent model", 0.0)
        self.record, problem, point = begun(record, self.levels)
        self.whole_plane = problem
        self.problem, point = in_reduced_basis(problem, point)
        self.path: list[Point] = [point]
        self.finer: Point | None = None
        self.accepted: list[Named] = []
        self.trials: list[Row] = []

    def run(self) -> Diagnosis:
        self._refine_plane()
        self._show()
        while len(self.accepted) < MOST_EFFECTS:
            if not (self._add_best() or self._add_pair()):
                break
            self._check_backward()
            # A finer plane may bring out what the coarse one has hidden.
            self._refine_plane()
            self._show()
        self._settle_families()
        self._give_up_what_explains_too_little()
        return self._conclude()

    def progress(self, text: str, done: float) -> None:
        """Tell how far the search is; it never goes back, whatever the search decides to try."""
        self._reported = max(self._reported, done)
        self._report(text, self._reported)

    def _show(self) -> None:
        """Let who watches see the present model, on all rows."""
        if self._watch is None:
            return
        self._watch(on_all_rows(self.record, self.problem, self.now), self._candidates())

    def _candidates(self) -> tuple[Candidate, ...]:
        return tuple(
            trial.candidate(self.problem.unit, accepted, better)
            for trial, accepted, better in self.trials
        )

    @property
    def now(self) -> Point:
        return self.path[-1]

    def _refine_plane(self) -> bool:
        """Go to finer planes while the held-out error of the present model falls."""
        refined = False
        while True:
            self.finer = None
            finer = refined_levels(min(len(self.record), FINAL_ROWS), self.now.chain.plane.levels)
            if finer is None:
                return refined
            self.progress(f"trying a plane of {finer} levels", self._done(len(self.accepted)))
            self.finer = at_levels(self.problem, self.now, finer)
            fall = 1 - self.finer.validation_mean_square / self.now.validation_mean_square
            if self.levels_are_given or not fall > REFINEMENT_PAYS:
                return refined
            before = [at_levels(self.problem, point, finer) for point in self.path[:-1]]
            self.path = [*before, self.finer]
            refined = True

    def _done(self, rounds: float, rungs: float = 0.0, closing: float = 0.0) -> float:
        """Share of the work done, if no further effect is found.

        Arguments:
            rounds: how often all effects have been tried.
            rungs: how many models have been fitted to all rows.
            closing: share of budget and limits that is done.
        """
        steps = len(self.accepted) + 1
        done = BEGINNING_WORK + ROUND_WORK * rounds + RUNG_WORK * rungs + CLOSING_WORK * closing
        return done / (BEGINNING_WORK + (ROUND_WORK + RUNG_WORK) * steps + CLOSING_WORK)

    def _add_best(self) -> bool:
        present = {effect.name for effect in self.now.chain.effects}
        left = [effect for effect in self.tried if effect.name not in present]
        # On a refined plane, only what did not make things much worse on the coarser one.
        hopeless = {
            trial.effect.name
            for trial, _, _ in self.trials
            if trial.step == len(self.accepted) and trial.hopeless
        }
        left = [effect for effect in left if effect.name not in hopeless]
        rounds = len(self.accepted)
        self.progress(f"trying {len(left)} effects", self._done(rounds))
        trials = try_beside(
            self.problem,
            self.now,
            left,
            len(self.accepted),
            lambda text, share: self.progress(text, self._done(rounds + 0.9 * share)),
        )
        trials, best, self.path[-1] = judged(
            self.problem,
            self.now,
            trials,
            lambda text: self.progress(text, self._done(rounds + 0.9)),
            self.tolerance,
        )
        name = best.effect.name if best is not None else ""
        # Of an effect that is tried again on a finer plane, the last trial counts.
        again = {(trial.effect.name, trial.step) for trial in trials}
        kept = [row for row in self.trials if (row[0].effect.name, row[0].step) not in again]
        self.trials = kept + [(trial, trial is best, name) for trial in trials]
        if best is None:
            return False
        # What opens both locks may stand in the family, even if its amounts alone are uncertain.
        others = [
            t for t in trials if isinstance(t, Trial) and t.opens_both_locks and t is not best
        ]
        # What scales the loop moves it as well: that alone does not make it a rival.
        others = [t for t in others if any(t.certain) or not isinstance(t.effect, Gain)]
        like_the_best = [o for o in others if alike(self.problem, best.point, o.point)]
        rivals = {o.effect.name: o.point for o in like_the_best}
        self.accepted.append(Named(best, rivals))
        self.path.append(best.point)
        return True

    def _add_pair(self) -> bool:
        """Look ahead by one effect where nothing passes alone but something promises much.

        Of two effects of like size each leaves what the other does, so that neither gain is alike
        over the blocks.  Both are added if each passes beside the other.
        """
        if len(self.accepted) + 2 > MOST_EFFECTS:
            return False
        step = len(self.accepted)
        here = [trial for trial, _, _ in self.trials if isinstance(trial, Trial)]
        promising = [t for t in here if t.step == step and t.evidence.gain >= GAIN_TO_LOOK_AHEAD]
        promising.sort(key=lambda trial: trial.point.validation_mean_square)
        for first in promising[:MOST_LOOKED_BEHIND]:
            second = self._second_beside(first)
            # Forms without a law take up a part of whatever another one leaves.
            if second is None or any(effect.lawless for effect in second.point.chain.effects):
                continue
            without = without_effect(self.problem, second.point, first.effect.name)
            evidence = compare(self.problem, without, second.point)
            certain = differs_from_nothing(self.problem, second.point, first.effect.name)
            beside = replace(first, point=second.point, evidence=evidence, certain=certain)
            _, passed, _ = judged(
                self.problem, without, [beside], lambda text: None, self.tolerance
            )
            if passed is None:
                continue
            self.trials = accepted_rows(self.trials, [first.effect.name], step)
            self.trials += [(second, True, second.effect.name)]
            self.accepted += [Named(replace(beside, point=first.point), {}), Named(second, {})]
            self.path += [first.point, second.point]
            return True
        return False

    def _second_beside(self, first: Trial) -> Trial | None:
        """The best effect that passes beside one that does not pass alone."""
        present = {effect.name for effect in first.point.chain.effects}
        left = [effect for effect in self.tried if effect.name not in present]
        self.progress(f"looking beside {first.effect.name}", self._done(len(self.accepted) + 0.9))
        trials = try_beside(self.problem, first.point, left, first.step + 1, in_silence)
        _, second, _ = judged(self.problem, first.point, trials, lambda text: None, self.tolerance)
        return second

    def _check_backward(self) -> None:
        """Take out effects that those added after them have made superfluous."""
        for named in self.accepted[:-1]:
            without = without_effect(self.problem, self.now, named.name)
            if compare(self.problem, without, self.now).against:
                self.accepted.remove(named)
                names = [kept.name for kept in self.accepted]
                self.path = [self.path[0], *self._ladder(names[:-1]), without]
                return

    def _ladder(self, names: list[str]) -> list[Point]:
        points: list[Point] = []
        point = self.path[0]
        for name in names:
            effect = next(effect for effect in self.tried if effect.name == name)
            point = with_effect(self.problem, point, effect)
            points.append(point)
        return points

    def _conclude(self) -> Diagnosis:
        problem = Problem.of(self.record, FINAL_ROWS)
        small = problem.reduced(self.problem)
        fits = self._fits(problem, small)
        other = self.finer or on_a_coarser_plane(self.problem, self.now)
        discretisation = discretisation_rms(self.problem, self.now, other)
        rounds = len(self.accepted) + 1
        self.progress("measuring the error budget", self._done(rounds, rounds))
        budget = error_budget(problem, fits[-1], discretisation)
        if self._give_up_the_lawless(budget) or self._give_up_the_slight(budget, fits):
            return self._conclude()
        self.progress("limiting what was not found", self._done(rounds, rounds, 0.3))
        spoken_of = {name for named in self.accepted for name in (named.name, *named.rivals)}
        absent = [effect for effect in self.tried if effect.name not in spoken_of]
        # What the grid of the plane adds must not pass for an effect: the finest plane is best.
        finest = with_signs(self.whole_plane, self.finer or self.now)
        bounds = limits(self.whole_plane, finest, absent)
        parameters = with_grid_error(fits[-1].model.parameters, self.now, other)
        alternatives = self._alternatives(problem, small)
        met = budget.is_met or budget.unexplained <= self.tolerance
        if self.accepted:
            verdict = "explained" if met else "partly_explained"
        else:
            verdict = "adequate" if met else "unexplained"
        model = replace(fits[-1].model, parameters=parameters)
        model = model.with_budget(budget.noise, budget.discretisation)
        fits[-1] = replace(fits[-1], model=model)
        findings, candidates = self._findings(fits), self._candidates()
        close = close_calls(findings, candidates, budget, met)
        return Diagnosis(
            verdict=verdict,
            sentence=sentence(verdict, findings, budget, fits, self.tolerance, close),
            close=close,
            findings=findings,
            ladder=tuple(Rung.of(fit) for fit in fits),
            budget=budget,
            candidates=candidates,
            limits=bounds,
            alternatives=alternatives,
            next_experiment=next_experiment(verdict, findings, self.tried),
            located="" if met else located(self.record, fits[-1]),
            remainder=() if met else relations(self.record, fits[-1].residual),
            notes=(
                *notes_on(self.record, model),
                *untellable_notes(problem, self.tried),
                *failures(self.trials),
            ),
            steps=tuple(fits),
        )

    def _give_up_the_lawless(self, budget: Budget) -> bool:
        """Take back a form without a law that leaves much unexplained beside what it takes up.

        Slow waves follow a part of whatever is slow: of a sensor that jumps, or a wandering gain.
        """
        for position, named in enumerate(self.accepted):
            effect = next(e for e in self.now.chain.effects if e.name == named.name)
            taken = float(np.std(self.now.share_of(named.name)) * self.problem.unit)
            if effect.lawless and budget.unexplained > MOST_LEFT_BY_THE_LAWLESS * taken:
                self.accepted.pop(position)
                self.trials = given_up_rows(self.trials, [named.trial], WITHOUT_A_LAW)
                names = [kept.name for kept in self.accepted]
                self.path = [self.path[0], *self._ladder(names)]
                self.finer = None
                return True
        return False

    def _give_up_the_slight(self, budget: Budget, fits: list[Fit]) -> bool:
        """Take back a last effect that does little beside what stays unexplained.

        Beside physics that the library does not have, whatever bends the model a little towards it
        passes the tests.
        """
        if not self.accepted or budget.is_met or budget.unexplained <= self.tolerance:
            return False
        taken = fits[-2].rms_validation ** 2 - fits[-1].rms_validation ** 2
        if taken >= LEAST_BESIDE_THE_UNEXPLAINED * budget.unexplained**2:
            return False
        given_up = self.accepted.pop().trial
        self.path.pop()
        self.finer = None
        self.trials = given_up_rows(self.trials, [given_up], TOO_SLIGHT)
        return True

    def _settle_families(self) -> None:
        """Ask of every rival again whether it could stand in the final model, all refitted.

        What one effect alone could not tell may show beside the others.  A rival that does better
        now takes the place.
        """
        rounds = len(self.accepted) + 1
        for position, named in enumerate(self.accepted):
            self.progress(f"asking what could stand in place of {named.name}", self._done(rounds))
            present = {effect.name for effect in self.now.chain.effects}
            rivals = {
                name: self._in_place_of(named.name, name, point)
                for name, point in named.rivals.items()
                if name not in present
            }
            better = [
                self._try_again(named, name, point)
                for name, point in rivals.items()
                if not compare(self.problem, self.now, point).against
            ]
            certain = [trial for trial in better if any(trial.certain)]
            if certain:
                rivals[named.name] = self.now
                again = min(certain, key=lambda trial: trial.point.validation_mean_square)
                name = again.effect.name
                self.trials = with_rival(self.trials, named.trial, again)
                self.accepted[position] = Named(again, {})
                names = [each.name for each in self.accepted]
                self.path = [self.path[0], *self._ladder(names[:-1]), rivals.pop(name)]
            kept = {name: p for name, p in rivals.items() if alike(self.problem, self.now, p)}
            self.accepted[position] = Named(self.accepted[position].trial, kept)

    def _give_up_what_explains_too_little(self) -> None:
        """Name nothing where the final model still misses much of the output.

        Where hysteresis is not what makes the output, the first effect that bends the model
        towards it is seldom what is there: a damper's force looks like a displacement delayed.
        """
        measured = self.problem.target / self.problem.unit
        if self.now.validation_mean_square <= MOST_MISSED**2 * measured.var():
            return
        given_up = [named.trial for named in self.accepted]
        self.trials = given_up_rows(self.trials, given_up, TOO_LITTLE)
        self.accepted, self.path, self.finer = [], self.path[:1], None

    def _in_place_of(self, name: str, rival: str, point: Point) -> Point:
        """The present model with a rival, as it is at another point, in place of an effect."""
        effect = next(e for e in point.chain.effects if e.name == rival)
        effects = tuple(effect if e.name == name else e for e in self.now.chain.effects)
        values = {**self.now.values, rival: point.values[rival]}
        del values[name]
        chain = self.now.chain.with_effects(effects)
        strength = self.now.strength
        return settled(self.problem, evaluate(self.problem, chain, values, strength, self.now))

    def _try_again(self, named: Named, rival: str, point: Point) -> Trial:
        """A rival as a trial of its own, judged against the model that has neither."""
        without = without_effect(self.problem, self.now, named.name)
        effect = next(effect for effect in self.tried if effect.name == rival)
        evidence = compare(self.problem, without, point)
        certain = differs_from_nothing(self.problem, point, rival)
        return Trial(effect, named.trial.step, point, evidence, certain)

    def _alternatives(self, problem: Problem, small: Problem) -> dict[str, Model]:
        """The model with each rival in place of the effect that was named."""
        return {
            name: finished(problem, moved_to(small, point), self.record).model
            for named in self.accepted
            for name, point in named.rivals.items()
        }

    def _fits(self, problem: Problem, small: Problem) -> list[Fit]:
        """The fit of each step; last effects that help too little on all rows are given up."""
        fits: list[Fit] = []
        for position, point in enumerate(self.path):
            self.progress("fitting all rows", self._done(len(self.path), position))
            if fits:  # regressors of all rows are great: those of one model at a time are enough
                fits[-1] = replace(fits[-1], point=fits[-1].point.slim)
            fits.append(finished(problem, moved_to(small, point), self.record))
        # The first lock, on all rows.
        most = (1 - LEAST_GAIN) ** 0.5
        while len(fits) > 1 and not fits[-1].rms_validation <= most * fits[-2].rms_validation:
            given_up = self.accepted.pop().trial
            self.path.pop()
            self.finer = None
            fits.pop()
            self.trials = given_up_rows(self.trials, [given_up], NOT_ON_ALL_ROWS)
        return fits

    def _findings(self, fits: list[Fit]) -> tuple[Finding, ...]:
        findings: list[Finding] = []
        for position, named in enumerate(self.accepted):
            before, after = fits[position], fits[position + 1]
            evidence = compare(self.problem, self.path[position], self.path[position + 1])
            findings.append(
                Finding(
                    named.name,
                    (named.name, *named.rivals),
                    fits[-1].model.parameters[named.name],
                    before.rms_validation,
                    after.rms_validation,
                    evidence.numbers(),
                )
            )
        return tuple(findings)
