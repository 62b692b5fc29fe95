"""Fit a model of chosen effects to a record."""

from __future__ import annotations

from collections.abc import Callable, Generator, Iterable, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, TypeVar

import jax
import numpy as np
from threadpoolctl import threadpool_limits

from preisach_jax import html
from preisach_jax.band import Band
from preisach_jax.chain import Chain
from preisach_jax.confidence import estimates, with_grid_error
from preisach_jax.effects import resolve
from preisach_jax.effects.base import Effect, HysteresisEffect
from preisach_jax.effects.of_column import OfColumn
from preisach_jax.errors import InputError
from preisach_jax.identify import (
    ALL,
    VALIDATION,
    Point,
    Problem,
    evaluate,
    refine,
    stepped,
    with_all_rows,
    with_strength,
)
from preisach_jax.model import Model, Origin, Prediction
from preisach_jax.operator.plane import Plane
from preisach_jax.record import Record
from preisach_jax.record.faults import Fault, faults
from preisach_jax.record.joined import (
    RunErrors,
    as_one,
    by_run,
    errors_by_run,
    last_fitted,
    parts_of,
)
from preisach_jax.record.spikes import gross_spikes, input_spikes, isolated_spikes
from preisach_jax.reduction import FIRST_STRENGTH
from preisach_jax.rows import chain_rows, error_table, fault_lines, model_line, run_lines, run_table
from preisach_jax.runs import of_last_run, response, signals_of
from preisach_jax.signature import Projection, Prospect, prospects

if TYPE_CHECKING:
    from matplotlib.figure import Figure

Progress = Callable[[str, float], None]
Found = TypeVar("Found")


def in_silence(text: str, done: float) -> None:
    """Progress that nobody looks at."""
    del text, done


DEFAULT_LEVELS = 25
COARSE_LEVELS = 13
"""Levels of the plane on which both polarities are compared."""

MOST_STARTS = 2
"""Starts of a form of an effect that are refined."""

STARTS_REACH = 2.0
"""Times what the best start leaves of the residual's power that another one may leave to be refined
as well."""

FORMS_HOPE = 0.9
"""Share of the held-out mean square that the most likely form of an effect inside the hysteresis
must not leave for its other forms to be refined: the wrong form of what is there takes much more
away."""

FORMS_REACH = 2.0
"""Times what the most likely form promises to leave which another may leave to be refined."""

MOST_ROUNDS = 3
"""How often spikes are looked for: great ones hide smaller ones."""

CLEAR_CORRELATION = 0.5
"""Correlation of input and output beyond which its sign is the polarity: a drift, or a loop as wide
as it is high, leaves less."""

SIGNS_PAY = 0.1
"""Held-out mean square, over that with weights of one sign, that weights of both signs must not
leave.  A butterfly leaves 0.01 or less; where one sign is right but a delay is hidden, weights of
both signs imitate some of it, and leave 0.3 to 1."""

POOR = 0.05
"""Held-out error over the spread of the output above which weights of both signs are tried."""

SEARCH_ROWS = 8_000
"""Samples to which a longer record is thinned while effects are searched for."""

REFINEMENT = 1.5
"""Ratio of the levels of two planes that are compared."""

FINAL_TOLERANCE = 1e-3
"""Relative fall of the objective below which parameters are not refined further on all rows: one
step without new regressors follows (`finished`)."""

FINAL_ROWS = 60_000
"""Samples to which a still longer record is thinned for the final fit, to bound its memory."""

LEAST_PROMISE = 0.01
"""Relative fall of the objective that a linearisation must promise for an effect to be refined."""


