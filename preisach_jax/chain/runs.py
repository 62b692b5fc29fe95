"""A chain along several runs: what `chain` computes along one, with a memory of its own for each.

Weights and parameters of the effects are those of all runs.  Hysterons, and the states of all
effects, start anew with each; so do the offset, what an unknown past leaves, and the coefficients
of effects that differ from one run to the next (`Effect.of_time_alone`).  Runs that are held out
start as a prediction does: hysterons that the first input does not force halfway, all else as in
the last of the other runs.  Along one run these functions are those of `chain`.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from preisach_jax.chain import driven as one_driven
from preisach_jax.chain import hysteresis as one_hysteresis
from preisach_jax.chain import matrix as one_matrix
from preisach_jax.chain import output as one_output
from preisach_jax.chain import signals as one_signals
from preisach_jax.chain.coefficients import Coefficients, Columns
from preisach_jax.chain.description import MIDDLE, Chain, EffectValues
from preisach_jax.chain.hysteresis import HysteresisColumns
from preisach_jax.chain.signals import JoinedSignals, ThinnedSignals, parts_of
from preisach_jax.effects.base import HysteresisEffect, Signals
from preisach_jax.record.core import Record


def signals_of(record: Record) -> Signals:
    """What of a record drives a model, on the device; time begins with each run."""
    if not record.runs:
        return one_signals.signals_of(record)
    parts: list[Signals] = []
    last = [run for run in record.runs if not run.held_out][-1]
    stop_s = last.clock_s + float(np.ptp(record.time[last.rows]))
    for run in record.runs:
        # As `Model.predict` counts the time of a record whose clock goes on.
        goes_on = run.held_out and last.clock_s <= run.clock_s <= 2 * stop_s - last.clock_s
        begins = run.clock_s - last.clock_s if goes_on else 0.0
        parts.append(
            Signals(
                jnp.asarray(record.time[run.rows] - record.time[run.start] + begins),
                jnp.asarray(record.input[run.rows]),
                {name: jnp.asarray(values[run.rows]) for name, values in record.aux.items()},
            )
        )
    whole = one_signals.signals_of(record)
    return JoinedSignals(
        whole.time,
        whole.input,
        whole.aux,
        tuple(parts),
        tuple(run.initial_memory for run in record.runs),
        tuple(run.held_out for run in record.runs),
    )


def thinned(some: Signals, whole: Signals, kept: np.ndarray) -> Signals:
    """Signals of some samples, with all of them for the effects of the input."""

    def of_run(few: Signals, all_of_it: Signals, own: np.ndarray) -> Signals:
        return ThinnedSignals(few.time, few.input, few.aux, all_of_it, jnp.asarray(own))

    if not (isinstance(some, JoinedSignals) and isinstance(whole, JoinedSignals)):
        return of_run(some, whole, kept)
    own = [kept[few] - every.start for few, every in zip(some.rows, whole.rows, strict=True)]
    parts = map(of_run, some.parts, whole.parts, own)
    return JoinedSignals(
        some.time, some.input, some.aux, tuple(parts), some.memories, some.held_out
    )


def of_run(
    chain: Chain, coefficients: Coefficients, signals: JoinedSignals, position: int
) -> Coefficients:
    """The linear numbers of a model along one of its runs."""
    cells, both = chain.plane.cells, 2 * chain.plane.levels
    offset, added, first_run = coefficients.offset, coefficients.added, coefficients.first_run
    if signals.held_out[position]:
        lasting = np.array([each.amount for _, each in chain.coefficients], dtype=bool)
        added = np.where(lasting, added, 0.0)
    else:
        row = signals.fitted.index(position)
        if row < len(coefficients.own):
            offset, added = float(coefficients.own[row, 0]), coefficients.own[row, 1:]
    return Coefficients(
        coefficients.weights,
        coefficients.memory[position * cells : (position + 1) * cells],
        offset,
        added,
        first_run[position * both : (position + 1) * both],
    )


def of_last_run(chain: Chain, coefficients: Coefficients, signals: Signals) -> Coefficients:
    """The linear numbers of a model along the last run that is not held out."""
    if not isinstance(signals, JoinedSignals):
        return coefficients
    return of_run(chain, coefficients, signals, signals.fitted[-1])


def _along(
    compute: Callable[..., Any],
    chain: Chain,
    values: EffectValues,
    signals: Signals,
    coefficients: Coefficients,
    *more: Any,
    axis: int = 0,
) -> Any:
    """What is computed along each run with its own linear numbers, one behind the other."""
    if not isinstance(signals, JoinedSignals):
        return compute(chain, values, signals, coefficients, *more)
    own = [of_run(chain, coefficients, signals, position) for position in range(len(signals.parts))]
    pairs = zip(signals.parts, own, strict=True)
    parts = [compute(chain, values, part, numbers, *more) for part, numbers in pairs]
    of = np if isinstance(parts[0], np.ndarray) else jnp
    return of.concatenate(parts, axis=axis)


def driven_path(chain: Chain, values: EffectValues, signals: Signals) -> jax.Array:
    """The input behind the effects of the input, `(time,)`."""
    paths = [one_driven.driven_path(chain, values, part) for part in parts_of(signals)]
    return paths[0] if len(paths) == 1 else jnp.concatenate(paths)


def hysteresis_output(
    chain: Chain, values: EffectValues, signals: Signals, coefficients: Coefficients
) -> jax.Array:
    """Output of the Preisach operator and of the first run of each run, `(time,)`."""
    return _along(one_hysteresis.hysteresis_output, chain, values, signals, coefficients)


def response(
    chain: Chain, values: EffectValues, signals: Signals, coefficients: Coefficients
) -> jax.Array:
    """The output of a model, `(time,)`."""
    return _along(one_output.response, chain, values, signals, coefficients)


def tangents(
    chain: Chain,
    values: EffectValues,
    signals: Signals,
    coefficients: Coefficients,
    parameters: list[tuple[str, str]],
) -> np.ndarray:
    """Derivatives of the output with respect to nonlinear parameters, `(time, parameters)`."""
    return _along(one_output.tangents, chain, values, signals, coefficients, parameters)


def responses(
    chain: Chain,
    values: EffectValues,
    signals: Signals,
    coefficients: Coefficients,
    effect: str,
    many: list[dict[str, float]],
) -> np.ndarray:
    """Outputs of a model at several values of one effect's parameters, `(values, time)`."""
    return _along(one_output.responses, chain, values, signals, coefficients, effect, many, axis=1)


