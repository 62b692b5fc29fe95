"""Records of the paper's experiment: the command, the stage behind its notch, the encoder."""

from __future__ import annotations

import math
from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax.core import Tracer

from preisach_jax.errors import InputError
from preisach_jax.piezo.notch import RATE_HZ, notch_filter
from preisach_jax.piezo.stage import PiezoStage, paper_stage
from preisach_jax.plant import ENCODER_STEP_UM, RANGE_V
from preisach_jax.signals import bernoulli_ramp
from preisach_jax.signals.checks import as_key


class PiezoRecord(NamedTuple):
    """One record of the experiment.

    Arguments:
        time_s: (time,) s.
        command_v: (time,) command before the notch filter, V.
        input_v: (time,) drive of the stage, V: what the identification calls x.
        stroke_um: (time,) measured stroke z, µm.
    """

    time_s: jax.Array
    command_v: jax.Array
    input_v: jax.Array
    stroke_um: jax.Array


def _in_steps(position: jax.Array, step: float) -> jax.Array:
    return position if step == 0.0 else jnp.round(position / step) * step


_encoded = jax.custom_jvp(_in_steps, nondiff_argnums=(1,))


@_encoded.defjvp
def _encoded_jvp(
    step: float, primals: tuple[jax.Array], tangents: tuple[jax.Array]
) -> tuple[jax.Array, jax.Array]:
    return _encoded(primals[0], step), tangents[0]


def encode(position: jax.Array, step: float) -> jax.Array:
    """Position in whole steps of an encoder, step·round(z/step).

    The derivative is that without an encoder, since the true one is zero wherever it exists.

    Arguments:
        position: z, µm, of any shape.
        step: step of the encoder, µm; 0 is none.

    Returns:
        Encoded position, µm, of the same shape.

    Example:
        >>> import jax
        >>> encode(jax.numpy.asarray(0.8), 0.5).item(), jax.grad(encode)(0.8, 0.5).item()
        (1.0, 1.0)
    """
    return _encoded(position, step)


def experiment(
    key: jax.Array,
    samples: int,
    stage: PiezoStage | None = None,
    rate_hz: float = 2000.0,
    noise_um: float = 0.0,
    encoder_step_um: float = ENCODER_STEP_UM,
) -> PiezoRecord:
    """Simulate one record of the paper's experiment, section IV.

    A Bernoulli ramp over 0 V to 75 V is commanded at 5 kHz and smoothed by the notch filter (26);
    the amplifier keeps it in this range, which here cuts off no more than rounding; the stage moves
    and the encoder reads. Of the pairs (x, z) of one instant those at floor(5 kHz k/rate) are kept,
    at 2 kHz every second or third. To a rate-independent hysteresis uneven steps of time mean
    nothing, while interpolated pairs would lie on chords along which the stage never ran.

    Arguments:
        key: random key (`jax.random.key`).
        samples: number of samples at the lower rate.
        stage: the stage; None is `paper_stage()`.
        rate_hz: rate of the record, Hz; at most 5 kHz. The paper's identification ran at 2 kHz.
        noise_um: standard deviation of white noise of the sensor, µm, before the encoder rounds.
        encoder_step_um: step of the encoder, µm; 0 is none.

    Returns:
        The record; `jax.jit` and `jax.vmap` over keys work.

    Raises:
        InputError: a number is out of its range.

    Example:
        >>> import jax
        >>> record = experiment(jax.random.key(0), samples=1000)
        >>> record.stroke_um.shape, [f"{t:.4f}" for t in record.time_s[:3]]
        ((1000,), ['0.0000', '0.0004', '0.0010'])
    """
    key = as_key(key)
    if samples != int(samples) or samples < 1:
        raise InputError(f"samples is {samples}: give a whole number of at least 1")
    if not 0.0 < rate_hz <= RATE_HZ:
        raise InputError(f"rate_hz is {rate_hz!r}: give a number above 0, at most {RATE_HZ:g}")
    for name, value in (("noise_um", noise_um), ("encoder_step_um", encoder_step_um)):
        if not isinstance(value, Tracer) and not 0.0 <= value < math.inf:
            raise InputError(f"{name} is {value!r}: give 0 or a number above it")
    stage = paper_stage() if stage is None else stage
    return _experiment(key, samples, stage, rate_hz, jnp.asarray(noise_um), encoder_step_um)


@eqx.filter_jit
def _experiment(
    key: jax.Array,
    samples: int,
    stage: PiezoStage,
    rate_hz: float,
    noise_um: jax.Array,
    encoder_step_um: float,
) -> PiezoRecord:
    # A whole multiple must not fall to the sample below by rounding.
    kept = np.floor(np.arange(samples) * (RATE_HZ / rate_hz) + 1e-6).astype(int)
    coin_key, noise_key = jax.random.split(key)
    command = bernoulli_ramp(coin_key, int(kept[-1]) + 1, RATE_HZ, low=0.0, high=RANGE_V)
    drive = jnp.clip(notch_filter(command), 0.0, RANGE_V)
    stroke = stage.response(drive)[kept]
    noise = noise_um * jax.random.normal(noise_key, stroke.shape, stroke.dtype)
    return PiezoRecord(
        time_s=jnp.asarray(kept / RATE_HZ, stroke.dtype),
        command_v=command[kept],
        input_v=drive[kept],
        stroke_um=encode(stroke + noise, encoder_step_um),
    )
