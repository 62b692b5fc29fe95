"""Terms that an effect of a model lacks: a second mode of a resonance, and so on."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import equinox as eqx
import numpy as np

from preisach_jax.chain import Chain
from preisach_jax.diagnosis.evidence import compare
from preisach_jax.diagnosis.judgement import LEAST_GAIN_BESIDE, alike, judged, judged_beside
from preisach_jax.diagnosis.plausible import out_of_law
from preisach_jax.diagnosis.step import Named, Step
from preisach_jax.diagnosis.trial import HOPELESS, Row, Trial, accepted_rows
from preisach_jax.effects.base import Effect, Parameter
from preisach_jax.effects.modal import Modal
from preisach_jax.fit import settled, without_effect
from preisach_jax.identify import Point, Problem, evaluate, refine
from preisach_jax.identify.signature import Projection, changes_of_output

LEAST_GAIN_OF_A_TERM = 0.1
"""Relative fall of the held-out mean square from which on an effect gets a term more."""

HOPE = 0.01
"""Relative fall of the held-out mean square that a start must promise to be refined: of a mode that
rings long, a start beside its place promises little."""

MOST_STARTS = 3
"""Starts of a term that are refined."""

GAIN_TO_ENLARGE = 0.2
"""The same from which on an effect that does not pass is tried with a term more."""

MOST_BESIDE = 4
"""Effects that do not pass beside which those of the model are tried with a term more."""

MAY_LEAVE = 0.5
"""Held-out mean square that an effect and a term added at once may leave, over that of the model
without them."""


def grown(step: Step) -> Step | None:
    """The step with the effect enlarged that gains most by it; None if none passes the tests.

    The effects are those of the model; each is refitted with a term more, jointly with the rest,
    must pass the two tests against the present model, and must not contradict what it is.
    """
    best: tuple[Effect, Point] | None = None
    for effect in step.now.chain.effects:
        found = _enlarged(step, effect)
        if found is None:
            continue
        more, rich = found
        evidence = compare(step.problem, step.now, rich)
        if evidence.against or evidence.gain < LEAST_GAIN_OF_A_TERM:
            continue
        if _at_a_bound(effect, more, rich) or out_of_law(step.problem, rich, effect.name):
            continue
        if best is None or rich.validation_mean_square < best[1].validation_mean_square:
            best = found
    return None if best is None else _with(step, *best)


def with_larger(step: Step, tolerance: float) -> tuple[Step, bool]:
    """The step with an effect that passes with a term more, and not with its first one alone.

    One mode of two leaves so much where the other one rings that its gain differs from block to
    block.

    Arguments:
        tolerance: RMS error, in output units, that does not matter.
    """
    for first in step.fitted(step.position, GAIN_TO_ENLARGE):
        larger = grown(step.with_named(first))
        if larger is None or larger.named[-1].trial is first:
            continue
        evidence = compare(step.problem, step.now, larger.now)
        larger_trial = larger.named[-1].trial
        trial = replace(larger_trial, evidence=evidence, certain=first.certain, objection="")
        _, passed, _ = judged(step.problem, step.now, [trial], lambda text: None, tolerance)
        if passed is None:
            continue
        rows = [row for row in step.trials if row[0] is not first]
        added: Row = (trial, True, trial.effect.name)
        named = (*step.named, Named(trial, {}))
        return replace(larger, named=named, trials=(*rows, added)), True
    return step, False


def with_larger_beside(
    step: Step, tolerance: float, other: Step | None = None
) -> tuple[Step, bool]:
    """The step with an effect more, beside which one of its effects is enlarged, and whether so.

    Of two modes behind a lag, the one that is found first is damped until it is about as late as
    all three: neither the lag nor the second mode helps without the other.

    Arguments:
        tolerance: RMS error, in output units, that does not matter.
    """
    problem, now, position = step.problem, step.now, step.position
    most = np.inf if other is None else MAY_LEAVE * other.now.validation_mean_square
    if not step.named or step.is_within_budget:
        return step, False
    levels = now.chain.plane.levels
    fitted = [t for t in step.fitted(position, -HOPELESS) if t.point.chain.plane.levels == levels]
    both: list[Step] = []
    for first in fitted[:MOST_BESIDE]:
        larger = grown(step.with_named(first))
        if larger is None or larger.named[-1].trial is not first:
            continue
        if larger.now.validation_mean_square <= MAY_LEAVE * now.validation_mean_square:
            both.append(larger)
    both.sort(key=lambda each: each.now.validation_mean_square)
    for found in both:
        larger = without_needless_modes(found)
        first, point = larger.named[-1].trial, larger.now
        if point.validation_mean_square > most:
            continue
        effect = first.effect
        without = without_effect(problem, point, effect.name)
        trial = judged_beside(
            problem, without, effect, position, point, tolerance, LEAST_GAIN_BESIDE
        )
        if trial is None:
            continue
        rivals = {
            other.named[-1].name: other.now
            for other in both
            if other is not found and alike(problem, point, other.now)
        }
        rows = accepted_rows(list(larger.trials), [effect.name], position)
        larger = _tried_again(replace(larger, trials=tuple(rows)), first, trial)
        return replace(larger, named=(*larger.named[:-1], Named(trial, rivals))), True
    return step, False


def without_needless_modes(step: Step) -> Step:
    """The step without modes that those found after them, or other effects, have made needless."""
    problem, now = step.problem, step.now
    for effect in now.chain.effects:
        if not isinstance(effect, Modal) or effect.modes < 2:
            continue
        for less, start in effect.without_each_mode(now.values[effect.name]):
            values = {**now.values, effect.name: start}
            chain = _in_place_of(now.chain, effect, less)
            point = settled(problem, evaluate(problem, chain, values, now.strength, now))
            evidence = compare(problem, point, now)
            if evidence.against or evidence.gain < LEAST_GAIN_OF_A_TERM:
                return without_needless_modes(_with(step, less, point))
    return step


def in_best_forms(step: Step) -> Step:
    """The step with the forms of its effects asked again, beside what was added after them.

    Of the forms with the same parameters, the one that leaves least on the rows held out.
    """
    problem = step.problem
    for present in step.now.chain.effects if step.position > 1 else ():
        now, pays = step.now, present.form_pays
        known = {parameter.name for parameter in present.parameters()}
        found: tuple[Effect, Point] | None = None
        for form in problem.forms_of(present, now):
            if {parameter.name for parameter in form.parameters()} != known:
                continue
            chain = _in_place_of(now.chain, present, form)
            point = now
            if not eqx.tree_equal(form, present):
                there = evaluate(problem, chain, now.values, now.strength, now)
                point = settled(problem, there)
            best = np.inf if found is None else pays * found[1].validation_mean_square
            if point.validation_mean_square < best:
                found = form, point
        if found is not None and found[1] is not now:
            step = _with(step, *found)
    return step


def _enlarged(step: Step, effect: Effect) -> tuple[Effect, Point] | None:
    """An effect of a step with a term more, and the model with it from the best of its starts."""
    now, problem = step.now, step.problem
    found = effect.enlarged(problem.survey_of(now, effect), now.values[effect.name])
    if found is None:
        return None
    more, starts = found
    chain = _in_place_of(now.chain, effect, more)

    def refined(start: dict[str, float]) -> Point:
        values = {**now.values, effect.name: start}
        return refine(problem, evaluate(problem, chain, values, now.strength), iterations=3)

    promising = (
        starts if len(starts) == 1 else _promising(problem, now, chain, effect, more, starts)
    )
    if not promising:
        return None
    trial = min(map(refined, promising), key=lambda point: point.objective)
    return (more, settled(problem, trial)) if trial.objective < now.objective else None


def _promising(
    problem: Problem,
    now: Point,
    chain: Chain,
    effect: Effect,
    more: Effect,
    starts: Sequence[dict[str, float]],
) -> list[dict[str, float]]:
    """The starts of a term that promise most to first order, each in the size that suits it."""
    projection = Projection(problem, now)
    changes = changes_of_output(
        problem, now, now.chain, chain, now.coefficients(), effect.name, list(starts)
    )
    sizes = [parameter for parameter in _gained(effect, more) if not parameter.log]
    found: list[tuple[float, dict[str, float]]] = []
    for start, change in zip(starts, changes, strict=True):
        seen = projection.see(change, start)
        if not np.isfinite(seen.deviation):
            continue
        promise, _ = projection.promised(change[:, None], np.zeros(1, dtype=bool))
        sized = {p.name: p.from_search(p.to_search(start[p.name] * seen.size)) for p in sizes}
        found.append((promise.held_out, {**start, **sized}))
    hopeful = [each for each in found if each[0] >= HOPE]
    hopeful.sort(key=lambda each: -each[0])
    return [start for _, start in hopeful[:MOST_STARTS]]


def _at_a_bound(effect: Effect, more: Effect, rich: Point) -> bool:
    """Whether a parameter that an effect has gained lies at a bound, where no such term is."""
    for parameter in _gained(effect, more):
        value = rich.values[effect.name][parameter.name]
        if not 1.001 * parameter.low < value < 0.999 * parameter.high:
            return True
    return False


def _gained(effect: Effect, more: Effect) -> list[Parameter]:
    """The parameters that an effect has gained with a term more."""
    known = {parameter.name for parameter in effect.parameters()}
    return [parameter for parameter in more.parameters() if parameter.name not in known]


def _with(step: Step, effect: Effect, point: Point) -> Step:
    """The step with an effect of its model enlarged."""
    path = (*step.path[:-1], point)
    old = next((each.trial for each in step.named if each.name == effect.name), None)
    if old is None:
        return replace(step, path=path, other=None)
    step = _tried_again(step, old, replace(old, effect=effect, point=point))
    return replace(step, path=path, other=None)


def _tried_again(step: Step, old: Trial, trial: Trial) -> Step:
    """The step with an effect that was named as it was tried later."""
    named = tuple(replace(n, trial=trial) if n.trial is old else n for n in step.named)
    rows: list[Row] = [(trial if t is old else t, added, other) for t, added, other in step.trials]
    return replace(step, named=named, trials=tuple(rows))


def _in_place_of(chain: Chain, effect: Effect, other: Effect) -> Chain:
    """A chain with one of its effects in another form."""
    return chain.with_effects(tuple(other if each is effect else each for each in chain.effects))
