"""What to measure next: the excitation on which rival models differ even when they are refitted."""

from __future__ import annotations

import csv
import io
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import permutations
from pathlib import Path

import jax.numpy as jnp
import numpy as np

from preisach_jax.chain.coefficients import Coefficients
from preisach_jax.chain.signals import ThinnedSignals, signals_of
from preisach_jax.diagnosis.excitation import Bounds, PlannedExcitation, candidates
from preisach_jax.effects.base import Effect, OfColumn, Survey, auxiliary_columns
from preisach_jax.errors import InputError, require_positive
from preisach_jax.escape import printable
from preisach_jax.files import write_files
from preisach_jax.fit import Progress
from preisach_jax.fit.stepwise import COARSE_LEVELS, base_point, double_precision, with_effect
from preisach_jax.identify.problem import Problem, thinned_rows, with_all_rows
from preisach_jax.model import Model, without_effects
from preisach_jax.quantity import number, quantity
from preisach_jax.record.core import Record

SUFFICIENT = 1.5
"""Ratio of held-out errors above which a record is said to tell two models apart."""

ROWS = 3000
"""Samples on which rivals are refitted: one number, so that what is compiled serves them all."""


@dataclass(frozen=True, eq=False)
class Design:
    """What to record next.

    Attributes:
        excitation: name of the chosen candidate.
        time: (time,) s.
        input: (time,) what to play, in `unit`; begins and ends at the low end of the range.
        unit: unit of the input.
        separations: by candidate and by pair, as in `"creep not drift"`: held-out error of the
            rival, refitted where the first one is true, over that of the first one refitted alike.
        text: what to do, in words.
        why: what it decides.
        sufficient: whether the least separation is above 1.5; true if there is but one model.
    """

    excitation: str
    time: np.ndarray
    input: np.ndarray
    unit: str
    separations: Mapping[str, Mapping[str, float]]
    text: str
    why: str
    sufficient: bool

    def rows(self) -> list[list[str]]:
        """A row of text for each pair, and in it the separation by each candidate."""
        columns = list(self.separations.values())
        pairs = list(columns[0]) if columns else []
        return [[pair, *(number(ratios[pair], 3) for ratios in columns)] for pair in pairs]

    def save(self, path: str | Path) -> None:
        """Write the excitation as CSV, columns `t_s` and `u_UNIT`, without rounding.

        Arguments:
            path: the file.

        Raises:
            InputError: if it cannot be written.
        """
        write_files({Path(path): design_csv(self)})


def design_csv(plan: Design) -> bytes:
    """An excitation as CSV, columns `t_s` and `u_UNIT`, without rounding."""
    column = f"u_{plan.unit}" if plan.unit else "u"
    rows = zip(plan.time.tolist(), plan.input.tolist(), strict=True)
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(("t_s", printable(column)))
    writer.writerows(rows)
    return text.getvalue().encode()


def design(
    models: Sequence[Model],
    noise: float,
    *,
    seconds: float | None = None,
    rate_limit: float | None = None,
    progress: Progress | None = None,
) -> Design:
    """Choose the excitation on which rival models can be told apart best.

    Of each candidate, what each rival would answer is simulated, noise is added, and all rivals
    are refitted to it jointly with the density: only what free weights and parameters cannot
    absorb separates them.  The candidate with the greatest least separation is chosen (the maximin
    rule of W. G. Hunter, A. M. Reiner, Technometrics 7 (1965) 307-323, for the rivals as a set).

    Arguments:
        models: the rivals on one range of the input, first the one that was named.
        noise: rms of what no model can explain, in output units.
        seconds: duration in s; by default that of the record of the first model, or longer if its
            greatest rate asks for that.
        rate_limit: greatest rate in input units per s; by default that of the record.
        progress: called with a text and a share done.

    Returns:
        The excitation, and how well each candidate separates each pair.

    Raises:
        InputError: if there is no model, the ranges differ, or a number cannot be used.

    Example:
        >>> import numpy as np, preisach_jax as pj
        >>> t = np.arange(3000) / 100
        >>> u = 5 - 5 * np.cos(t * (1 + t / 40))
        >>> model = pj.fit(pj.Record.from_arrays(t, u, u**1.1), levels=9).model
        >>> plan = pj.design([model], noise=0.01)
        >>> plan.excitation, float(plan.input.max()) == model.plane.high
        ('combination', True)
    """
    bounds = _bounds(models, noise, seconds, rate_limit)
    drawn = candidates(bounds)
    constant, others = _auxiliary_columns(models)
    if others or len(models) == 1:
        text, why = _varied(others) if others else _for_one(models[0])
        return _designed(bounds, drawn[-1], {}, text + _kept(constant), why, not others)
    with double_precision():
        separations = _separations(models, noise, bounds, drawn, progress)
    best = max(drawn, key=lambda each: _least(separations[each.name])[1])
    why, sufficient = _verdict(best.name, separations)
    return _designed(bounds, best, separations, _kept(constant), why, sufficient)


