"""The experiment on the stage: play a drive, hide effects, read the encoder, keep the truth."""

from __future__ import annotations

import csv
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from preisach_jax.errors import InputError
from preisach_jax.plant.draws import Measurement, draw_effect, effect_names
from preisach_jax.plant.effects import (
    add_disturbances,
    bend,
    columns,
    leaked,
    move,
    respond,
    round_to,
    with_forces,
)
from preisach_jax.plant.stage import RANGE_V, make_stage
from preisach_jax.signals import diagnostic_record

ENCODER_STEP_UM = 1.22e-3  # of a common interpolated grating, and of the paper's stage
INNER_RATE_HZ = 10_000.0  # the stage is integrated at least this often


def save_columns(path: str | Path, columns: Mapping[str, np.ndarray]) -> None:
    """Write columns, (time,) each, comma-separated under their names, with ten digits."""
    texts = [[f"{value:.10g}" for value in column.tolist()] for column in columns.values()]
    with Path(path).open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(columns)
        writer.writerows(zip(*texts, strict=True))


@dataclass(frozen=True)
class StageRecord:
    """What the simulated experiment has measured, and what was hidden in it.

    Arguments:
        time: (time,) s.
        input: (time,) drive, V.
        output: (time,) position, µm, with noise and encoder steps.
        aux: (time,) auxiliary columns by name; the unit is the end of the name.
        truth: the hidden effects and their parameters, ready for JSON.
    """

    time: np.ndarray
    input: np.ndarray
    output: np.ndarray
    aux: Mapping[str, np.ndarray]
    truth: dict[str, Any]

    def save(self, path: str | Path) -> None:
        """Write the measured columns t_s, u_V, z_um and the auxiliary ones, comma-separated.

        Arguments:
            path: the file to write.

        Example:
            >>> import tempfile
            >>> with tempfile.TemporaryDirectory() as folder:
            ...     simulate_stage(seconds=3.0).save(Path(folder) / "stage.csv")
            ...     print((Path(folder) / "stage.csv").read_text().splitlines()[0])
            t_s,u_V,z_um
        """
        # Ten digits hold an encoder step, a sixteen-bit drive and half a microsecond in an hour.
        columns = {"t_s": self.time, "u_V": self.input, "z_um": self.output, **self.aux}
        save_columns(path, columns)


def simulate_stage(
    seed: int = 0,
    seconds: float = 24.0,
    effects: Sequence[str] = (),
    rate_hz: float = 2000.0,
    *,
    drive: np.ndarray | None = None,
    noise_um: float = 0.006,
    encoder_step_um: float = ENCODER_STEP_UM,
) -> StageRecord:
    """Simulate the measurement of a piezo stage with the chosen effects hidden in it.

    The drive runs straight from sample to sample and has been at its first value for ever. What
    each effect does, what its parameters mean and in which order they act stands in
    `preisach_jax.plant.effects`.

    Arguments:
        seed: whole number, at least 0, which draws the stage, the effects and the noise.
        seconds: duration, s; with `drive`, its own length counts.
        effects: names out of `plant.EFFECTS`; "aux" is short for "aux:load_N", "gain" for
            "gain:temp_C", "cross" for "cross:y_V", each of which adds a column.
        rate_hz: sampling rate, Hz; without `drive`, seconds times rate_hz must be 6,000 or more.
        drive: (time,) drive from 0 to 75 V; None is `diagnostic_record`.
        noise_um: standard deviation of the sensor's white noise, µm.
        encoder_step_um: step of the encoder, µm; 0 is none.

    Returns:
        The record and the truth.

    Raises:
        InputError: an effect is unknown, or the drive, a size or a rate cannot be used.

    Example:
        >>> record = simulate_stage(seed=1, seconds=6.0, effects=("creep",), rate_hz=1000.0)
        >>> record.output.shape, record.truth["effects"]
        ((6000,), ['creep'])
    """
    names = effect_names(effects)
    if seed != int(seed) or seed < 0:
        raise InputError(f"seed is {seed!r}: give a whole number, at least 0")
    for name, value in (("seconds", seconds), ("rate_hz", rate_hz)):
        if not 0.0 < value < math.inf:
            raise InputError(f"{name} is {value!r}: give a number above 0")
    for name, value in (("noise_um", noise_um), ("encoder_step_um", encoder_step_um)):
        if not 0.0 <= value < math.inf:
            raise InputError(f"{name} is {value!r}: give 0 or a number above it")
    u = _drive(drive, seconds, rate_hz)
    stage = make_stage(int(seed))
    fastest = float(np.max(np.abs(np.diff(u))) * rate_hz)
    measurement = Measurement(u.size / rate_hz, stage.stroke(), fastest)
    hidden = {name: draw_effect(name, int(seed), measurement) for name in names}
    stroke = stage.stroke(hidden.get("moving", {}).get("a_V_per_um", 0.0))

    fine = math.ceil(INNER_RATE_HZ / rate_hz - 1e-9)
    step = 1.0 / (rate_hz * fine)
    time, inner = np.arange(u.size) / rate_hz, np.arange((u.size - 1) * fine + 1) * step
    course, made = np.interp(inner, time, u), columns(hidden, inner, int(seed))
    position = respond(hidden, move(stage, hidden, course, step), inner, made, step)
    position = with_forces(hidden, position, course, made, step)
    position, aux = add_disturbances(hidden, position, inner, int(seed))
    position, aux = leaked(hidden, position, step), aux | made
    z = _read(position[::fine], hidden, stroke, int(seed), noise_um, encoder_step_um)
    truth = {
        "effects": names,
        "parameters": hidden,
        "seed": int(seed),
        "seconds": u.size / rate_hz,
        "rate_hz": float(rate_hz),
        "stroke_um": stroke,
        "noise_um": float(noise_um),
        "encoder_step_um": float(encoder_step_um),
    }
    return StageRecord(time, u, z, {name: column[::fine] for name, column in aux.items()}, truth)


def _read(
    position: np.ndarray,
    hidden: Mapping[str, Mapping[str, Any]],
    stroke: float,
    seed: int,
    noise_um: float,
    encoder_step_um: float,
) -> np.ndarray:
    """What the sensor and the converters behind it show of a position, both in µm."""
    z = position
    if "output_nonlinearity" in hidden:
        z = bend(z, hidden["output_nonlinearity"]["coefficients_um"], stroke)
    z = z + np.random.default_rng([seed, 2]).normal(0.0, noise_um, z.size)
    if encoder_step_um:
        z = round_to(z, encoder_step_um)
    if "output_quantisation" in hidden:
        z = round_to(z, hidden["output_quantisation"]["step_um"])
    return z


def _drive(drive: np.ndarray | None, seconds: float, rate_hz: float) -> np.ndarray:
    if drive is None:
        return diagnostic_record(seconds, rate_hz, 0.0, RANGE_V)
    u = np.asarray(drive, float)
    if u.ndim != 1 or u.size < 2:
        raise InputError(f"the drive has the shape {u.shape}: give (time,) with two values or more")
    if not np.all((u >= 0.0) & (u <= RANGE_V)):
        raise InputError(f"the drive runs from {u.min()} to {u.max()}: keep it in 0 to 75 V")
    return u