@dataclass(frozen=True, eq=False)
class Fit:
    """A model fitted to a record, with what it leaves.

    Attributes:
        record: the record.
        model: the model, identified on all rows.
        prediction: (time,) output of the same model identified on the identification rows alone.
        identification: (time,) rows that identified `prediction`.
        validation: (time,) rows held out: contiguous blocks spread over the record.
        point: the numerical state, from which a larger model starts; possibly without regressors.
    """

    record: Record
    model: Model
    prediction: np.ndarray
    identification: np.ndarray
    validation: np.ndarray
    point: Point

    def __repr__(self) -> str:
        return f"<Fit of {self.record.name}: {model_line(self.model)}>"

    def _repr_html_(self) -> str:
        """Errors with units, parameters with their intervals and the plane, for notebooks."""
        return html.block(
            html.heading(f"{self.record.name}: {model_line(self.model)}"),
            html.table(*error_table((self,), self.record), numbers_from=1),
            html.table(*run_table(self.by_record, self.record), numbers_from=1),
            html.table(("acts on", "part", "parameter", "value"), chain_rows(self.model)),
        )

    @property
    def effects(self) -> tuple[str, ...]:
        """Names of the effects in the model."""
        return tuple(effect.name for effect in self.model.effects)

    @property
    def residual(self) -> np.ndarray:
        """(time,) measured minus predicted output; NaN where nothing was measured."""
        return self.record.output - self.prediction

    @property
    def rms_identification(self) -> float:
        """RMS residual on the identification rows, in output units."""
        return float(np.sqrt(np.mean(self.residual[self.identification] ** 2)))

    @property
    def rms_validation(self) -> float:
        """RMS residual on the held-out rows, in output units."""
        return float(np.sqrt(np.mean(self.residual[self.validation] ** 2)))

    @property
    def max_abs_validation(self) -> float:
        """Largest residual on the held-out rows, in output units."""
        return float(np.max(np.abs(self.residual[self.validation])))

    @property
    def fit_percent(self) -> float:
        r"""\(100\,(1 - \|e\| / \|z - \bar z\|)\) on the held-out rows."""
        output = self.record.output[self.validation]
        spread = np.linalg.norm(output - output.mean())
        return float(100 * (1 - np.linalg.norm(self.residual[self.validation]) / spread))

    @property
    def by_record(self) -> tuple[RunErrors, ...]:
        """What the model leaves of each of several records; empty for a single one."""
        return errors_by_run(self.record, self.residual, self.identification, self.validation)

    def summary(self) -> str:
        """Errors and parameters as text."""
        unit = self.record.channels["output"].unit or "(no unit)"
        stroke = np.ptp(self.record.output[self.record.measured])
        rms, largest = self.rms_validation, self.max_abs_validation
        lines = [
            f"Preisach model, {self.model.plane.levels} levels"
            + "".join(f" + {name}" for name in self.effects),
            f"  held-out error {rms:.4g} {unit} RMS ({100 * rms / stroke:.3g} % of stroke), "
            f"{largest:.4g} {unit} at most; fit {self.fit_percent:.2f} %",
            f"  identification error {self.rms_identification:.4g} {unit} RMS",
        ]
        lines += [f"  {line}" for line in run_lines(self.by_record, unit)]
        for effect, parameters in self.model.parameters.items():
            for name, estimate in parameters.items():
                lines.append(
                    f"  {effect}.{name} = {estimate.value:.5g} {estimate.unit} "
                    f"(95 %: {estimate.low:.5g} to {estimate.high:.5g})"
                )
        return "\n".join([*lines, *(f"  {line}" for line in fault_lines(self.record))])

    def plot(self) -> Figure:
        """Measured against model, and the residual, as a matplotlib figure."""
        from preisach_jax.plot import overview

        return overview(self)

    def predict(self, record: Record) -> Prediction:
        """Predict the output of a record; see `Model.predict`."""
        return self.model.predict(record)

    def save(self, path: str | Path) -> None:
        """Write the model as JSON; see `Model.save`."""
        self.model.save(path)


