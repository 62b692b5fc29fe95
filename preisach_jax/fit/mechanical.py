"""Fit a body on a hysteretic spring to a record, by the error of its simulated motion."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import cast

import jax
import jax.numpy as jnp
import numpy as np

from preisach_jax.chain import Chain, Coefficients
from preisach_jax.effects.restoring_force import BOUC_WEN, PREISACH, RestoringForce
from preisach_jax.errors import InputError
from preisach_jax.fit.finish import FINAL_ROWS, held_out_rows
from preisach_jax.fit.result import Fit
from preisach_jax.fit.running import Progress
from preisach_jax.identify import Point, Problem
from preisach_jax.mechanics.body import LEAST_SAMPLES
from preisach_jax.mechanics.forms import BoucWenForm, Form, OperatorForm, common_numbers, simulated
from preisach_jax.mechanics.initial import Guess, first_guess
from preisach_jax.mechanics.motion import Force, substeps_of
from preisach_jax.mechanics.refinement import Refined, refined
from preisach_jax.model import Model, Origin, ParameterEstimate
from preisach_jax.model.band import Band, InputMotion
from preisach_jax.operator.plane import Plane
from preisach_jax.record import Record

MOST_ROWS = {BOUC_WEN: 40_000, PREISACH: 4_000}
"""Samples of a record, from its first one, that are simulated to fit a law."""

TRIAL_PERIODS, TRIAL_STEPS = 60, 8
"""Periods of the motion and steps of the search by which its starts are compared."""

LEAST_TRIAL_ROWS = 1_500
"""Samples of a record that such a trial takes at least."""

MOST_LEVELS = 13
"""Levels of the plane of displacements at most: each step of a motion passes every hysteron."""

STEPS = {BOUC_WEN: 40, PREISACH: 10}
"""Steps of the search for a law: those for an operator mean a motion for each of its numbers."""

MARGIN = 0.1
"""Share of the displacement by which the plane goes beyond it: a trial may swing further."""

WHITE = 1.6
"""Mean square of the differences of a residual over its own, two of which is that of white noise,
from which on a law leaves nothing to another one."""

LEAST_EXPLAINED = 0.2
"""Share of the power of the force that a linear body must explain for a search to start."""


@dataclass(frozen=True, eq=False)
class _Motion:
    """A record as it is simulated.

    Attributes:
        time, force, output: (time,) the samples.
        measured: (time,) whether the output was measured.
        held_out: (time,) measured rows that are held out.
        guess: the linear body that comes closest.
    """

    time: np.ndarray
    force: np.ndarray
    output: np.ndarray
    measured: np.ndarray
    held_out: np.ndarray
    guess: Guess

    @property
    def common(self) -> np.ndarray:
        """The numbers of a linear body."""
        return common_numbers(self.guess, self.output)

    @property
    def substeps(self) -> int:
        """Steps of the integration between two samples; some more where a spring stiffens."""
        return substeps_of(self.time, 1.2 * float(np.exp(self.common[1]) / (2 * np.pi)))


@dataclass(frozen=True, eq=False)
class _Search:
    """A law that is fitted to a record.

    Attributes:
        seen: the record.
        law: the name of the law.
        form: what its numbers make.
        run: (time,) output from numbers and a force, compiled once for each length.
        derivative: (time, number) its derivatives.
    """

    seen: _Motion
    law: str
    form: Form
    run: Callable[[np.ndarray, Force], jax.Array]
    derivative: Callable[[np.ndarray, Force], jax.Array]

    @staticmethod
    def of(seen: _Motion, law: str, levels: int) -> _Search:
        """The search for a law, with a plane of so many levels if it has one."""
        form: Form = BoucWenForm(float(np.ptp(seen.output)) / 2)
        if law == PREISACH:
            form = OperatorForm.on(_plane_of(seen, levels))
        substeps = seen.substeps

        def output(numbers: jax.Array, force: Force) -> jax.Array:
            return simulated(form, numbers, force, substeps)

        run = cast(Callable[[np.ndarray, Force], jax.Array], jax.jit(output))
        slopes = cast(Callable[[np.ndarray, Force], jax.Array], jax.jit(jax.jacfwd(output)))
        return _Search(seen, law, form, run, slopes)

    def tried(self) -> Refined:
        """The best of the starts, after some steps on the first periods of the record."""
        period = 2 * np.pi / float(np.exp(self.seen.common[1]))
        rows = int(TRIAL_PERIODS * period / float(np.median(np.diff(self.seen.time))))
        rows = max(rows, LEAST_TRIAL_ROWS)
        trials = [
            self.refined(start, most_steps=TRIAL_STEPS, most_rows=rows)
            for start in self.form.starts(self.seen.common)
        ]
        return min(trials, key=lambda trial: trial.mean_square)

    def refined(
        self,
        start: np.ndarray,
        most_steps: int,
        *,
        everything: bool = False,
        most_rows: int | None = None,
    ) -> Refined:
        """The best numbers from a start, on the rows that are not held out, or on everything."""
        seen, form = self.seen, self.form
        rows = min(len(seen.time), MOST_ROWS[self.law], most_rows or len(seen.time))
        force = Force.through(seen.time, seen.force).cut(0, rows - 1)
        counts = seen.measured if everything else seen.measured & ~seen.held_out
        return refined(
            lambda numbers: self.run(numbers, force),
            lambda numbers: self.derivative(numbers, force),
            start,
            seen.output[:rows],
            counts[:rows],
            form.bounds(),
            form.penalty(float(np.std(seen.output))),
            most_steps,
        )

    def path(self, values: np.ndarray) -> np.ndarray:
        """(time,) output along the whole record."""
        return np.asarray(self.run(values, Force.through(self.seen.time, self.seen.force)))


def fit_inside(
    record: Record,
    effect: RestoringForce,
    point: Point,
    levels: int,
    progress: Progress,
    to_beat: float = np.inf,
) -> Fit:
    """The fit of a body on a hysteretic spring.

    Its linear part is found first, from the equation of motion of the smoothed record; then all
    parameters, from the error of the simulated motion (`mechanics.refinement`).

    Arguments:
        to_beat: RMS error, in output units, below which a law must come on the first periods.
    """
    seen = _as_motion(record)
    laws = (effect.law,) if effect.law else (BOUC_WEN, PREISACH)
    best: tuple[float, _Search, np.ndarray, np.ndarray] | None = None
    closest = np.inf
    for position, law in enumerate(laws):
        progress(f"fitting restoring_force ({law})", position / len(laws))
        search = _Search.of(seen, law, min(levels, MOST_LEVELS))
        start = search.tried()
        closest = min(closest, start.mean_square**0.5)
        if not start.mean_square**0.5 < to_beat:
            continue
        found = search.refined(start.values, most_steps=STEPS[law])
        path = search.path(found.values)
        error = float(np.sqrt(np.mean((seen.output - path)[seen.held_out] ** 2)))
        if best is None or error < best[0]:
            best = (error, search, found.values, path)
        if _is_white(seen, path):
            break
    if best is None:
        raise InputError(
            f"{record.name}: a hysteresis inside mechanics leaves {closest:.3g} RMS of its first "
            f"periods, and a model without it {to_beat:.3g}; leave restoring_force out"
        )
    progress("fitting all rows", 0.9)
    _, search, values, path = best
    whole = search.refined(values, everything=True, most_steps=4)
    model = _model(record, seen, replace(effect, law=search.law), search.form, whole)
    residual = record.output - path
    model = replace(
        model,
        rms_validation=float(np.sqrt(np.mean(residual[seen.held_out] ** 2))),
        band=Band.calibrated(
            InputMotion.of(record, seen.held_out),
            residual[seen.held_out],
            np.zeros((int(seen.held_out.sum()), 2)),
            float(np.ptp(record.input)) / model.chain.plane.levels,
            0.0,
        ),
    )
    identification = record.measured & ~seen.held_out
    return Fit(record, model, path, identification, seen.held_out, point)


def _as_motion(record: Record) -> _Motion:
    if record.runs:
        raise InputError(
            f"{record.name}: restoring_force is fitted to one record, and several are given; give "
            "one of them"
        )
    if len(record.time) < 10 * LEAST_SAMPLES:
        raise InputError(
            f"{record.name} has {len(record.time)} samples: restoring_force needs some periods of "
            "the motion; give a longer record"
        )
    measured = record.measured
    output = np.interp(record.time, record.time[measured], record.output[measured])
    first, last = float(record.time[0]), float(record.time[-1])
    even = np.asarray(np.linspace(first, last, len(record.time)), float)
    force = np.asarray(np.interp(even, record.time, record.input), float)
    moved = np.asarray(np.interp(even, record.time, output), float)
    guess = first_guess(even, force, moved)
    _check_body(record, guess)
    held_out = held_out_rows(Problem.of(record, FINAL_ROWS), record)
    return _Motion(record.time - record.time[0], record.input, output, measured, held_out, guess)


def _check_body(record: Record, guess: Guess) -> None:
    if not guess.is_body or guess.explained < LEAST_EXPLAINED:
        raise InputError(
            f"{record.name}: no mass on a spring moves like this record (the best linear one "
            f"explains {100 * max(guess.explained, 0.0):.3g} % of the power of the input); "
            "restoring_force takes the input to be a force, and needs a record through the "
            "resonance; leave it out"
        )


def _plane_of(seen: _Motion, levels: int) -> Plane:
    centred = seen.output[seen.measured] - seen.common[3]
    reach = MARGIN * float(np.ptp(centred))
    return Plane(levels, float(centred.min()) - reach, float(centred.max()) + reach)


def _is_white(seen: _Motion, path: np.ndarray) -> bool:
    residual = (seen.output - path)[seen.measured]
    return float(np.mean(np.diff(residual) ** 2)) > WHITE * float(np.mean(residual**2))


def _model(
    record: Record, seen: _Motion, effect: RestoringForce, form: Form, whole: Refined
) -> Model:
    numbers = jnp.asarray(whole.values)
    parts = form.parts(numbers)
    bouc_wen = isinstance(form, BoucWenForm)
    plane = _plane_of(seen, 2) if bouc_wen else form.plane
    weights = np.zeros(plane.cells) if bouc_wen else np.asarray(form.weights(numbers))
    survey_of = Problem.of(record, FINAL_ROWS).survey
    bound = replace(
        effect,
        range_z=form.range_z if bouc_wen else float(plane.high - plane.low) / 2,
        start_z=float(parts.start[0]),
        start_speed=float(parts.start[1]),
        start_y=float(parts.start[2][0]) if bouc_wen else 0.0,
        f_low_hz=0.1 / survey_of.duration_s,
        f_high_hz=0.5 / survey_of.step_s,
    )
    estimates = _estimates(seen, bound, form, whole)
    values = {name: estimate.value for name, estimate in estimates.items()}
    units = {role: channel.unit for role, channel in record.channels.items()}
    shown = {
        name: replace(estimate, unit=_shown(estimate.unit, units))
        for name, estimate in estimates.items()
    }
    signed = bool((weights < 0).any() and (weights > 0).any())
    polarity = -1 if weights.sum() < 0 else 1
    columns = {role: record.channels[role].name for role in ("time", "input", "output")}
    return Model(
        chain=Chain(plane, (bound,), polarity=polarity, signed=signed),
        values={effect.name: values},
        coefficients=Coefficients(weights, np.zeros(plane.cells), float(parts.offset), np.zeros(0)),
        parameters={effect.name: shown},
        visited=np.ones(plane.cells, dtype=bool),
        columns={**columns, "aux": list(record.aux)},
        units=units,
        origin=Origin.of(record),
        rms_validation=0.0,
    )


def _shown(unit: str, units: dict[str, str]) -> str:
    unit = unit.replace("{z}", units["output"] or "1")
    shown = unit.replace("{u}", units["input"] or "1")
    return "1" if shown == "1/1" else shown


def _estimates(
    seen: _Motion, effect: RestoringForce, form: Form, whole: Refined
) -> dict[str, ParameterEstimate]:
    """The parameters with 95 % intervals, from the sandwich over stretches of the record."""
    rows = len(whole.residual)
    counts = seen.measured[:rows]
    tangents, residual = whole.tangents[counts], whole.residual[counts]
    scale = np.maximum(np.linalg.norm(tangents, axis=0), np.finfo(float).tiny)
    scaled = tangents / scale
    prior = form.penalty(float(np.std(seen.output))) * np.sqrt(counts.sum()) / scale
    gram: np.ndarray = scaled.T @ scaled + prior.T @ prior
    inverse: np.ndarray = np.linalg.pinv(gram, rcond=1e-12)
    parts = np.array_split(np.arange(len(residual)), 48)
    each: np.ndarray = np.stack([scaled[part].T @ residual[part] for part in parts])
    scores: np.ndarray = each @ inverse / scale

    def named(numbers: jax.Array) -> dict[str, jax.Array]:
        return form.named(numbers)

    values = named(jnp.asarray(whole.values))
    derivative = cast(Callable[[jax.Array], dict[str, jax.Array]], jax.jacfwd(named))
    slopes = derivative(jnp.asarray(whole.values))
    found: dict[str, ParameterEstimate] = {}
    for parameter in effect.parameters():
        value = float(np.clip(values[parameter.name], parameter.low, parameter.high))
        half = 1.96 * float(np.linalg.norm(scores @ np.asarray(slopes[parameter.name])))
        low, high = max(value - half, parameter.low), min(value + half, parameter.high)
        found[parameter.name] = ParameterEstimate(value, low, high, parameter.unit)
    return found