def hysteresis_columns(
    chain: Chain,
    values: EffectValues,
    signals: Signals,
    initial_memory: str,
    output: np.ndarray | None = None,
) -> HysteresisColumns:
    """Columns of the Preisach operator along what drives it.

    Arguments:
        output: (time,) output of the operator, for an effect that feeds it back.
    """

    def columns(part: Signals, memory: str, own: np.ndarray | None) -> HysteresisColumns:
        course = one_driven.drive(chain, values, part, own)
        plain = one_driven.drive(chain, values, part) if chain.feeds_back else course
        return one_hysteresis.hysteresis_columns(chain, course, memory, plain)

    if not isinstance(signals, JoinedSignals):
        return columns(signals, initial_memory, output)
    found: list[HysteresisColumns] = []
    for position, (part, rows) in enumerate(zip(signals.parts, signals.rows, strict=True)):
        memory = signals.memories[position]
        if signals.held_out[position] and memory == "free":
            memory = MIDDLE
        own = columns(part, memory, None if output is None else output[rows])
        if signals.held_out[position]:
            own = _without_first_run(own)
        found.append(own)
    return _side_by_side(found, chain.plane.cells)


def is_one_path(chain: Chain, signals: Signals) -> bool:
    """Whether all hysterons are ramps that follow one path along one run."""
    moves = bool(chain.at(HysteresisEffect)) or chain.hysteron != "ramp"
    return not moves and not isinstance(signals, JoinedSignals)


def combinations_along(
    chain: Chain,
    values: EffectValues,
    signals: Signals,
    initial_memory: str,
    shares: tuple[np.ndarray, ...],
    like: HysteresisColumns,
) -> HysteresisColumns:
    """Combinations of the columns along a moved path (`is_one_path`), without these.

    Arguments:
        shares: see `chain.hysteresis.combinations_along`.
        like: the combinations along the recorded input, whose states are not asked for.
    """
    course = one_driven.drive(chain, values, signals)
    states, start = one_hysteresis.combinations_along(chain, course, initial_memory, shares)
    return replace(like, states=states, start=start)


def _without_first_run(columns: HysteresisColumns) -> HysteresisColumns:
    groups = tuple(group for group in columns.groups if len(group))
    none = np.zeros_like(columns.first_run)
    return replace(columns, switched=columns.switched[:, :0], groups=groups, first_run=none)


def _side_by_side(parts: list[HysteresisColumns], cells: int) -> HysteresisColumns:
    """Columns of all runs: the cells below one another, the others as blocks on a diagonal."""
    count = sum(len(part.states) for part in parts)
    pasts = sum(part.states.shape[1] - cells for part in parts)
    states = np.zeros((count, cells + pasts))
    switched = np.zeros((count, sum(part.switched.shape[1] for part in parts)))
    groups: list[np.ndarray] = []
    row, past, turn = 0, cells, 0
    for position, part in enumerate(parts):
        rows = slice(row, row + len(part.states))
        states[rows, :cells] = part.states[:, :cells]
        own = part.states[:, cells:]
        states[rows, past : past + own.shape[1]] = own
        switched[rows, turn : turn + part.switched.shape[1]] = part.switched
        groups += [group + position * cells for group in part.groups if len(group)]
        row, past, turn = rows.stop, past + own.shape[1], turn + part.switched.shape[1]
    groups += [np.zeros(0, dtype=int)] * switched.shape[1]
    return HysteresisColumns(
        states,
        switched,
        tuple(groups),
        np.concatenate([part.start for part in parts]),
        np.concatenate([part.first_run for part in parts]),
    )


