"""What effects with several modes of a mechanics share: their parameters, step and starts."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Sequence
from dataclasses import replace
from typing import Any, Self

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from preisach_jax.effects.base import Effect, Survey, Values
from preisach_jax.effects.modes import Mode, modes_in
from preisach_jax.effects.parameter import parameter

MOST_MODES = 4
"""Modes of one effect at most."""

LIGHTEST = 0.001
"""Least damping ratio."""

WEAKEST_RING = 0.5
"""Damping ratio of a further mode at most: what rings less is a lag."""


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

    def searched_from(self, survey: Survey, drive: np.ndarray, settled: bool) -> Self:
        """This effect with starts from the frequency response of what a model leaves to a drive."""
        if len(survey.residual) < 2 or np.ptp(drive) == 0:
            return self
        low, high = _inside(self)
        found = modes_in(
            survey.time, drive, survey.residual, low, high, self.modes, settled=settled
        )
        if not found or not found[0].gain:
            return self
        one = found[0].gain
        each = [(mode.f_hz, mode.zeta, mode.gain / one, mode.quadrature / one) for mode in found]
        return replace(self, starts=tuple(x for mode in each for x in mode))

    def with_mode_from(
        self, survey: Survey, drive: np.ndarray, values: Values, settled: bool
    ) -> tuple[Self, dict[str, float]] | None:
        """This effect with a mode more, and natural frequency and damping ratio to start from.

        Arguments:
            drive: (sample,) what drives the modes.
        """
        if self.modes == MOST_MODES or np.ptp(drive) == 0:
            return None
        low, high = _inside(self)
        found = modes_in(survey.time, drive, survey.residual, low, high, 1, settled=settled)
        if not found:
            return None
        number = self.modes + 1
        mode = {f"f_{number}_hz": found[0].f_hz, f"zeta_{number}": found[0].zeta}
        return replace(self, modes=number), {**values, **mode}

    def without_each_mode(self, values: Values) -> Sequence[tuple[Self, dict[str, float]]]:
        """This effect with each of its modes left out in turn, and what the others have."""
        found: list[tuple[Self, dict[str, float]]] = []
        for gone in range(self.modes):
            kept = [number for number in range(1, self.modes + 1) if number != gone + 1]
            start: dict[str, float] = {}
            for place, number in enumerate(kept, start=1):
                start[_named("f", place, "_hz")] = values[_named("f", number, "_hz")]
                start[_named("zeta", place)] = values[_named("zeta", number)]
            found.append((replace(self, modes=self.modes - 1), start))
        return found


def _named(kind: str, number: int, unit: str = "") -> str:
    """The name of a mode's parameter."""
    return f"{kind}_{number}{unit}" if number > 1 else f"{kind}{unit}"


def _inside(effect: Modal) -> tuple[float, float]:
    """Bounds of the natural frequencies with room for a search."""
    return 1.02 * effect.lowest_hz, effect.highest_hz / 1.02


def mode_step(
    f_hz: Array, zeta: Array, state: tuple[Array, Array, Array], value: Array, dt: Array
) -> tuple[Array, Array]:
    """One mode of unit gain at rest over a step in which its input goes straight.

    Arguments:
        state: (z - h, dz/dt / omega, h): small numbers, and zero at rest.
        dt: the step in s; zero at the first sample.

    Returns:
        z - h and dz/dt / omega at the end of the step.
    """
    away, speed, last = state
    omega = 2 * jnp.pi * f_hz
    # dt is zero at the first sample: the safe step keeps 0/0 out of values and gradients.
    angle = omega * jnp.where(dt > 0, dt, 1.0)
    root = jnp.sqrt(1 - zeta**2)
    decay = jnp.exp(-zeta * angle)
    cosine, sine = decay * jnp.cos(root * angle), decay * jnp.sin(root * angle) / root
    gone = 1 - cosine - zeta * sine
    slope = (value - last) / angle
    moved = (1 - gone) * away + sine * speed - slope * (sine + 2 * zeta * gone)
    faster = (cosine - zeta * sine) * speed - sine * away + slope * gone
    return jnp.where(dt > 0, moved, away), jnp.where(dt > 0, faster, speed)


def mode_of(
    f_hz: Array, zeta: Array, signal: Float[Array, " time"], time: Float[Array, " time"]
) -> tuple[Float[Array, " time"], Float[Array, " time"]]:
    """Output of one mode of unit gain at rest, and its rate over ω, `(time,)` each."""
    zero = jnp.zeros_like(signal[0])

    def advance(state: tuple[Array, Array, Array], sample: tuple[Array, Array]) -> Any:
        away, speed = mode_step(f_hz, zeta, state, *sample)
        return (away, speed, sample[0]), (sample[0] + away, speed)

    dt = jnp.diff(time, prepend=time[:1])
    return jax.lax.scan(advance, (zero, zero, signal[0]), (signal, dt))[1]
