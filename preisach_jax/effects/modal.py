"""What effects with several modes of a mechanics share: parameters, step, and measured starts."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, Self

import equinox as eqx
import jax.numpy as jnp
import numpy as np
import scipy
from jaxtyping import Array

from preisach_jax.effects.base import Effect, Survey, Values
from preisach_jax.effects.linear import oscillators
from preisach_jax.effects.parameter import parameter

MOST_MODES = 4
"""Modes of one effect at most."""

LIGHTEST = 0.001
"""Least damping ratio."""

WEAKEST_RING = 0.5
"""Damping ratio of a further mode at most: what rings less is a lag."""


SEGMENTS = 8
"""Least number of segments, which overlap by half, over which a response is averaged."""

FINEST = 1024
"""Longest segment, in samples."""

DAMPINGS = (0.005, 0.015, 0.04, 0.12)
"""Damping ratios at which a mode is looked for."""

LEAST_POWER = 1e-4
"""Power of the drive, over its greatest, at a frequency at which a mode is looked for."""


@dataclass(frozen=True)
class Mode:
    """A mode by which a signal follows another.

    Attributes:
        f_hz: natural frequency.
        zeta: damping ratio.
        gain: response to a slow drive, in units of the response over those of the drive.
        quadrature: the same for the rate over the natural frequency; a delay brings some.
    """

    f_hz: float
    zeta: float
    gain: float
    quadrature: float = 0.0


def _further(number: int) -> Any:
    """Declare the natural frequency of a mode after the first one."""
    return parameter(
        "Hz",
        lambda own: own.lowest_hz,
        lambda own: own.highest_hz,
        log=True,
        start=lambda own: (own.start_of(number).f_hz,),
        name=f"f_{number}_hz",
        meaning=f"natural frequency of mode {number}",
        when=lambda own: own.modes >= number,
    )


def _damping(number: int) -> Any:
    """Declare the damping ratio of a mode after the first one."""
    return parameter(
        "1",
        LIGHTEST,
        WEAKEST_RING,
        log=True,
        start=lambda own: (own.start_of(number).zeta,),
        name=f"zeta_{number}",
        meaning=f"damping ratio of mode {number}",
        when=lambda own: own.modes >= number,
    )


class Modal(Effect):
    """An effect of one to four modes of the mechanics.

    Arguments:
        starts: natural frequency in Hz, damping ratio and two gains (see `Mode`) of each mode that
            a frequency response shows, one mode behind the other.
    """

    modes: int = eqx.field(static=True, default=1, kw_only=True)
    starts: tuple[float, ...] = eqx.field(default=(), kw_only=True)
    f_hz: float = _further(1)
    zeta: float = _damping(1)
    f_2_hz: float = _further(2)
    zeta_2: float = _damping(2)
    f_3_hz: float = _further(3)
    zeta_3: float = _damping(3)
    f_4_hz: float = _further(4)
    zeta_4: float = _damping(4)

    @property
    @abstractmethod
    def lowest_hz(self) -> float:
        """The lowest natural frequency that is searched."""

    @property
    @abstractmethod
    def highest_hz(self) -> float:
        """The highest natural frequency that is searched."""

    @property
    def seen(self) -> tuple[float, ...]:
        """Natural frequency of the strongest mode that the frequency response shows, if any."""
        return self.starts[:1]

    def start_of(self, number: int) -> Mode:
        """Where the search for a mode starts; evenly apart where no record was seen."""
        own = self.starts[4 * number - 4 : 4 * number]
        if len(own) == 4:
            return Mode(*own)
        share = number / (MOST_MODES + 1)
        return Mode(self.lowest_hz ** (1 - share) * self.highest_hz**share, 0.02, 1.0)

    @property
    def damped(self) -> list[tuple[Any, Any]]:
        """Natural frequency and damping ratio of each mode, where the effect acts."""
        each = [
            (self.f_hz, self.zeta),
            (self.f_2_hz, self.zeta_2),
            (self.f_3_hz, self.zeta_3),
            (self.f_4_hz, self.zeta_4),
        ]
        return each[: self.modes]

    def modes_over(self, dt: Array) -> tuple[Array, Array]:
        """A and b of the modes over a step of `dt` seconds, see `linear.oscillators`."""
        f_hz, zeta = zip(*self.damped, strict=True)
        return oscillators(stacked(f_hz, dt), stacked(zeta, dt), dt)

    def searched_from(self, survey: Survey, drive: np.ndarray, static_known: bool) -> Self:
        """This effect with starts from the frequency response of what a model leaves to a drive."""
        if len(survey.residual) < 2 or np.ptp(drive) == 0:
            return self
        low, high = _inside(self)
        found = modes_in(
            survey.time, drive, survey.residual, low, high, self.modes, static_known=static_known
        )
        if not found or not found[0].gain:
            return self
        one = found[0].gain
        each = [(mode.f_hz, mode.zeta, mode.gain / one, mode.quadrature / one) for mode in found]
        return replace(self, starts=tuple(x for mode in each for x in mode))

    def with_mode_from(
        self, survey: Survey, drive: np.ndarray, values: Values, static_known: bool
    ) -> tuple[Self, dict[str, float]] | None:
        """This effect with a mode more, and natural frequency and damping ratio to start from.

        Arguments:
            drive: (sample,) what drives the modes.
        """
        if self.modes == MOST_MODES or np.ptp(drive) == 0:
            return None
        low, high = _inside(self)
        found = modes_in(
            survey.time, drive, survey.residual, low, high, 1, static_known=static_known
        )
        if not found:
            return None
        number = self.modes + 1
        mode = {f"f_{number}_hz": found[0].f_hz, f"zeta_{number}": found[0].zeta}
        return replace(self, modes=number), {**values, **mode}

    def reduced(self, values: Values) -> Sequence[tuple[Self, dict[str, float]]]:
        found: list[tuple[Self, dict[str, float]]] = []
        for gone in range(self.modes if self.modes > 1 else 0):
            kept = [number for number in range(1, self.modes + 1) if number != gone + 1]
            start: dict[str, float] = {}
            for place, number in enumerate(kept, start=1):
                start[_named("f", place, "_hz")] = values[_named("f", number, "_hz")]
                start[_named("zeta", place)] = values[_named("zeta", number)]
            found.append((replace(self, modes=self.modes - 1), start))
        return found


def stacked(values: Sequence[Any], like: Array) -> Array:
    return jnp.stack([jnp.asarray(value, like.dtype) for value in values])


def _named(kind: str, number: int, unit: str = "") -> str:
    """The name of a mode's parameter."""
    return f"{kind}_{number}{unit}" if number > 1 else f"{kind}{unit}"


