"""What a model whose hysteresis is inside mechanics predicts."""

from __future__ import annotations

import numpy as np

from preisach_jax.chain import Chain, EffectValues
from preisach_jax.cores import on_processor
from preisach_jax.errors import InputError
from preisach_jax.mechanics.body import FARTHEST, along, at_rest, body_of, closes, fitted_start
from preisach_jax.record import Record


def moved(
    chain: Chain, values: EffectValues, weights: np.ndarray, record: Record, *, begins: bool
) -> np.ndarray:
    """Displacement of a model's body along a record, `(time,)`.

    Arguments:
        weights: (cells,) weights, in units of force.
        begins: whether the record begins as the fitted one did.  Otherwise it begins at rest,
            or in the steady state of an input that closes as a period does.
    """
    effect, plane = chain.mechanics, chain.plane
    assert effect is not None
    own = values[effect.name]
    time, force, f_hz = record.time, record.input, own["f_hz"]
    with on_processor():
        body = body_of(effect, own, plane, weights)
        start = fitted_start(effect, plane) if begins else at_rest(effect, plane)
        if not begins and closes(time, force):
            start = along(body, start, *_once_more(time, force), f_hz)[1]
        path = along(body, start, time, force, f_hz)[0]
    farthest = FARTHEST * max(abs(plane.low), abs(plane.high))
    beyond = np.flatnonzero(~(np.abs(path) <= farthest))
    if len(beyond):
        raise InputError(
            f"{record.name}: along this input the output comes to {path[beyond[0]]:.4g} "
            f"{record.output_unit} from rest in sample {beyond[0] + 1}, and the model "
            f"knows it up to {farthest / FARTHEST:.4g}; fit it to a record that goes as far"
        )
    return path


def check_not_inside(chain: Chain, origin: str, what: str) -> None:
    """Ask whether a model's hysteresis is driven by its input."""
    if chain.mechanics:
        raise InputError(
            f"the model of {origin} has its hysteresis inside mechanics "
            f"(restoring_force): there is {what} only of models whose input drives the hysteresis; "
            "predict and compare work with it, or fit a model of other effects"
        )


def _once_more(time: np.ndarray, force: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The period before a record that repeats, up to its first sample."""
    step = float(np.median(np.diff(time)))
    length = time[-1] - time[0] + step
    return np.append(time - length, time[0]), np.append(force, force[0])