def fit(
    record: Record | Sequence[Record],
    effects: Iterable[str | Effect] = (),
    levels: int | None = None,
    *,
    hold_out: Sequence[Record] = (),
    progress: Progress | None = None,
) -> Fit:
    r"""Fit the Preisach model with chosen effects to a record.

    Minimises \(\|z - \hat z(R, \theta)\|^2 + \lambda\, R^\top P R\) over weights \(R \ge 0\)
    and the parameters \(\theta\) of the effects; the record chooses \(\lambda\).

    Arguments:
        record: the measurement, or several of one machine: one model, with a memory for each.
        effects: names of the library, or effects of one's own.
        levels: levels N of the plane; by default 25.
        hold_out: further records that are held out whole, in place of blocks of the others.
        progress: called with a text and a share done.

    Returns:
        The fit.

    Raises:
        InputError: if what is given is no record, several of them do not belong together, an
            effect is unknown or that of a constant column, or levels is not an integer from 2 to
            200.

    Example:
        >>> import numpy as np, preisach_jax as pj
        >>> t = np.arange(2000) / 100
        >>> u = 5 - 5 * np.cos(t * (1 + t / 40))
        >>> fit = pj.fit(pj.Record.from_arrays(t, u, u**1.1), levels=9)
        >>> fit.fit_percent > 99
        True
    """
    record = as_one(record, hold_out, "fit")
    chosen = resolve(effects, aux_units(record))
    for name, values in record.aux.items():
        own = [e.name for e in chosen if isinstance(e, OfColumn) and e.column == name]
        if np.ptp(values) == 0 and own:
            raise InputError(
                f"{record.name}, column {name}: the auxiliary column is constant "
                f"({values[0]:g}), so its effect cannot be seen; leave out {own[0]}"
            )
    with double_precision():
        return freed_of_spikes(
            record,
            lambda given: _fitted(given, chosen, checked_levels(levels), progress or in_silence),
            lambda found: found,
        )


def _fitted(record: Record, chosen: tuple[Effect, ...], levels: int, progress: Progress) -> Fit:
    record, problem, point = begun(record, levels)
    backwards = [effect.name for effect in chosen if feeds_back(effect)]
    if point.chain.signed and backwards:
        raise InputError(
            f"{record.name}: the record asks for weights of both signs, beside which "
            f"{backwards[0]} has no unique output; leave it out"
        )
    problem, point = in_reduced_basis(problem, point)
    for position, effect in enumerate(chosen):
        progress(f"fitting {effect.name}", position / len(chosen))
        point = with_effect(problem, point, effect, always=True)
    found = on_all_rows(record, problem, point)
    if not point.parameters and not point.chain.coefficients:
        return found
    # What the cells add moves parameters as well: intervals from the residual alone are too short.
    coarser = on_a_coarser_plane(problem, point)
    parameters = with_grid_error(found.model.parameters, point, coarser)
    return replace(found, model=replace(found.model, parameters=parameters))


def feeds_back(effect: Effect) -> bool:
    """Whether an effect makes what drives the hysterons depend on their output."""
    return isinstance(effect, HysteresisEffect) and effect.feeds_back


@contextmanager
def double_precision() -> Generator[None]:
    """Work in double precision, and with one thread for the many small factorisations.

    Several threads of the linear algebra library gain nothing at these sizes, and lose a factor
    of five where other processes want the cores.
    """
    with jax.enable_x64(True), threadpool_limits(limits=1, user_api="blas"):
        yield


def aux_units(record: Record) -> dict[str, str]:
    """Units of a record's auxiliary columns by name."""
    return {name: record.channels[name].unit for name in record.aux}


def checked_levels(levels: int | None) -> int:
    """The number of levels, or an error that says what it may be."""
    if levels is None:
        return DEFAULT_LEVELS
    if isinstance(levels, bool) or int(levels) != levels or not 2 <= levels <= 200:
        raise InputError(f"levels is {levels}; give an integer from 2 to 200 (25 is usual)")
    return int(levels)


