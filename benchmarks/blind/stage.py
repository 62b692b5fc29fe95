"""The hysteresis of the hidden stages: a fine mixture of generalised plays.

A generalised play rests between a rising and a falling curve, which bend and differ, and is pushed
by them (A. Visintin, Differential Models of Hysteresis, Springer 1994, ch. III).  The input is a
part of the drive's range, 0 to 1; it may leave it.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

PLAYS = 400
CHUNK = 1000  # samples whose curves are computed at once
SETTLED = 1e-6  # change of the driven input at which the implicit feedback has settled
CLOSE = 1e-7  # error of the driven input at which the field behind currents is found


def _sigmoid(y: np.ndarray) -> np.ndarray:
    return y / np.sqrt(1 + y**2)


@dataclass(frozen=True, eq=False)
class Plays:
    """Generalised plays, each with a rising curve F(x - r) and a falling one F(x + r) + B (1 + S).

    Attributes:
        radius, bend, centre, width, gap, gap_centre: (play,) shapes of the curves.
    """

    radius: np.ndarray
    bend: np.ndarray
    centre: np.ndarray
    width: np.ndarray
    gap: np.ndarray
    gap_centre: np.ndarray

    def curves(self, x: np.ndarray, shift: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """(time, play) rising and falling curves; `shift` (time,) moves the thresholds apart."""
        x, radius = x[:, None], self.radius + shift[:, None]
        low = x - radius
        high = x + radius
        low = low + self.bend * _sigmoid((low - self.centre) / self.width)
        high = high + self.bend * _sigmoid((high - self.centre) / self.width)
        return low, high + self.gap * (1 + _sigmoid((x - self.gap_centre) / self.width))


@dataclass(frozen=True, eq=False)
class Relays:
    """Relays that jump between 0 and 1 at `up` and back at `down`, (play,) each."""

    up: np.ndarray
    down: np.ndarray

    def curves(self, x: np.ndarray, shift: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """(time, play) rising and falling curves, which are steps."""
        x, shift = x[:, None], shift[:, None]
        return (x >= self.up + shift).astype(float), (x > self.down - shift).astype(float)


@dataclass(frozen=True, eq=False)
class Stage:
    """A rate-independent stage.

    Attributes:
        plays: its plays or relays.
        weight: (play,) stroke of each, in um.
        reversible_um: stroke of the part without memory, in um.
        bow: how much that part bends.
        offset_um: output at the lower end of the full loop.
        stroke_um: output from end to end of the full loop.
        width: its greatest width, as a part of the stroke.
    """

    plays: Plays | Relays
    weight: np.ndarray
    reversible_um: float
    bow: float
    offset_um: float = 0.0
    stroke_um: float = 1.0
    width: float = 0.0

    def reversible(self, x: np.ndarray) -> np.ndarray:
        """(time,) the part without memory, in um."""
        return self.reversible_um * (x + self.bow * x * x) / (1 + self.bow) - self.offset_um

    def response(
        self, x: np.ndarray, shift: np.ndarray | None = None, fade: np.ndarray | None = None
    ) -> np.ndarray:
        """(time,) output in um along a path that begins at the lower end of the full loop."""
        shift = np.zeros_like(x) if shift is None else shift
        state = self.plays.curves(x[:1], shift[:1])[1][0]
        out = np.empty_like(x)
        for begin in range(0, len(x), CHUNK):
            rows = slice(begin, begin + CHUNK)
            low, high = self.plays.curves(x[rows], shift[rows])
            kept = np.empty_like(low)
            for n in range(len(low)):
                state = np.maximum(low[n], np.minimum(high[n], state))
                if fade is not None:
                    state = state + fade[begin + n] * (0.5 * (low[n] + high[n]) - state)
                kept[n] = state
            out[rows] = kept @ self.weight
        return out + self.reversible(x)

    def response_with_feedback(self, x: np.ndarray, gain: float) -> np.ndarray:
        """(time,) output h in um of a stage that is driven by x + gain h, gain in 1/um."""
        if gain == 0:
            return self.response(x)
        nothing, h = np.zeros(1), 0.0
        state = self.plays.curves(x[:1], nothing)[1][0]
        out = np.empty_like(x)
        for n in range(len(x)):
            change = np.inf
            while abs(gain * change) > SETTLED:
                driven = x[n : n + 1] + gain * h
                low, high = self.plays.curves(driven, nothing)
                moved = np.maximum(low[0], np.minimum(high[0], state))
                after = float(moved @ self.weight + self.reversible(driven)[0])
                change, h = after - h, after
            state, out[n] = moved, h
        return out

    def response_behind_currents(self, x: np.ndarray, gain: float) -> np.ndarray:
        """(time,) output h in um behind x - gain (h - h one sample before), gain in 1/um."""
        if gain == 0:
            return self.response(x)
        nothing = np.zeros(1)
        state = self.plays.curves(x[:1], nothing)[1][0]

        def moved(driven: float) -> tuple[np.ndarray, float]:
            at = np.array([driven])
            low, high = self.plays.curves(at, nothing)
            after = np.maximum(low[0], np.minimum(high[0], state))
            return after, float(after @ self.weight + self.reversible(at)[0])

        state, h = moved(float(x[0]))
        inside, out = float(x[0]), np.empty_like(x)
        for n, goal in enumerate(x.tolist()):
            # A secant between bounds: what drives the material lies between the last and the goal.
            (near, far), before = (inside, goal), h
            off = near - goal
            for _ in range(60):
                state_at, h_at = moved(far)
                wrong = far - goal + gain * (h_at - before)
                if abs(wrong) < CLOSE or wrong == off:
                    break
                near, off, far = far, wrong, far - wrong * (far - near) / (wrong - off)
            inside, state, h = far, state_at, h_at
            out[n] = h
        return out


def make_stage(seed: int, density: str = "smooth") -> Stage:
    """A stage with 10-120 um stroke and a full loop 5-20 % wide."""
    rng = np.random.default_rng([seed, 2])
    plays, weight = _relays(rng) if density == "relays" else _plays(rng, density == "ridges")
    bow = rng.uniform(-0.2, 0.3)
    stroke, width = rng.uniform(10.0, 120.0), rng.uniform(0.05, 0.20)
    _, bare_stroke, bare_width = _full_loop(Stage(plays, weight, 0.0, bow))
    share = min(0.9, width / bare_width)
    stage = Stage(plays, weight * share * stroke / bare_stroke, (1 - share) * stroke, bow)
    offset, stroke, width = _full_loop(stage)
    return Stage(plays, stage.weight, stage.reversible_um, bow, offset, stroke, width)


def _plays(rng: np.random.Generator, ridges: bool) -> tuple[Plays, np.ndarray]:
    places = np.sort(rng.uniform(0.0, 1.0, PLAYS)) ** 1.3
    if ridges:
        groups = np.sort(rng.uniform(0.05, 0.6, int(rng.integers(3, 7))))
        places = np.sort(groups[rng.integers(len(groups), size=PLAYS)] + 0.004 * places)
    radius = 0.4 * places
    weight = np.gradient(places) * np.exp(-radius / rng.uniform(0.08, 0.2))
    weight = np.abs(weight) * rng.uniform(0.5, 1.5, PLAYS)
    width = rng.uniform(0.02, 0.05, PLAYS) if ridges else rng.uniform(0.2, 0.6, PLAYS)
    centre = rng.uniform(0.0, 1.0, 3)[rng.integers(3, size=PLAYS)] if ridges else None
    plays = Plays(
        radius=radius,
        bend=width * rng.uniform(0.5, 3.0, PLAYS) if ridges else width * _skewed(rng),
        centre=rng.uniform(0.0, 1.0, PLAYS) if centre is None else centre,
        width=width,
        gap=radius * rng.uniform(0.0, 0.6, PLAYS),
        gap_centre=rng.uniform(0.0, 1.0, PLAYS),
    )
    return plays, weight / weight.sum()


def _skewed(rng: np.random.Generator) -> np.ndarray:
    """(play,) bends, more or fewer of them upward."""
    return rng.uniform(-0.4, rng.uniform(0.4, 1.2), PLAYS)


def _relays(rng: np.random.Generator) -> tuple[Relays, np.ndarray]:
    count = int(rng.integers(40, 151))
    middle, half = rng.uniform(0.1, 0.9, count), rng.exponential(0.07, count)
    weight = rng.uniform(0.3, 1.7, count)
    up, down = np.minimum(middle + half, 0.99), np.maximum(middle - half, 0.01)
    return Relays(up, down), weight / weight.sum()


def _full_loop(stage: Stage) -> tuple[float, float, float]:
    """Output at the lower end, stroke (both um) and relative width of the closed full loop."""
    up = np.linspace(0.0, 1.0, 401)
    path = np.concatenate([up, up[::-1], up, up[::-1]])
    rise, fall = stage.response(path)[802:].reshape(2, 401)
    stroke = rise[-1] - rise[0]
    return float(rise[0]), float(stroke), float(np.max(fall[::-1] - rise) / stroke)
