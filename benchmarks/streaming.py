"""Measure what one sample costs from Python: the online filter, and the jitted step beside it.

    python benchmarks/streaming.py

writes `benchmarks/results/streaming.json` with device, versions and date.  A Bernoulli ramp at
2 kHz is fed sample by sample, in double precision, by one thread that is pinned to one core.  The
times are those of single calls, garbage collection and all; the first call, which may compile, is
told apart.
"""

from __future__ import annotations

from collections.abc import Callable

import jax
import numpy as np
from common import latency, one_core, write_results

from preisach_jax.filter.adaptive import AdaptiveFilter
from preisach_jax.filter.online import OnlineFilter
from preisach_jax.operator.inputs import HYSTERONS
from preisach_jax.operator.plane import Plane
from preisach_jax.plant import RANGE_V
from preisach_jax.signals import bernoulli_ramp

LEVELS, RATE_HZ = (9, 19, 37, 75), 2000.0
SAMPLES, JITTED_SAMPLES = 50_000, 10_000


def jitted(filt: AdaptiveFilter) -> Callable[[float, float], float]:
    """A sample a call by the compiled `AdaptiveFilter.step`."""
    start, step = jax.jit(AdaptiveFilter.init), jax.jit(AdaptiveFilter.step)
    state = None

    def take_in(x: float, z: float) -> float:
        nonlocal state
        state, info = step(filt, start(filt, x, z) if state is None else state, x, z)
        return float(info.output)

    return take_in


def measure() -> list[dict]:
    """A row for every kind of hysteron, plane and way to take in a sample."""
    x = bernoulli_ramp(jax.random.key(0), SAMPLES, RATE_HZ, high=RANGE_V)
    z = 1.5 * np.asarray(x) + np.random.default_rng(0).normal(0.0, 0.01, SAMPLES)
    x, z = np.asarray(x).tolist(), z.tolist()
    rows = []
    for hysteron in HYSTERONS:
        for levels in LEVELS:
            filt = AdaptiveFilter(Plane(levels=levels, low=0.0, high=RANGE_V), hysteron)
            for way, take_in, samples in (
                ("online", OnlineFilter(filt), SAMPLES),
                ("jitted step", jitted(filt), JITTED_SAMPLES),
            ):
                measured = latency(take_in, x[:samples], z[:samples])
                rows.append({"way": way, "hysteron": hysteron, "levels": levels, **measured})
                print(
                    f"{way}, {hysteron}, N = {levels}: median {measured['p50_us']:.1f}, "
                    f"p99 {measured['p99_us']:.1f} us",
                    flush=True,
                )
    return rows


def main() -> None:
    """Measure and write the results."""
    with one_core(), jax.enable_x64(True):
        write_results("streaming.json", {"rate_hz": RATE_HZ, "rows": measure()})


if __name__ == "__main__":
    main()