def plane_of(problem: Problem, levels: int) -> Plane:
    """The plane that the input of a record spans; of runs that are held out it is not asked."""
    record = problem.record
    values = record.input
    if len(problem.identified) < len(ALL):
        values = np.concatenate([values[run.rows] for run in record.runs if not run.held_out])
    return Plane(levels, float(values.min()), float(values.max()))


def base_point(problem: Problem, levels: int) -> Point:
    """The rate-independent model, with weights of the signs that the record shows."""
    return _base_point(problem, levels, *_signs(problem))


def begun(record: Record, levels: int) -> tuple[Record, Problem, Point]:
    """The rate-independent model of a record, freed from the samples that stand out alone.

    Arguments:
        record: the record.
        levels: levels N of the plane.

    Returns:
        The record without its spikes, as it was cut for a search, and the model.
    """
    record = record.bridged(by_run(record, input_spikes)).masked(_faults(record))
    record = record.without(by_run(record, gross_spikes))
    for _ in range(MOST_ROUNDS):
        problem = Problem.of(record, SEARCH_ROWS)
        point = base_point(problem, levels)
        modelled = response(point.chain, {}, signals_of(record), point.coefficients())
        left = record.without(by_run(record, isolated_spikes, np.asarray(modelled)))
        if left is record:
            return record, problem, point
        record = left
    problem = Problem.of(record, SEARCH_ROWS)
    return record, problem, base_point(problem, levels)


def _faults(record: Record) -> tuple[Fault, ...]:
    """Stretches in which the sensor of a record is at fault, of each run alone."""
    return tuple(
        fault._replace(start=fault.start + rows.start, stop=fault.stop + rows.start)
        for part, rows in zip(parts_of(record), record.stretches, strict=True)
        for fault in faults(part)
    )


def in_reduced_basis(problem: Problem, point: Point) -> tuple[Problem, Point]:
    """A record and a model of it, to search on from in the directions that the record decides."""
    small = problem.reduced()
    there = evaluate(small, point.chain, point.values, point.strength)
    return small, with_strength(small, there)


def freed_of_spikes(
    record: Record, work: Callable[[Record], Found], fit_of: Callable[[Found], Fit]
) -> Found:
    """What is found in a record, again as long as what its fit leaves shows spikes.

    What the plain model misses hides spikes that one with effects shows.

    Arguments:
        record: the record.
        work: finds something in a record.
        fit_of: the fit in what was found.
    """
    found = work(record)
    for _ in range(MOST_ROUNDS):
        fit = fit_of(found)
        if not fit.effects:
            break  # `begun` has left out what a model without effects shows
        left = fit.record.without(by_run(fit.record, isolated_spikes, fit.prediction))
        if left is fit.record:
            break
        found = work(left)
    return found


def _base_point(problem: Problem, levels: int, polarity: int, signed: bool) -> Point:
    chain = Chain(plane_of(problem, levels), polarity=polarity, signed=signed)
    return with_strength(problem, evaluate(problem, chain, {}, FIRST_STRENGTH))


def _signs(problem: Problem) -> tuple[int, bool]:
    """Polarity of a record's model, and whether its weights have both signs.

    The output rises with the input (1) or falls (-1), and all weights have that sign, unless those
    of both signs predict what is held out much better.
    """
    slot = ("signs",)
    if slot not in problem.cache:
        along = float(np.corrcoef(problem.record.input[problem.rows], problem.target)[0, 1])
        tried = (1, -1) if abs(along) < CLEAR_CORRELATION else (1 if along >= 0 else -1,)
        plain = [_base_point(problem, COARSE_LEVELS, sign, signed=False) for sign in tried]
        best = min(plain, key=lambda point: point.objective)
        signed = False
        least = SIGNS_PAY * best.validation_mean_square
        if best.validation_mean_square > POOR**2 * float(np.var(problem.goal)):
            both = _base_point(problem, COARSE_LEVELS, best.chain.polarity, signed=True)
            signed = both.validation_mean_square < least
        problem.cache[slot] = best.chain.polarity, signed
    return problem.cache[slot]


