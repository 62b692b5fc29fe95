"""What parameters would be if the input went in arcs from sample to sample, not straight."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import jax
import jax.numpy as jnp
import numpy as np
import scipy

from preisach_jax.chain import ThinnedSignals
from preisach_jax.chain.runs import response
from preisach_jax.chain.signals import each_run, parts_of
from preisach_jax.effects.base import Signals
from preisach_jax.effects.parameter import Parameter
from preisach_jax.identify.confidence import Influences
from preisach_jax.identify.point import Point
from preisach_jax.identify.problem import Problem
from preisach_jax.model import ParameterEstimate

OF_HALF_A_STEP = 4 / 3
"""Error of straight lines over what halves of them take off: it goes with the step squared."""

FURTHEST = 50.0
"""Logarithm of a factor beyond which an end of an interval is not moved."""


def with_arcs(
    found: Mapping[str, Mapping[str, ParameterEstimate]],
    problem: Problem,
    point: Point,
    by: Influences,
) -> dict[str, dict[str, ParameterEstimate]]:
    """Intervals that hold the values of a model whose input goes in arcs between its samples, too.

    A record does not tell how its input went between two samples.  What a model's output changes by
    arcs in place of straight lines (`change_by_arcs`) moves its columns as noise does.
    """
    wider = {effect: dict(own) for effect, own in found.items()}
    if not any(wider.values()):
        return wider
    moved = _moved_by(change_by_arcs(problem, point), problem, point, by)
    if not np.isfinite(moved).all():
        return wider
    nonlinear = zip(point.parameters, moved[len(point.solution) :] / by.linear.scale, strict=True)
    amounts = moved[: len(point.solution)] * problem.unit / point.equations.scale
    linear = zip(point.chain.coefficients, amounts[point.columns.first_added :], strict=True)
    for (effect, parameter), shift in (*nonlinear, *linear):
        wider[effect][parameter.name] = _reaching(parameter, wider[effect][parameter.name], shift)
    return wider


def _reaching(parameter: Parameter, own: ParameterEstimate, shift: float) -> ParameterEstimate:
    """An interval about a value, and about what it would be without a shift."""
    shift = float(np.clip(shift, -FURTHEST, FURTHEST)) if parameter.log else float(shift)
    if shift > 0:
        return replace(own, low=parameter.from_search(parameter.to_search(own.low) - shift))
    if shift < 0:
        return replace(own, high=parameter.from_search(parameter.to_search(own.high) - shift))
    return own


def _moved_by(change: np.ndarray, problem: Problem, point: Point, by: Influences) -> np.ndarray:
    """(column,) what a change of the output, `(row,)` in output ranges, moves of every column."""
    rows = np.isin(problem.fold, point.folds)
    parts = (point.matrix, by.linear.tangents)
    pull = np.concatenate([part[rows].T @ change[rows] for part in parts])[by.inside]
    moved = np.zeros(len(by.gram))
    gram = by.gram[np.ix_(by.inside, by.inside)]
    moved[by.inside] = scipy.linalg.solve(gram, pull, assume_a="pos")
    return moved


def change_by_arcs(problem: Problem, point: Point) -> np.ndarray:
    """By how much the output of a model changes where its input bends between the samples.

    The model runs along twice as many samples, of which every second one lies on an arc through its
    neighbours.  What goes straight from sample to sample inside a model, as that does which a lag
    passes on to a mode, goes straight for half the time there.

    Returns:
        (row,) change, in output ranges; zero along a record that was thinned.
    """
    parts = parts_of(problem.signals)
    if any(isinstance(part, ThinnedSignals) for part in parts):
        return np.zeros(len(problem.rows))
    numbers = point.coefficients()
    straight, bent = (
        np.asarray(response(point.chain, point.values, signals, numbers))
        for signals in (problem.signals, each_run(on_arcs, problem.signals))
    )
    # Nothing lies between the last sample of a run and the first one of the next.
    run = np.repeat(np.arange(len(parts)), [len(part.time) for part in parts])
    at_samples = bent[2 * np.arange(len(run)) - run]
    return OF_HALF_A_STEP * (at_samples - straight)[problem.rows] / problem.unit


def on_arcs(signals: Signals) -> Signals:
    r"""Signals with a sample between each two; that of the input lies on an arc.

    \[ x_{k+1/2} = \frac{x_k + x_{k+1}}{2} - \frac{\Delta t^2}{8}\,
       \frac{a_k a_{k+1} (a_k + a_{k+1})}{a_k^2 + a_{k+1}^2} \]

    with the second differences a, and no arc where their signs differ: corners stay corners (G. D.
    van Albada, B. van Leer, W. W. Roberts, Astron. Astrophys. 108 (1982) 76-84).
    """
    time, x = np.asarray(signals.time), np.asarray(signals.input)
    step = np.diff(time)
    slope = np.diff(x) / np.where(step > 0, step, 1.0)
    apart = step[1:] + step[:-1]
    bend = np.pad(2 * np.diff(slope) / np.where(apart > 0, apart, 1.0), 1)
    begin, end = bend[:-1], bend[1:]
    alike = begin * end > 0
    squares = np.where(alike, begin**2 + end**2, 1.0)
    mean = np.where(alike, begin * end * (begin + end) / squares, 0.0)
    return Signals(
        _between(signals.time),
        _between(signals.input, mean * step**2 / 8),
        {name: _between(values) for name, values in signals.aux.items()},
    )


def _between(values: jax.Array, arc: np.ndarray | float = 0.0) -> jax.Array:
    """Values with the mean of each two between them, less the height of an arc."""
    here = np.asarray(values)
    middle = (here[1:] + here[:-1]) / 2 - arc
    return jnp.asarray(np.insert(here, np.arange(1, len(here)), middle), values.dtype)
