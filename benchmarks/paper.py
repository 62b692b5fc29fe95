"""The figures of the documentation's page on the paper: python benchmarks/paper.py

The sweep of Fig. 8 at full size and the exponents that geometry alone gives, the coefficient of
proportionality and the norm (31) where the truth is known, exactly and against chance, and how
loose the bound (25) is. `tests/test_paper.py` holds the page against the result.
"""

from __future__ import annotations

import jax
import jax.numpy as jnp
import numpy as np
from common import write_results
from scipy import stats

from preisach_jax.filter.adaptive import AdaptiveFilter
from preisach_jax.operator.events import switching
from preisach_jax.operator.plane import Plane
from preisach_jax.paper import Proportionality, coefficients, noise_sweep, proportionality
from preisach_jax.paper.sweep import LEVELS, Sweep, fit_power_law
from preisach_jax.piezo import experiment
from preisach_jax.plant import RANGE_V
from preisach_jax.theory import average_over_samples, check_bound, noise_coefficient, norm_factor

SAMPLES, FIRST, SEEDS, DRAWS = 50_000, 10_000, 8, 2000
TRIED_LEVELS = (19, 13, 9)  # of the comparison with chance
BOUND_LEVELS = (3, 9, 13, 19)


def figure_8(found: Sweep, shown: Proportionality) -> dict:
    """Exponents of Fig. 8: of all seeds, seed by seed, and those of geometry alone."""
    W, norm, N = found.noise_power, shown.over_events_um, found.levels
    each = found.output_error / np.sqrt(found.cells)[:, None]
    by_seed = [fit_power_law(W, norms).value for norms in each.T]
    return {
        name: law._asdict() for name, law in found.exponents().items()
    } | {
        "squared": fit_power_law(W, norm**2)._asdict(),
        "geometry": fit_power_law(1.0 / N**2, 1.0 / (N * np.sqrt(found.cells))).value,
        "error_in_levels": shown.error_in_levels.value,
        "root_cells_in_levels": shown.root_cells_in_levels.value,
        "by_seed": {
            "mean": np.mean(by_seed),
            "deviation": np.std(by_seed, ddof=1),
            "interval": stats.t.interval(
                0.95, len(by_seed) - 1, np.mean(by_seed), stats.sem(by_seed)
            ),
        },
        "levels": N,
        "auxiliary_norm_by_seed": each,
    }  # fmt: skip


def noise_on_the_stage(found: Sweep) -> dict:
    """What white noise on the stage's own output adds to the norm (31) beside its quantisation."""
    own, norm, sigma = found.auxiliary_norm(), found.noisy_auxiliary_norm, found.noise_um
    added = norm[:, -2:] ** 2 - own[:, None] ** 2
    return {
        "noise_um": sigma,
        "auxiliary_norm": norm,
        "doubled_at_um": [
            np.exp(np.interp(np.log(2), np.log(each / alone), np.log(sigma)))
            for each, alone in zip(norm, own, strict=True)
        ],
        "exponent_of_the_square": np.diff(np.log(added))[:, 0]
        / (2 * np.log(sigma[-1] / sigma[-2])),
    }


def known_truth(levels: int, x: np.ndarray) -> dict:
    """Coefficient and norm of the weight error in white noise: exact, and of many draws of it."""
    plane = Plane(levels, 0.0, RANGE_V)
    exact = noise_coefficient(plane, x, FIRST, SAMPLES)
    at = np.array([0, *(event.sample for event in switching(plane, x))])  # others change nothing
    noise = jax.random.normal(jax.random.key(5), (DRAWS, at.size))
    filt = AdaptiveFilter(plane, initial_weight=0.0)  # the truth, so that only noise is left
    runs = jax.vmap(lambda z: filt.run(x[at], z)[2:4])(noise)
    rises, errors, area = jnp.diff(noise), runs[0][:, 1:], runs[1][:, 1:]
    squared = jnp.cumsum((2 * rises - errors) * errors / area, axis=1)  # (15)
    each = np.asarray(average_over_samples(np.asarray(squared).T, at[1:], FIRST, SAMPLES))
    late = np.asarray(errors)[:, at[1:] >= FIRST]
    norm = np.sqrt(np.mean(late**2) / plane.cells)  # (31)
    return {
        "levels": levels,
        "coefficient": exact,
        "drawn_coefficient": each.mean(),
        "standard_error": each.std(ddof=1) / np.sqrt(DRAWS),
        "norm_over_auxiliary": norm_factor(plane, x, FIRST, SAMPLES) * np.sqrt(plane.cells),
        "drawn_norm_over_auxiliary": np.sqrt(each.mean()) / norm,
    }


def main() -> None:
    """Compute everything and write it."""
    jax.config.update("jax_enable_x64", True)
    found = noise_sweep(0, LEVELS, SEEDS, SAMPLES)
    nine = coefficients(LEVELS, SEEDS, SAMPLES)
    off = np.abs(nine.same_input - nine.exact)
    x = np.asarray(experiment(jax.random.key(1), SAMPLES).input_v)
    content = {
        "samples": SAMPLES,
        "draws": DRAWS,
        "noise_on_the_stage": noise_on_the_stage(found),
        "figure_8": figure_8(found, proportionality(LEVELS, SEEDS, SAMPLES)),
        "figure_9": {
            "levels": nine.levels,
            "exact": nine.exact,
            "simulated": nine.same_input,
            "largest_difference": np.max(off / nine.exact),
            "in_standard_errors": np.max(off / nine.same_input_error),
            "orders": nine.orders,
        },
        "known_truth": [known_truth(levels, x) for levels in TRIED_LEVELS],
        "bound": [check_bound(levels)._asdict() for levels in BOUND_LEVELS],
    }
    write_results("paper.json", content)


if __name__ == "__main__":
    main()