def with_effect(
    problem: Problem,
    point: Point,
    effect: Effect,
    always: bool = False,
    known: Sequence[Prospect] = (),
) -> Point:
    """The best model that has an effect beside those of a point, all refitted jointly.

    Its forms and starts are compared by what they promise to first order; the best ones are
    refined.

    Arguments:
        problem: the record.
        point: the model.
        effect: the effect.
        always: whether to refine all its forms whatever they promise.
        known: the `prospects` of its forms, if they are known.
    """
    forms = problem.forms_of(effect, point)
    promised = known or prospects(problem, point, Projection(problem, point), forms)
    starts = [[start for start in promised if start.effect is form] for form in forms]
    left = [1 - max(start.held_out for start in own) for own in starts]
    likely = int(np.argmin(left))
    tried = {likely: _with_form(problem, point, starts[likely])}
    # Forms of an effect inside the hysteresis look alike, and each means all states anew.
    picks = isinstance(effect, HysteresisEffect) and not always
    hope = FORMS_HOPE * point.validation_mean_square
    if picks and tried[likely].validation_mean_square > hope:
        return tried[likely]
    for position, own in enumerate(starts):
        if position != likely and not (picks and left[position] > FORMS_REACH * left[likely]):
            tried[position] = _with_form(problem, point, own)
    best, *others = [tried[position] for position in sorted(tried)]
    for trial in others:
        if trial.validation_mean_square < effect.form_pays * best.validation_mean_square:
            best = trial
    return best


def _with_form(problem: Problem, point: Point, starts: Sequence[Prospect]) -> Point:
    """The best model with one form of an effect, from the starts that promise most."""
    ranked = sorted(starts, key=lambda start: -start.reached)[:MOST_STARTS]
    effect = ranked[0].effect
    chain = point.chain.with_effects((*point.chain.effects, effect))
    trials: list[Point] = []
    for start in ranked:
        if trials and 1 - start.reached > STARTS_REACH * (1 - ranked[0].reached):
            break
        values = {**point.values, effect.name: start.values}
        there = evaluate(problem, chain, values, point.strength, point)
        trials.append(refine(problem, there, iterations=3))
    return settled(problem, min(trials, key=lambda trial: trial.objective))


def without_effect(problem: Problem, point: Point, name: str) -> Point:
    """The model that lacks one of a point's effects, the others refitted jointly."""
    effects = tuple(effect for effect in point.chain.effects if effect.name != name)
    values = {key: value for key, value in point.values.items() if key != name}
    chain = point.chain.with_effects(effects)
    return settled(problem, evaluate(problem, chain, values, point.strength, point))


def at_levels(problem: Problem, point: Point, levels: int) -> Point:
    """The same model on a plane of other levels, refitted."""
    chain = replace(point.chain, plane=plane_of(problem, levels))
    return settled(problem, evaluate(problem, chain, point.values, point.strength, point))


def on_a_coarser_plane(problem: Problem, point: Point) -> Point:
    """The same model on the next coarser plane, refitted."""
    return at_levels(problem, point, max(2, round(point.chain.plane.levels / REFINEMENT)))


def moved_to(problem: Problem, point: Point) -> Point:
    """The chain of a point, from its values, refitted to a cut of its record."""
    if not point.chain.effects:
        return point
    there = evaluate(problem, point.chain, point.values, point.strength, point)
    moved = refine(problem, with_strength(problem, there), iterations=3, tolerance=FINAL_TOLERANCE)
    thinned = len(point.target) < len(problem.target)
    for effect in point.chain.effects:
        if not (thinned and effect.found_in_residual):
            continue
        # Thinned rows may have led to a wrong line, from which no refinement leads away.
        without = without_effect(problem, moved, effect.name)
        again = with_effect(problem, without, effect, always=True)
        if again.validation_mean_square < (1 - LEAST_PROMISE) * moved.validation_mean_square:
            moved = again
    return moved


