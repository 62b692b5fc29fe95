"""Fit a body on a hysteretic spring to a record, by the error of its simulated motion.

A linear body comes first, from the equation of motion of the smoothed record. What a search moves
are the numbers of a form, by Levenberg-Marquardt steps.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any, NamedTuple, cast

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from preisach_jax.chain.coefficients import Coefficients
from preisach_jax.chain.description import Chain
from preisach_jax.effects.restoring_force import BOUC_WEN, PREISACH, RestoringForce
from preisach_jax.errors import InputError
from preisach_jax.fit.fitted import FINAL_ROWS, Fit, held_out_rows
from preisach_jax.fit.stepwise import Progress
from preisach_jax.identify.problem import Point, Problem
from preisach_jax.mechanics import (
    LEAST_SAMPLES,
    Body,
    BoucWen,
    Force,
    PreisachSpring,
    RestoringLaw,
    State,
    motion,
    substeps_of,
)
from preisach_jax.model import Model, Origin, ParameterEstimate
from preisach_jax.model.band import Band, InputMotion
from preisach_jax.operator.plane import Plane
from preisach_jax.record.core import Record

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

POWER = 0.98
"""Share of the power of a force up to whose frequency the equation of motion is asked."""

TAPER = 0.05
"""Share of a record that is faded at each end."""

COMMON = ("stiffness", "omega", "zeta", "offset", "start_z", "start_speed")
"""Numbers that every form begins with; the first two as logarithms."""

WIDTHS = (0.0, 0.1, 0.25, 0.5, 1.0)
"""Widths α - β of loops at which the density has nodes, in ranges of the plane: closer where
loops are narrow, since hardly any density is even across widths."""

PLACES = 3
"""Nodes of the density along the middle (α + β)/2 of loops, for each width."""

DENSITY_RIDGE = 5e-4
"""Share of the spread of the output that a density as great as the stiffness adds to the residual:
the prior decides only what the record leaves open."""

MOST_STEPS = 40
ENOUGH = 1e-5
"""Relative fall of the mean square of two steps below which the search ends."""

MOST_DAMPING = 1e6


class Guess(NamedTuple):
    """The linear body that comes closest to a record.

    Attributes:
        mass, damping, stiffness: its parameters.
        explained: share of the power of the force that it explains.
        band_hz: frequency below which nearly all power of the force lies, in Hz.
    """

    mass: float
    damping: float
    stiffness: float
    explained: float
    band_hz: float

    @property
    def is_body(self) -> bool:
        """Whether it has a mass and a spring, whose resonance lies in the band of the force."""
        if not (self.mass > 0 and self.stiffness > 0):
            return False
        return np.sqrt(self.stiffness / self.mass) <= 2 * np.pi * self.band_hz


def first_guess(time: np.ndarray, force: np.ndarray, z: np.ndarray) -> Guess:
    """The linear body m, c, k that comes closest to a record, by its equation of motion.

    Both signals are faded at the ends and lose what lies above the band of the force by the same
    filter, so that the equation holds between what is left of them. The times are evenly spaced.
    """
    count = len(time)
    frequency = np.fft.rfftfreq(count, float(time[-1] - time[0]) / (count - 1))
    fade = np.clip(np.minimum(np.arange(count), np.arange(count)[::-1]) / (TAPER * count), 0, 1)
    window = np.sin(np.pi / 2 * fade) ** 2
    driving, moving = (np.fft.rfft((each - each.mean()) * window) for each in (force, z))
    power = np.asarray(np.cumsum(np.abs(driving) ** 2), float)
    last = int(np.sum(power < POWER * power[-1]))
    edge = float(frequency[max(min(last, count // 2), 1)])
    passed = 1 / (1 + (frequency / edge) ** 8)
    omega = 2j * np.pi * frequency
    columns: np.ndarray = np.stack(
        [np.fft.irfft(moving * passed * omega**order, count) for order in (2, 1, 0)], axis=1
    )
    goal = np.fft.irfft(driving * passed, count)
    scale = np.maximum(np.linalg.norm(columns, axis=0), np.finfo(float).tiny)
    scaled: np.ndarray = columns / scale
    found: np.ndarray = np.linalg.lstsq(scaled, goal, rcond=None)[0] / scale
    rest = goal - columns @ found
    explained = 1 - float(rest @ rest) / max(float(goal @ goal), np.finfo(float).tiny)
    return Guess(float(found[0]), float(found[1]), float(found[2]), explained, edge)


class Parts(NamedTuple):
    """What a form makes of its numbers: the body, its start, and the output at rest."""

    body: Body[Any]
    start: State
    offset: Array


class BoucWenForm(NamedTuple):
    """Numbers of a body with a Bouc-Wen law: the common ones, share, beta, gamma, n and start y.

    Attributes:
        range_z: displacement in which the state of the law is measured.
    """

    range_z: float

    def parts(self, numbers: Array) -> Parts:
        """The body that the numbers make, and where it starts."""
        stiffness, omega, zeta = jnp.exp(numbers[0]), jnp.exp(numbers[1]), numbers[2]
        share, beta, gamma, exponent = numbers[6], numbers[7], numbers[8], numbers[9]
        law = BoucWen(stiffness * share, jnp.asarray(self.range_z), beta, gamma, exponent)
        body = _body(stiffness, omega, zeta, stiffness * (1 - share), law)
        return Parts(body, (numbers[4], numbers[5], numbers[10:11]), numbers[3])

    def named(self, numbers: Array) -> dict[str, Array]:
        """The parameters of the effect."""
        shape = zip(("share", "beta", "gamma", "n"), numbers[6:10], strict=True)
        return _named(numbers) | dict(shape)

    def starts(self, common: np.ndarray) -> list[np.ndarray]:
        """Where a search starts: laws around the linear body that yield, and that stiffen."""
        y = common[4] / self.range_z
        shapes = ((0.3, 0.3), (0.7, -0.7))
        return [np.append(common, [0.5, *shape, 1.0, y]) for shape in shapes]

    def bounds(self) -> tuple[np.ndarray, np.ndarray]:
        """Lowest and highest numbers."""
        low, high = np.full(11, -np.inf), np.full(11, np.inf)
        low[[2, 6, 7, 8, 9, 10]] = [0.0, 1e-3, -20.0, -20.0, 1.0, -5.0]
        high[[2, 6, 7, 8, 9, 10]] = [2.0, 1.5, 20.0, 20.0, 4.0, 5.0]
        return low, high

    def penalty(self, scale: float) -> np.ndarray:
        """(row, number) rows that should be zero times the numbers, in units of the output."""
        del scale
        return np.zeros((0, 11))


class OperatorForm(NamedTuple):
    """Numbers of a body with a Preisach operator: the common ones, and a density at its nodes.

    The density is in units of the stiffness: a cell's weight is its value at the cell, times the
    stiffness and the range of the plane over the number of levels squared.

    Attributes:
        plane: the plane, over displacements.
        basis: (cells, node) linear interpolation from the nodes to the cells.
    """

    plane: Plane
    basis: np.ndarray

    @staticmethod
    def on(plane: Plane) -> OperatorForm:
        """The form whose density is linear between nodes, and has a part on the diagonal."""
        rows, columns = np.asarray(plane.alpha_index), np.asarray(plane.beta_index)
        most = plane.levels - 1.0
        width = _hats((rows - columns) / most, np.array(WIDTHS))
        place = _hats((rows + columns) / (2 * most), np.linspace(0.0, 1.0, PLACES))
        inside = (width[:, :, None] * place[:, None, :]).reshape(len(rows), -1)
        diagonal = np.where((rows == columns)[:, None], place, 0.0) * plane.levels
        basis = np.concatenate([inside, diagonal], axis=1)
        return OperatorForm(plane, basis[:, basis.any(axis=0)])

    @property
    def weight_scale(self) -> float:
        """Weight of a cell whose density is the stiffness."""
        return (self.plane.high - self.plane.low) / self.plane.levels**2

    def weights(self, numbers: Array) -> Array:
        """(cells,) weights, in units of force."""
        return jnp.exp(numbers[0]) * self.weight_scale * (self.basis @ numbers[len(COMMON) :])

    def parts(self, numbers: Array) -> Parts:
        """The body that the numbers make, and where it starts."""
        stiffness, omega, zeta = jnp.exp(numbers[0]), jnp.exp(numbers[1]), numbers[2]
        law = PreisachSpring(self.plane, self.weights(numbers))
        rest = stiffness - jnp.sum(law.weights) / (self.plane.high - self.plane.low)
        start = law.committed(law.demagnetised(numbers.dtype), numbers[4])
        body = _body(stiffness, omega, zeta, rest, law)
        return Parts(body, (numbers[4], numbers[5], start), numbers[3])

    def named(self, numbers: Array) -> dict[str, Array]:
        """The parameters of the effect."""
        share = jnp.sum(self.weights(numbers)) / (self.plane.high - self.plane.low)
        return _named(numbers) | {"share": share / jnp.exp(numbers[0])}

    def starts(self, common: np.ndarray) -> list[np.ndarray]:
        """Where a search starts: the linear body."""
        return [np.append(common, np.zeros(self.basis.shape[1]))]

    def bounds(self) -> tuple[np.ndarray, np.ndarray]:
        """Lowest and highest numbers."""
        count = len(COMMON) + self.basis.shape[1]
        low, high = np.full(count, -np.inf), np.full(count, np.inf)
        low[2], high[2] = 0.0, 2.0
        return low, high

    def penalty(self, scale: float) -> np.ndarray:
        """(row, number) rows that should be zero times the numbers, in units of the output."""
        nodes = self.basis.shape[1]
        return DENSITY_RIDGE * scale * np.eye(len(COMMON) + nodes)[len(COMMON) :] / np.sqrt(nodes)


Form = BoucWenForm | OperatorForm


def _named(numbers: Array) -> dict[str, Array]:
    return {
        "f_hz": jnp.exp(numbers[1]) / (2 * jnp.pi),
        "zeta": numbers[2],
        "stiffness": jnp.exp(numbers[0]),
    }


def _hats(values: np.ndarray, nodes: np.ndarray) -> np.ndarray:
    """(value, node) weights of linear interpolation between nodes."""
    return np.stack([np.interp(values, nodes, own) for own in np.eye(len(nodes))], axis=1)


def _body(stiffness: Array, omega: Array, zeta: Array, rest: Array, law: RestoringLaw) -> Body[Any]:
    return Body(stiffness / omega**2, 2 * zeta * stiffness / omega, rest, law)


def simulated(form: Form, numbers: Array, force: Force, substeps: int) -> Array:
    """(time,) output of a form along a force."""
    parts = form.parts(numbers)
    return motion(parts.body, force, parts.start, substeps)[0] + parts.offset


def common_numbers(guess: Guess, z: np.ndarray) -> np.ndarray:
    """The common numbers of a linear guess."""
    stiffness, mass = guess.stiffness, guess.mass
    assert guess.is_body  # `fit` refuses others
    omega = np.sqrt(stiffness / mass)
    zeta = min(max(guess.damping / (2 * np.sqrt(stiffness * mass)), 0.005), 1.0)
    middle = float(z.mean())
    return np.array([np.log(stiffness), np.log(omega), zeta, middle, z[0] - middle, 0.0])


class Refined(NamedTuple):
    """Where a search has come to.

    Attributes:
        values: (parameter,) the best values.
        residual: (time,) what they leave.
        tangents: (time, parameter) derivatives of the output there.
        mean_square: mean square of the rows that count, with the penalty.
    """

    values: np.ndarray
    residual: np.ndarray
    tangents: np.ndarray
    mean_square: float


def refined(
    run: Callable[[np.ndarray], Array],
    derivative: Callable[[np.ndarray], Array],
    values: np.ndarray,
    goal: np.ndarray,
    counts: np.ndarray,
    bounds: tuple[np.ndarray, np.ndarray],
    penalty: np.ndarray | None = None,
    most_steps: int = MOST_STEPS,
) -> Refined:
    """The parameters whose output comes closest to a goal.

    K. Levenberg, Q. Appl. Math. 2 (1944) 164-168; D. W. Marquardt, J. SIAM 11 (1963) 431-441: the
    damping is that of the scaled parameters.  A step that lets the output diverge is shortened.

    Arguments:
        run: the simulation, from (parameter,) values to (time,) output.
        derivative: its derivatives, (time, parameter).
        values: (parameter,) where to start.
        goal: (time,) the measured output.
        counts: (time,) bool, rows that are compared.
        bounds: lowest and highest values, (parameter,) each.
        penalty: (row, parameter) rows that should be zero times the values; by default none.
    """
    rows = np.zeros((0, len(values))) if penalty is None else penalty
    weight = 1 / np.sqrt(counts.sum())

    def left(values: np.ndarray) -> tuple[np.ndarray, np.ndarray, float]:
        residual = goal - np.asarray(run(values))
        stacked = np.concatenate([residual[counts] * weight, -rows @ values])
        square = float(stacked @ stacked)
        return residual, stacked, square if np.isfinite(square) else np.inf

    residual, stacked, square = left(values)
    tangents = np.asarray(derivative(values))
    damping, small = 1e-2, 0
    for _ in range(most_steps):
        matrix = np.concatenate([tangents[counts] * weight, rows])
        scale = np.maximum(np.linalg.norm(matrix, axis=0), np.finfo(float).tiny)
        scaled = matrix / scale
        gram, slope = scaled.T @ scaled, scaled.T @ stacked
        while damping < MOST_DAMPING:
            damped: Any = gram + damping * np.eye(len(values))
            step = np.asarray(np.linalg.solve(damped, slope), dtype=float)
            trial = np.clip(values + step / scale, *bounds)
            found = left(trial)
            if found[2] < square:
                break
            damping *= 4
        else:
            break
        small = small + 1 if found[2] > (1 - ENOUGH) * square else 0
        values, (residual, stacked, square) = trial, found
        damping = max(damping / 10, 1e-9)
        tangents = np.asarray(derivative(values))
        if small == 2:
            break
    return Refined(values, residual, tangents, square)


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
class _LawSearch:
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
    def of(seen: _Motion, law: str, levels: int) -> _LawSearch:
        """The search for a law, with a plane of so many levels if it has one."""
        form: Form = BoucWenForm(float(np.ptp(seen.output)) / 2)
        if law == PREISACH:
            form = OperatorForm.on(_plane_of(seen, levels))
        substeps = seen.substeps

        def output(numbers: jax.Array, force: Force) -> jax.Array:
            return simulated(form, numbers, force, substeps)

        run = cast(Callable[[np.ndarray, Force], jax.Array], jax.jit(output))
        slopes = cast(Callable[[np.ndarray, Force], jax.Array], jax.jit(jax.jacfwd(output)))
        return _LawSearch(seen, law, form, run, slopes)

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
    parameters, from the error of the simulated motion (`refined`).

    Arguments:
        to_beat: RMS error, in output units, below which a law must come on the first periods.
    """
    seen = _as_motion(record)
    laws = (effect.law,) if effect.law else (BOUC_WEN, PREISACH)
    best: tuple[float, _LawSearch, np.ndarray, np.ndarray] | None = None
    closest = np.inf
    for position, law in enumerate(laws):
        progress(f"fitting restoring_force ({law})", position / len(laws))
        search = _LawSearch.of(seen, law, min(levels, MOST_LEVELS))
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
