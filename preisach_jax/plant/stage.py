"""The stage's hysteresis: a bundle of generalised plays, rate-independent unless told otherwise."""

from __future__ import annotations

import itertools
from dataclasses import dataclass

import numpy as np

from preisach_jax.errors import InputError

RANGE_V = 75.0  # drive from 0 to here
PLAYS = 64
CHUNK = 20_000  # samples of a ramp that are in memory at once, for all plays
SETTLED_V = 1e-7  # by which the fed-back drive may still change when it counts as found


@dataclass(frozen=True)
class Stage:
    """Rate-independent hysteresis of the stage: generalised plays, asymmetric and with a dead zone.

    A play with slack keeps v between u - slack_up and u + slack_down; the stage moves by
    h = Σ_k weight_k g(v_k) with the generating function g(v) = s ln(1 + e^((v - d)/s)), flat below
    the dead zone d (generalised play: Visintin, Differential Models of Hysteresis, 1994; for smart
    actuators: Al Janaideh, Rakheja and Su, Smart Mater. Struct. 18, 045001, 2009). A slack of zero
    is the reversible part.

    Arguments:
        slack_up: (plays,) V, by which a rising drive is ahead.
        slack_down: (plays,) V, by which a falling drive is behind.
        weights: (plays,) µm per V of generating function.
    """

    slack_up: np.ndarray
    slack_down: np.ndarray
    weights: np.ndarray
    dead_zone: float
    softness: float

    def generate(self, v: np.ndarray) -> np.ndarray:
        """Generating function g, V."""
        return self.softness * np.logaddexp(0.0, (v - self.dead_zone) / self.softness)

    def hysteresis(self, u: np.ndarray, widening: np.ndarray | float = 0.0) -> np.ndarray:
        """Output along a drive, after one loop over the whole range that is not recorded.

        Each play keeps v between u - slack_up - widening and u + slack_down + widening.

        Arguments:
            u: (time,) drive, V.
            widening: (time,) or one value, at least 0, V, by which all slacks are greater, also
                those of zero; a slack that shrinks takes its play along.

        Returns:
            (time,) position, µm, zero at rest at 0 V.
        """
        u = np.asarray(u, float)
        v = np.minimum(RANGE_V - self.slack_up, self.slack_down)  # of that loop: up, then to 0
        rest = self.weights @ self.generate(v)
        lower, upper = u - widening, u + widening
        moves = np.diff(np.stack([lower, upper]), axis=1, prepend=0.0)
        moved = np.any(moves != 0.0, axis=0)
        # While each limit moves one way only, a play has no memory but of where it was before.
        turned = [np.flatnonzero(np.diff(_heading(of_limit))) + 1 for of_limit in moves]
        cuts = np.unique(np.concatenate([*turned, np.arange(0, u.size, CHUNK), [u.size]]))
        h = np.empty(u.size)
        for begin, end in itertools.pairwise(cuts.tolist()):
            fresh = moved[begin:end].copy()
            fresh[0] = True
            rows = np.flatnonzero(fresh) + begin  # a hold is computed once
            plays = self._follow(v[:, None], lower[rows], upper[rows])
            v = plays[:, -1]
            h[begin:end] = (self.weights @ self.generate(plays))[np.cumsum(fresh) - 1]
        return h - rest

    def _follow(self, v: np.ndarray, lower: np.ndarray, upper: np.ndarray) -> np.ndarray:
        return np.clip(v, lower - self.slack_up[:, None], upper + self.slack_down[:, None])

    def moving_hysteresis(
        self, u: np.ndarray, a: float, widening: np.ndarray | float = 0.0
    ) -> np.ndarray:
        """Output along a drive to which it is fed back itself, as a mean field.

        h = Γ[u + a h] (moving model: Della Torre, IEEE Trans. Audio Electroacoust. 14, 86, 1966),
        by repeated substitution into the whole course. Γ is Lipschitz in the largest deviation with
        a constant of at most Σ_k weight_k, so that this contracts where |a| Σ_k weight_k < 1.

        Arguments:
            u: (time,) drive, V.

        Returns:
            (time,) position, µm, zero at rest at 0 V.
        """
        if abs(a) * self.weights.sum() >= 1.0:
            most = 1 / self.weights.sum()
            raise InputError(
                f"a is {a!r} V/µm: give a magnitude below {most:.3g}, where it is stable"
            )
        inside, h = u, self.hysteresis(u, widening)
        while np.max(np.abs(u + a * h - inside)) > SETTLED_V:
            inside = u + a * h
            h = self.hysteresis(inside, widening)
        return h

    def stroke(self, a: float = 0.0) -> float:
        """Rise over the whole range of the drive, µm, with the feedback of `moving_hysteresis`."""
        return float(self.moving_hysteresis(np.array([RANGE_V]), a)[0])


def _heading(moves: np.ndarray) -> np.ndarray:
    """Direction of each move; a hold belongs to the ramp before it."""
    sign = np.sign(moves)
    return sign[np.maximum.accumulate(np.where(sign != 0, np.arange(sign.size), 0))]


def make_stage(seed: int = 0) -> Stage:
    """Draw a stage with 40 to 90 µm stroke and a loop 10 to 18 % of it wide."""
    rng = np.random.default_rng([seed, 1])
    quantile = (np.arange(PLAYS - 1) + rng.uniform(0.2, 0.8, PLAYS - 1)) / (PLAYS - 1)
    # Radii reach as far as the drive and get rarer with size, as measured on piezo ceramics.
    radius = np.concatenate([[0.0], rng.uniform(22.0, 34.0) * quantile ** rng.uniform(1.1, 1.5)])
    skew = rng.uniform(-0.25, 0.25)
    dead_zone, softness = rng.uniform(-12.0, 4.0), rng.uniform(9.0, 18.0)
    stroke, width = rng.uniform(40.0, 90.0), rng.uniform(0.10, 0.18)
    ups, downs = radius * (1.0 + skew), radius * (1.0 - skew)

    def part(chosen: slice, size: float) -> tuple[np.ndarray, float]:
        """Weights of some of the plays so that they move by `size` together, and their width."""
        weights = np.zeros(PLAYS)
        weights[chosen] = 1.0
        bare = Stage(ups, downs, weights, dead_zone, softness)
        axis = np.linspace(0.0, RANGE_V, 151)
        up, down = np.split(bare.hysteresis(np.concatenate([axis, axis[::-1]])), 2)
        return weights * size / up[-1], float(np.max(down[::-1] - up) / up[-1])

    openness = part(slice(1, None), 1.0)[1]
    share = min(0.9, width / openness)
    reversible = part(slice(0, 1), (1.0 - share) * stroke)[0]
    return Stage(
        ups, downs, part(slice(1, None), share * stroke)[0] + reversible, dead_zone, softness
    )