def on_all_rows(record: Record, problem: Problem, point: Point) -> Fit:
    """The fit of a point that was found on a thinned record.

    Arguments:
        record: the record.
        problem: the record as it was cut for the search.
        point: the model.
    """
    whole = Problem.of(record, FINAL_ROWS)
    return finished(whole, moved_to(whole.reduced(problem), point), record)


def settled(problem: Problem, point: Point) -> Point:
    """Refined, with the strength of the prior that the data choose for it."""
    point = refine(problem, point)
    before = point.strength
    point = with_strength(problem, point)
    return point if point.strength == before else refine(problem, point, iterations=4)


def finished(problem: Problem, point: Point, record: Record) -> Fit:
    """The fit of a point: the model identified on all rows, the prediction without those held out.

    Arguments:
        problem: the record as it was cut for the final fit, with all hysterons.
        point: the refined point, in a reduced basis or not.
        record: the record with all its samples.
    """
    point = with_signs(problem, point)
    whole = point
    if len(problem.identified) == len(ALL):
        whole = stepped(problem, with_all_rows(point))
    coefficients = point.coefficients()
    signals = signals_of(record)
    prediction = np.asarray(response(point.chain, point.values, signals, coefficients))
    held_out = _held_out_rows(problem, record)
    residual = (record.output - prediction)[held_out]
    cells = whole.chain.plane.cells
    units = {role: channel.unit for role, channel in record.channels.items()}
    model = Model(
        chain=whole.chain,
        values=whole.values,
        coefficients=of_last_run(whole.chain, whole.coefficients(), signals),
        parameters=estimates(problem, whole),
        visited=np.ptp(whole.matrix[:, :cells], axis=0) > 1e-9,
        columns={
            **{role: record.channels[role].name for role in ("time", "input", "output")},
            "aux": list(record.aux),
        },
        units=units,
        origin=Origin.of(last_fitted(record)),
        rms_validation=float(np.sqrt(np.mean(residual**2))),
        band=Band.calibrated(record, record.output - prediction, held_out),
    )
    return Fit(record, model, prediction, record.measured & ~held_out, held_out, point)


def with_regressors(problem: Problem, fit: Fit) -> Point:
    """The point of a fit with its regressors, which are computed again where they were let go.

    Arguments:
        problem: the record as it was cut for the fit.
        fit: the fit.
    """
    point = fit.point
    if len(point.matrix):
        return point
    return evaluate(problem, point.chain, point.values, point.strength, point)


def with_signs(problem: Problem, point: Point) -> Point:
    """A point of a reduced basis with all hysterons, whose weights have one sign.

    Arguments:
        problem: the record, with all hysterons.
        point: the refined point; returned as it is if it has all hysterons and rows.
    """
    if point.columns.vectors is None and len(point.matrix) == len(problem.target):
        return point
    there = evaluate(problem, point.chain, point.values, point.strength, point)
    if point.chain.feeds_back:  # what is fed back now is that of weights of one sign
        there = evaluate(problem, point.chain, point.values, point.strength, there)
    return refine(problem, with_strength(problem, there), 2, FINAL_TOLERANCE)


def _held_out_rows(problem: Problem, record: Record) -> np.ndarray:
    """(time,) measured rows of the whole record that lie in the stretches held out."""
    if len(problem.identified) < len(ALL):
        mask = np.zeros(len(record.time), dtype=bool)
        for run in record.runs:
            mask[run.rows] = run.held_out
        return mask & record.measured
    order = problem.in_time
    times = problem.record.time[problem.rows[order]]
    held_out = problem.fold[order] == VALIDATION[0]
    measured = np.flatnonzero(record.measured)
    # Each row goes with the last row of the cut that is not after it.
    before = np.searchsorted(times, record.time[measured], side="right") - 1
    mask = np.zeros(len(record.time), dtype=bool)
    mask[measured] = held_out[np.maximum(before, 0)]
    return mask