def _bounds(
    models: Sequence[Model], noise: float, seconds: float | None, rate_limit: float | None
) -> Bounds:
    if not models:
        raise InputError("models is empty: give at least one model")
    given = {"noise": noise, "seconds": seconds, "rate_limit": rate_limit}
    require_positive(**{name: value for name, value in given.items() if value is not None})
    if not all(np.isfinite(value) for value in given.values() if value is not None):
        raise InputError(
            f"noise, seconds and rate_limit are {tuple(given.values())}: give finite numbers"
        )
    ends = {(model.plane.low, model.plane.high) for model in models}
    if len(ends) > 1:
        raise InputError(
            f"the models have the input ranges {sorted(ends)}: give models of one record"
        )
    origin, unit = models[0].origin, models[0].units.get("input", "")
    return Bounds.of(origin.history, origin.step_s, unit, seconds, rate_limit, ends.pop())


def _designed(
    bounds: Bounds,
    chosen: PlannedExcitation,
    separations: Mapping[str, Mapping[str, float]],
    text: str,
    why: str,
    sufficient: bool,
) -> Design:
    duration, rate = quantity(bounds.seconds, "s"), quantity(bounds.rate_hz, "Hz")
    words = (
        f"Begin at {bounds.shown(bounds.low)} and play {duration} at {rate}, "
        f"{bounds.shown(bounds.low)} to {bounds.shown(bounds.high)}, nowhere faster than "
        f"{bounds.rates(bounds.fastest)}: {chosen.text}.{text}"
    )
    time = np.arange(bounds.samples) / bounds.rate_hz
    return Design(chosen.name, time, chosen.input, bounds.unit, separations, words, why, sufficient)


def _auxiliary_columns(models: Sequence[Model]) -> tuple[list[str], list[str]]:
    """Auxiliary columns that all models use, and those that only some do."""
    used = [set(auxiliary_columns(model.effects)) for model in models]
    shared = used[0].intersection(*used)
    return sorted(shared), sorted(used[0].union(*used) - shared)


def _kept(columns: Sequence[str]) -> str:
    return f" Keep {' and '.join(columns)} constant meanwhile." if columns else ""


def _varied(columns: Sequence[str]) -> tuple[str, str]:
    names = " and ".join(columns)
    return (
        f" Play it twice: once with {names} constant, and once with steps of {names} while the "
        "input rests.",
        f"no input alone shows what {names} does: only a record in which {names} moves while the "
        "input does not can tell",
    )


def _for_one(model: Model) -> tuple[str, str]:
    """What a further record is for when there is nothing to separate."""
    known = np.hypot(model.noise or 0.0, model.discretisation or 0.0)
    if model.noise is None or model.rms_validation**2 <= 2 * known**2:
        return (
            " Compare the model with it (preisach compare).",
            "there are no rivals to separate; this record shows every effect of the library once, "
            "and so tests the model where its own record did not",
        )
    return (
        " Play it three times without a change, and once more at half the speed.",
        "an error above noise and discretisation remains, and no rival explains it: repeats "
        "show what is noise, rates what is dynamic, holds what is slow",
    )


def _labels(models: Sequence[Model]) -> list[str]:
    """What tells each model from the others: its effects that not all have, or else all its own."""
    names = [[effect.name for effect in model.effects] for model in models]
    shared = set(names[0]).intersection(*names[1:])
    labels: list[str] = []
    for own in names:
        label = " + ".join([name for name in own if name not in shared] or own) or "plain"
        count = sum(other.partition(" (")[0] == label for other in labels)
        labels.append(f"{label} ({count + 1})" if count else label)
    return labels


def _separations(
    models: Sequence[Model],
    noise: float,
    bounds: Bounds,
    drawn: Sequence[PlannedExcitation],
    progress: Progress | None,
) -> dict[str, dict[str, float]]:
    """How much worse each rival does where another one is true, by candidate and pair."""
    rng = np.random.default_rng(0)
    trials = [(each, *_thinned(each, bounds)) for each in drawn]
    labels = _labels(models)
    levels = min(COARSE_LEVELS, *(model.plane.levels for model in models))
    richest = trials[-1][1:]
    coarse = [_on_coarse_plane(_without_auxiliary(model), levels, *richest) for model in models]
    found: dict[str, dict[str, float]] = {}
    for done, (excitation, record, rows) in enumerate(trials):
        if progress is not None:
            progress(f"refitting the rivals to {excitation.name}", done / len(drawn))
        errors: list[list[float]] = []
        for model in coarse:
            output = _simulated(model, record) + noise * rng.normal(size=len(record))
            problem = _problem(record, output, rows)
            errors.append([_error(problem, levels, rival.effects) for rival in coarse])
        found[excitation.name] = {
            f"{labels[truth]} not {labels[rival]}": errors[truth][rival] / errors[truth][truth]
            for truth, rival in permutations(range(len(models)), 2)
        }
    return found


