"""The output of a chain as one function, which JAX differentiates in the arrays of its effects.

What `output` computes for numbers that are known, this computes for numbers that are traced: the
linear coefficients are arguments, and the plane is that from 0 to 1, so that what is compiled for
one record serves others of its size.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any, cast

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from preisach_jax.chain.coefficients import Coefficients
from preisach_jax.chain.compiled import as_array
from preisach_jax.chain.description import PLACES, Chain, EffectValues
from preisach_jax.chain.driven import drive
from preisach_jax.chain.hysteresis import first_run_output, hysteresis_output, operator_output
from preisach_jax.chain.output import behind_hysteresis
from preisach_jax.chain.signals import Drive
from preisach_jax.effects.base import Signals


class DrivenRun(eqx.Module):
    """What a chain is driven by along one run, and the numbers that it has there.

    Attributes:
        signals: what drives the run.
        weights, memory, added, first_run: as those of `Coefficients`.
        offset: () output with all hysterons off, in output units.
        hysteresis: (time,) output of the operator where it is known, in output units: it stays
            while no effect before the hysteresis changes, and what is fed back is held at it.
    """

    signals: Signals
    weights: np.ndarray
    memory: np.ndarray
    offset: np.ndarray
    added: np.ndarray
    first_run: np.ndarray
    hysteresis: Array | None

    @staticmethod
    def of(
        chain: Chain,
        values: EffectValues,
        signals: Signals,
        coefficients: Coefficients,
        changing: tuple[str, ...],
    ) -> DrivenRun:
        """A run as it is before the arrays of some effects change."""
        known = None
        if chain.feeds_back or not _changes_course(chain, changing):
            known = hysteresis_output(chain, values, signals, coefficients)
        return DrivenRun(
            signals,
            coefficients.weights,
            coefficients.memory,
            np.asarray(coefficients.offset),
            coefficients.added,
            coefficients.first_run,
            known,
        )

    @property
    def coefficients(self) -> Coefficients:
        """The linear numbers, which may be traced."""
        return Coefficients(
            self.weights, self.memory, cast(Any, self.offset), self.added, self.first_run
        )


def on_the_unit_plane(chain: Chain) -> tuple[Chain, tuple[np.ndarray, np.ndarray]]:
    """A chain whose numbers are arrays and whose plane goes from 0 to 1, and the scale of its own.

    Returns:
        The chain, and lower limit and width of its plane, in input units.
    """
    plane = chain.plane
    scale = np.asarray(plane.low), np.asarray(plane.high - plane.low)
    unit = replace(chain, plane=plane.scaled())
    return jax.tree.map(as_array, unit), scale


def output_along(
    chain: Chain,
    scale: tuple[np.ndarray, np.ndarray],
    values: EffectValues,
    run: DrivenRun,
    changing: tuple[str, ...],
) -> Float[Array, " time"]:
    """The output of a model along a run, differentiable in all arrays of its effects.

    What is fed back is held fixed, as it is in the `regressors` and the `tangents`.

    Returns:
        The output, in output units.
    """
    coefficients, given = run.coefficients, run.hysteresis
    if given is None or _changes_course(chain, changing):

        def scaled(path: Array) -> Array:
            return (path - scale[0]) / scale[1]

        def on_plane(course: Drive) -> Drive:
            return jax.tree.map(scaled, course)

        plain = course = on_plane(drive(chain, values, run.signals))
        if chain.feeds_back:
            course = on_plane(drive(chain, values, run.signals, run.hysteresis))
        given = operator_output(chain, course, coefficients)
        given = given + first_run_output(chain, plain, coefficients.first_run)
    return jnp.asarray(behind_hysteresis(chain, values, run.signals, given, coefficients))


def _changes_course(chain: Chain, changing: tuple[str, ...]) -> bool:
    """Whether one of some effects acts on what drives the hysterons."""
    before = {effect.name for place in PLACES[:2] for effect in chain.at(place)}
    return bool(before & set(changing))