def _inside(effect: Modal) -> tuple[float, float]:
    """Bounds of the natural frequencies with room for a search."""
    return 1.02 * effect.lowest_hz, effect.highest_hz / 1.02


def frequency_response(
    time: np.ndarray, drive: np.ndarray, response: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    r"""Response at each frequency, \(S_{ur} / S_{uu}\), averaged over segments (P. D. Welch).

    Arguments:
        time: (sample,) times in s; uneven ones are brought to the median step.
        drive, response: (sample,) input and output of what is between.

    Returns:
        Frequencies in Hz, complex responses, and power of the drive, each (frequency,).
    """
    step = float(np.median(np.diff(time)))
    even = np.arange(time[0], time[-1], step)
    moved = np.asarray(np.interp(even, time, drive - drive.mean()), float)
    answer = np.asarray(np.interp(even, time, response - response.mean()), float)
    size = min(FINEST, max(2 * len(even) // (SEGMENTS + 1), 16))
    hz, cross = scipy.signal.csd(moved, answer, fs=1 / step, nperseg=size)
    power = scipy.signal.csd(moved, moved, fs=1 / step, nperseg=size)[1].real
    return hz[1:], cross[1:] / np.maximum(power[1:], np.finfo(float).tiny), power[1:]


def modes_in(
    time: np.ndarray,
    drive: np.ndarray,
    response: np.ndarray,
    low: float,
    high: float,
    count: int,
    static_known: bool,
) -> tuple[Mode, ...]:
    r"""Modes by which one signal follows another, found one after the other.

    Each next mode is the one that takes most off what the others leave of the response, with a
    residue of any phase, since a delay turns it; then all residues are found again together by
    least squares.

    Arguments:
        time: (sample,) times in s.
        drive, response: (sample,) input and output of what is between.
        low, high: least and greatest natural frequency, in Hz.
        static_known: whether the response to a slow drive is known, so that of each mode only what
            it adds to that, \(H - 1\), is looked for.

    Returns:
        The modes, the strongest first; fewer where the drive has power at fewer frequencies.
    """
    hz, measured, power = frequency_response(time, drive, response)
    inside = (hz >= low) & (hz <= high) & (power > LEAST_POWER * power.max())
    grid = [(float(f), zeta) for f in hz[inside] for zeta in DAMPINGS]
    weight = np.sqrt(power)
    candidates = _residues(hz, grid, static_known) * weight[:, None, None]
    size = np.maximum(np.sum(np.abs(candidates) ** 2, axis=0), np.finfo(float).tiny)
    goal, found = _split(measured * weight), list[int]()
    left, residues = goal, np.zeros(0)
    for _ in range(min(count, int(inside.sum()))):
        moment = np.einsum("fmc,f->mc", candidates.conj(), left[: len(hz)] + 1j * left[len(hz) :])
        # The two residues of a mode are a quarter of a turn apart, and so orthogonal.
        taken = np.sum(moment.real**2 / size, axis=1)
        taken[found] = 0.0
        found.append(int(taken.argmax()))
        columns = _split(candidates[:, found].reshape(len(hz), -1))
        residues = np.linalg.lstsq(columns, goal, rcond=1e-10)[0]
        left = goal - columns @ residues
    pairs = residues.reshape(-1, 2).tolist()
    modes = [Mode(*grid[at], *both) for at, both in zip(found, pairs, strict=True)]
    return tuple(sorted(modes, key=lambda mode: -np.hypot(mode.gain, mode.quadrature) / mode.zeta))


def _residues(hz: np.ndarray, modes: list[tuple[float, float]], static_known: bool) -> np.ndarray:
    """(frequency, mode, 2) responses of modes of unit gain at rest, and their rates over ω."""
    f, zeta = np.array(modes).reshape(-1, 2).T
    ratio = hz[:, None] / f
    response = 1 / (1 - ratio**2 + 2j * zeta * ratio)
    in_phase = ratio**2 * response if static_known else response
    return np.stack([in_phase, 1j * ratio * response], axis=2)


def _split(values: np.ndarray) -> np.ndarray:
    return np.concatenate([np.real(values), np.imag(values)])