def _differ(chain: Chain) -> np.ndarray:
    """(coefficient,) whether each run has its own."""
    by_name = {effect.name: effect for effect in chain.effects}
    return np.array(
        [by_name[name].of_time_alone or not each.amount for name, each in chain.coefficients],
        dtype=bool,
    )


def regressors(
    chain: Chain,
    values: EffectValues,
    signals: Signals,
    hysteresis: HysteresisColumns,
    rows: np.ndarray,
    measured: np.ndarray,
) -> Columns:
    """The columns that the linear coefficients multiply, at given nonlinear parameters.

    Arguments:
        rows: (row,) samples to keep, in their order.
        measured: (row,) measured output at these samples, for the effects of the sensor.

    Returns:
        The columns, `(row, column)`; behind the offset those of single runs, then the others.
    """
    if not isinstance(signals, JoinedSignals):
        return one_matrix.regressors(chain, values, signals, hysteresis, rows, measured)
    differ = _differ(chain)
    amounts = np.array([each.amount for _, each in chain.coefficients], dtype=bool)
    own = [
        (run, place)
        for run in range(len(signals.fitted) - 1)
        for place in (0, *(np.flatnonzero(differ) + 1).tolist())
    ]
    matrix, columns = np.zeros((0, 0)), None
    for position, (part, all_rows) in enumerate(zip(signals.parts, signals.rows, strict=True)):
        inside = np.flatnonzero((rows >= all_rows.start) & (rows < all_rows.stop))
        here = replace(
            hysteresis, states=hysteresis.states[all_rows], switched=hysteresis.switched[all_rows]
        )
        local = rows[inside] - all_rows.start
        columns = one_matrix.regressors(chain, values, part, here, local, measured[inside])
        edge = columns.offset + 1
        if not len(matrix):
            matrix = np.zeros((len(rows), columns.matrix.shape[1] + len(own)))
        matrix[inside, :edge] = columns.matrix[:, :edge]
        behind = columns.matrix[:, edge:]
        held_out = signals.held_out[position]
        # The last run's columns stand where those of a single one would.
        at_last = position == signals.fitted[-1]
        shared = ~differ | at_last | (held_out & amounts)
        places = edge + len(own) + np.flatnonzero(shared)
        matrix[np.ix_(inside, places)] = behind[:, shared]
        if not held_out and not at_last:
            run = signals.fitted.index(position)
            for place, (of, which) in enumerate(own):
                if of == run:
                    matrix[inside, edge + place] = behind[:, which - 1] if which else 1.0
    assert columns is not None
    loose = np.zeros(matrix.shape[1], dtype=bool)
    edge = columns.offset + 1
    loose[edge : edge + len(own)] = [bool(which) and not amounts[which - 1] for _, which in own]
    loose[edge + len(own) :] = ~amounts
    return replace(columns, matrix=matrix, loose=loose, own=tuple(own))


def columns_behind(
    chain: Chain, values: EffectValues, signals: Signals, rows: np.ndarray, measured: np.ndarray
) -> list[np.ndarray]:
    """What the coefficients of added, output and sensor effects multiply, `(time, column)` each.

    Where each run has coefficients of its own, there are as many columns of them as runs that are
    fitted, behind the others.
    """
    if not isinstance(signals, JoinedSignals):
        return one_matrix.columns_behind(chain, values, signals, rows, measured)
    parts: list[list[np.ndarray]] = []
    for part, all_rows in zip(signals.parts, signals.rows, strict=True):
        inside = (rows >= all_rows.start) & (rows < all_rows.stop)
        local = rows[inside] - all_rows.start
        parts.append(one_matrix.columns_behind(chain, values, part, local, measured[inside]))
    found: list[np.ndarray] = []
    start, differ = 0, _differ(chain)
    for own in zip(*parts, strict=True):
        stop = start + own[0].shape[1]
        alone = differ[start:stop]
        blocks = np.zeros((sum(map(len, own)), alone.sum() * len(signals.fitted)))
        for run, position in enumerate(signals.fitted):
            place = slice(run * alone.sum(), (run + 1) * alone.sum())
            blocks[signals.rows[position], place] = own[position][:, alone]
        common = np.concatenate([each[:, ~alone] for each in own])
        found.append(np.concatenate([common, blocks], axis=1))
        start = stop
    return found