def _thinned(excitation: PlannedExcitation, bounds: Bounds) -> tuple[Record, np.ndarray]:
    """A record of an excitation, and the rows of it on which rivals are refitted."""
    count = len(excitation.input)
    record = Record.from_arrays(
        np.arange(count) / bounds.rate_hz,
        excitation.input,
        np.full(count, np.nan),
        initial_memory="low",
    )
    if count <= 1.25 * ROWS:
        return record, np.arange(count)
    limit = ROWS
    while len(kept := thinned_rows(excitation.input, limit)) > ROWS:
        limit = int(0.8 * limit)
    rest = np.setdiff1d(np.arange(count), kept)
    filled = rest[np.linspace(0, len(rest) - 1, ROWS - len(kept)).astype(int)]
    return record, np.sort(np.concatenate([kept, filled]))


def _problem(record: Record, output: np.ndarray, rows: np.ndarray) -> Problem:
    """The rows of a record with its simulated output, ready for refits."""
    some = Record.from_arrays(
        record.time[rows], record.input[rows], output[rows], initial_memory="low"
    )
    problem = Problem.of(some)
    here, whole = problem.signals, signals_of(record)
    signals = ThinnedSignals(here.time, here.input, here.aux, whole, jnp.asarray(rows))
    return replace(problem, signals=signals, survey=Survey(record.duration_s, record.step_s))


def _without_auxiliary(model: Model) -> Model:
    """The model where its auxiliary columns are constant: then they are part of the offset."""
    return without_effects(model, [e.name for e in model.effects if isinstance(e, OfColumn)])


def _on_coarse_plane(model: Model, levels: int, record: Record, rows: np.ndarray) -> Model:
    """The model with its hysteresis on the plane of the refits, so that no grid error is counted.

    What remains of the density's detail beyond that plane is in the noise that the user states.
    """
    bare = without_effects(model, [effect.name for effect in model.effects])
    problem = _problem(record, _simulated(bare, record), rows)
    found = with_all_rows(base_point(problem, levels))
    point = found.coefficients()
    zeros = np.zeros_like(point.weights)
    return replace(
        model,
        chain=replace(model.chain, plane=found.chain.plane),
        coefficients=Coefficients(point.weights, zeros, point.offset, model.coefficients.added),
    )


def _simulated(model: Model, record: Record) -> np.ndarray:
    """(time,) output of a model that was saturated low before the record, in output units."""
    # On the clock of the model's own record, so that drift and ageing start anew. A band would
    # cost as much as all refits.
    here = replace(record, time=record.time + model.origin.start_s)
    return replace(model, band=None).predict(here).output


def _error(problem: Problem, levels: int, effects: Sequence[Effect]) -> float:
    """Held-out rms of the model with some effects, refitted; NaN if it cannot be."""
    try:
        point = base_point(problem, levels)
        for effect in effects:
            point = with_effect(problem, point, effect)
    except (FloatingPointError, np.linalg.LinAlgError):
        return math.nan
    return float(np.sqrt(point.validation_mean_square)) * problem.unit


def _least(ratios: Mapping[str, float]) -> tuple[str, float]:
    """The pair that is separated least, and its separation; none is claimed where a fit failed."""
    claimed = {pair: 0.0 if math.isnan(ratio) else ratio for pair, ratio in ratios.items()}
    pair = min(claimed, key=lambda each: claimed[each])
    return pair, claimed[pair]


def _verdict(best: str, separations: Mapping[str, Mapping[str, float]]) -> tuple[str, bool]:
    """What the best candidate decides, and whether that is enough."""
    pair, ratio = _least(separations[best])
    truth, rival = pair.split(" not ")
    if ratio <= SUFFICIENT:
        return (
            f"no candidate within this range, rate and time tells the models apart at this noise: "
            f"even on the best, {best}, {rival} refitted leaves only {ratio:.2f} times the error "
            f"where {truth} is true; change something else: a wider range, a higher rate limit, "
            "more time, less noise, or the suspected cause itself",
            False,
        )
    ranked = sorted((_least(ratios)[1] for ratios in separations.values()), reverse=True)
    return (
        f"on this record the wrong model, refitted, leaves at least {ratio:.3g} times the error of "
        f"the right one ({rival} where {truth} is true); on the next best excitation "
        f"{ranked[1]:.3g} times",
        True,
    )
