"""How long does the adaptive filter take to forget a sensor that fails for a while?

    python benchmarks/broken_sensor.py

Makes the table of docs/measurements.py: a stage of 9 levels with noise of 1 % of its range, some
nine samples a level; after 120,000 samples the sensor fails for 5,000. Told are the samples from
its return until the prediction errs as little as if the output had just been missing.
"""

from __future__ import annotations

import math

import jax
import numpy as np
from common import write_results

from preisach_jax import AdaptiveFilter, OnlineFilter, Plane, simulate

PERIOD, BEGIN, FAULTY, WINDOW = 100_000, 120_000, 5_000, 1_000
NOISE, PER_LEVEL = 0.01, 0.11
PLANE = Plane(levels=9, low=0.0, high=10.0)
FILTERS = {
    "paper's rule": {},
    "step_size=0.2": {"step_size": 0.2},
    "error_limit of 5 sqrt(2) sigma": {"error_limit": 5 * math.sqrt(2) * NOISE},
}
FAULTS = {
    "output lost": lambda z, rng: np.full_like(z, np.nan),
    "every second output lost": lambda z, rng: np.where(rng.random(z.size) < 0.5, np.nan, z),
    "spikes of 1e6 sigma": lambda z, rng: (
        z + 1e6 * NOISE * rng.choice([-1, 0, 1], z.size, p=[0.005, 0.99, 0.005])
    ),
    "stuck": lambda z, rng: np.full_like(z, z[0]),
    "polarity reversed": lambda z, rng: -z,
    "clipped at half": lambda z, rng: np.minimum(z, 0.5),
}


def wandering() -> np.ndarray:
    """Ramps between random turning points, from saturated low and back to it."""
    speed, span = PER_LEVEL * PLANE.delta_x, PLANE.high - PLANE.low
    turns = PLANE.low + span * np.random.default_rng(0).random(PERIOD)
    turns[:2] = PLANE.low, PLANE.high
    reached = np.append(0.0, np.cumsum(np.abs(np.diff(turns)))) / speed
    back = math.ceil(span / speed) + 2
    x = np.interp(np.arange(PERIOD - back), reached, turns)
    return np.append(x, np.maximum(x[-1] - speed * np.arange(1, back + 1), PLANE.low))


def samples_to_recover(hysteron: str, options: dict) -> list[int]:
    """Samples after each fault until the windowed error is that of a lost output; -1 for never."""
    weights = np.random.default_rng(1).uniform(0.2, 1.0, PLANE.cells)
    x = wandering()
    z = np.tile(np.asarray(simulate(PLANE, weights / weights.sum(), x, hysteron)), 3)
    x, end = np.tile(x, 3), BEGIN + FAULTY
    sound = z + np.random.default_rng(4).normal(0.0, NOISE, z.size)
    start = OnlineFilter(AdaptiveFilter(PLANE, hysteron, **options))
    start.block(x[:BEGIN], sound[:BEGIN])

    def errors(output: np.ndarray) -> np.ndarray:
        """What windows of the prediction err by after a faulty output, beside a constant."""
        online = OnlineFilter(start.filter, start.state)
        online.block(x[BEGIN:end], output)
        return (online.block(x[end:], sound[end:]) - z[end:]).reshape(-1, WINDOW).std(axis=1)

    undisturbed, samples = errors(np.full(FAULTY, np.nan)), []
    for broken in FAULTS.values():
        found = errors(broken(sound[BEGIN:end], np.random.default_rng(5)))
        late = np.flatnonzero(found > 1.25 * undisturbed + 0.1 * NOISE)
        windows = int(late[-1]) + 1 if len(late) else 0
        samples.append(windows * WINDOW if windows < len(found) else -1)
    return samples


def main() -> None:
    """Measure each kind of filter with relays and with ramps."""
    with jax.enable_x64(True):
        rows = [
            {"fault": fault, "filter": name, "hysteron": hysteron, "samples": samples}
            for name, options in FILTERS.items()
            for hysteron in ("relay", "ramp")
            for fault, samples in zip(FAULTS, samples_to_recover(hysteron, options), strict=True)
        ]
    write_results("broken_sensor.json", {"rows": rows})


if __name__ == "__main__":
    main()
