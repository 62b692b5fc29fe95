"""Fig. 8 and 9: residual error against noise, as the paper measures it and with the truth known."""

from __future__ import annotations

import functools
from collections.abc import Sequence
from dataclasses import dataclass
from typing import cast

import jax
import jax.numpy as jnp
import numpy as np
from scipy import special

from preisach_jax.operator.plane import Plane
from preisach_jax.paper.numbers import FigureData, report
from preisach_jax.paper.sweep import (
    LEVELS,
    NOISE_UM,
    PowerLaw,
    Sweep,
    fit_power_law,
    realisation,
    sweep,
)
from preisach_jax.plant import RANGE_V
from preisach_jax.theory import Progress, noise_coefficient, residual_ratio_bound


@functools.lru_cache(maxsize=2)
def noise_sweep(seed: int, levels: tuple[int, ...], seeds: int, samples: int) -> Sweep:
    """Run the sweep of Fig. 8 and 9, once for both."""
    return sweep(jax.random.key(seed), levels, NOISE_UM, seeds, samples)


@dataclass(frozen=True, eq=False)
class Proportionality(FigureData):
    """Fig. 8: auxiliary norm (31) against the power of the quantisation noise."""

    levels: np.ndarray
    noise_power_um2: np.ndarray  # (level,) W, eq. (29)
    over_events_um: np.ndarray  # (level,) norm (31), e² averaged over the switching samples
    events_deviation_um: np.ndarray  # its standard deviation between realisations
    band_events_um: np.ndarray  # (2, level) its 95 % band from realisations
    over_samples_um: np.ndarray  # the same over all samples, e = 0 where nothing switches
    line_power_um2: np.ndarray  # (2,) ends of the fitted lines
    line_events_um: np.ndarray  # fitted power law there
    line_samples_um: np.ndarray
    events: PowerLaw  # exponent of the norm in W, over switching samples
    samples: PowerLaw  # over all samples
    error_in_levels: PowerLaw  # of ⟨e⟩ over switching samples in N
    root_cells_in_levels: PowerLaw  # of √L in N
    share_in_levels: PowerLaw  # in N of the share of samples at which something switches
    seeds: int
    record_samples: int

    @property
    def caption(self) -> str:
        e, root, share = self.error_in_levels, self.root_cells_in_levels, self.share_in_levels
        return (
            f"Auxiliary norm (31) of the weight error against the power (29) of the quantisation "
            f"noise, {self.seeds} realisations of {self.record_samples} samples (bars: standard "
            f"deviation between them; band: 95 % by Student's t), and fitted power laws: exponent "
            f"{_with_interval(self.events)} where e² is averaged over the switching samples, "
            f"{_with_interval(self.samples)} over all samples. W falls as N^-2; ⟨e⟩ over "
            f"switching samples falls as N^{e.value:.2f} and √L grows as N^{root.value:.2f}, so "
            f"that the norm ⟨e⟩/√L falls as N^{e.value - root.value:.2f}, which is W^"
            f"{(root.value - e.value) / 2:.2f}; if ⟨e⟩ fell as 1/N, geometry alone would make it "
            f"W^{(root.value + 1) / 2:.2f}. The share of switching samples grows as "
            f"N^{share.value:.2f}, and takes {share.value / 4:.2f} off where all samples count."
        )


def proportionality(
    levels: Sequence[int] = LEVELS,
    seeds: int = 8,
    samples: int = 50_000,
    seed: int = 0,
    progress: Progress | None = None,
) -> Proportionality:
    """Auxiliary norm of the weight error against the quantisation noise, Fig. 8."""
    report(progress, "sweep over levels, noise and seeds", 0.0)
    found = noise_sweep(seed, tuple(levels), seeds, samples)
    W, norms = found.noise_power, [found.auxiliary_norm(over) for over in ("events", "samples")]
    each = found.output_error / np.sqrt(found.cells)[:, np.newaxis]
    laws = found.exponents()
    N = found.levels.astype(float)
    ends = np.array([W.min() / 1.5, W.max() * 1.5])
    return Proportionality(
        levels=found.levels,
        noise_power_um2=W,
        over_events_um=norms[0],
        events_deviation_um=each.std(axis=1, ddof=min(seeds - 1, 1)),
        band_events_um=_band_of_seeds(each),
        over_samples_um=norms[1],
        line_power_um2=ends,
        line_events_um=power_law_through(W, norms[0], laws["paper"].value, ends),
        line_samples_um=power_law_through(W, norms[1], laws["paper_all_samples"].value, ends),
        events=laws["paper"],
        samples=laws["paper_all_samples"],
        error_in_levels=fit_power_law(N, found.mean_output_error()),
        root_cells_in_levels=fit_power_law(N, np.sqrt(found.cells)),
        share_in_levels=fit_power_law(N, found.events.mean(axis=1) / (samples - found.first)),
        seeds=seeds,
        record_samples=samples,
    )


def _band_of_seeds(values: np.ndarray) -> np.ndarray:
    """(2, level) 95 % band of the root mean square of (level, seed) values, by Student's t."""
    square, seeds = values**2, values.shape[1]
    reach = special.stdtrit(max(seeds - 1, 1), 0.975) * square.std(axis=1, ddof=min(seeds - 1, 1))
    middle, reach = square.mean(axis=1), reach / np.sqrt(seeds)
    # A fall by more than there is is none that a logarithm could show.
    return np.sqrt([np.maximum(middle - reach, 0.01 * middle), middle + reach])


def power_law_through(x: np.ndarray, y: np.ndarray, exponent: float, at: np.ndarray) -> np.ndarray:
    """Values of the power law of a given exponent that goes through the middle of some points."""
    middle = np.mean(np.log(y) - exponent * np.log(x))
    return np.exp(middle + exponent * np.log(at))


def _with_interval(law: PowerLaw) -> str:
    return f"{law.value:.2f} (95 % interval {law.low:.2f} to {law.high:.2f})"


@dataclass(frozen=True, eq=False)
class NoiseCoefficients(FigureData):
    """Fig. 9: what noise does to the weights where the truth is known."""

    levels: np.ndarray
    noise_power_um2: np.ndarray  # (noise,) W of white noise
    noise_part_um2: np.ndarray  # (level, noise) what noise adds to ⟨‖E‖²⟩
    total_um2: np.ndarray  # (level, noise) ⟨‖E‖²⟩
    floor_um2: np.ndarray  # (level,) ⟨‖E‖²⟩ without noise, which is left of the initial error
    line_power_um2: np.ndarray  # (2,) ends of the fitted lines
    lines_um2: np.ndarray  # (level, 2) fitted power laws with a common exponent there
    exponent: PowerLaw
    coefficient: np.ndarray  # (level,) mean of the noise part over W
    coefficient_error: np.ndarray  # its standard error over noise and seeds
    same_input: np.ndarray  # the same for the first input alone
    same_input_error: np.ndarray  # its standard error over noise
    exact: np.ndarray  # for the first input, by the propagation of Cov(E)
    bound: np.ndarray  # (level,) bound (25) for T = L
    seeds: int
    samples: int

    @property
    def orders(self) -> np.ndarray:
        """(level,) by how many orders of magnitude the bound exceeds the exact coefficient."""
        return np.log10(self.bound / self.exact)

    @property
    def caption(self) -> str:
        off = np.abs(self.same_input - self.exact)
        law = self.exponent
        return (
            "(a) What white noise of the power W adds to ⟨‖E‖²⟩ (filled), where the truth is "
            f"known: common exponent {law.value:.3f} (95 % interval {law.low:.3f} to "
            f"{law.high:.3f}). Faint: all of ⟨‖E‖²⟩, which cannot fall below what is left of the "
            "initial error (dotted). (b) Their ratio: simulated (bars: standard error over noise "
            f"and {self.seeds} inputs), exact for the first input, and the bound (25) for T = L, "
            "the fewest steps in which all L triangles can occur; it is "
            f"{self.orders.min():.0f} to {self.orders.max():.0f} orders of magnitude above. (c) "
            "The same without the bound. With the first input alone, the simulation differs from "
            f"the exact coefficient by {100 * np.max(off / self.exact):.1f} % or "
            f"{np.max(off / self.same_input_error):.1f} standard errors at most."
        )


def coefficients(
    levels: Sequence[int] = LEVELS,
    seeds: int = 8,
    samples: int = 50_000,
    seed: int = 0,
    progress: Progress | None = None,
) -> NoiseCoefficients:
    """What noise adds to the weight error, simulated, exact and bounded, Fig. 9."""
    report(progress, "sweep over levels, noise and seeds", 0.0)
    found = noise_sweep(seed, tuple(levels), seeds, samples)
    W = found.noise_um**2
    exponent = found.exponents()["truth"]
    part = found.noise_part.mean(axis=2)
    ends = np.array([W.min() / 2.0, W.max() * 2.0])
    first = found.noise_part[:, :, 0] / W
    return NoiseCoefficients(
        levels=found.levels,
        noise_power_um2=W,
        noise_part_um2=part,
        total_um2=found.weight_error_squared.mean(axis=2),
        floor_um2=found.bias_squared.mean(axis=1),
        line_power_um2=ends,
        lines_um2=np.array([power_law_through(W, row, exponent.value, ends) for row in part]),
        exponent=exponent,
        coefficient=found.coefficient,
        coefficient_error=found.coefficient_error,
        same_input=first.mean(axis=1),
        same_input_error=first.std(axis=1, ddof=1) / np.sqrt(len(W)),
        exact=exact_coefficients(found, progress),
        bound=residual_ratio_bound(found.cells, found.levels),
        seeds=seeds,
        samples=samples,
    )


def exact_coefficients(found: Sweep, progress: Progress | None = None) -> np.ndarray:
    """(level,) ⟨tr Cov(E)⟩/W over the residual interval, for the first input of a sweep, exact."""
    key = cast(jax.Array, jax.random.wrap_key_data(jnp.asarray(found.key)))
    exact: list[float] = []
    with jax.enable_x64(True):
        drawn = realisation(key, int(found.seeds[0]), found.samples, len(found.noise_um))
        x = np.asarray(drawn.record.input_v)
        # The work of a plane grows as N³ at each event, and the events as N.
        work = found.levels.astype(float) ** 4 / np.sum(found.levels.astype(float) ** 4)
        for n, N in enumerate(found.levels):
            plane = Plane(int(N), 0.0, RANGE_V)
            done = float(work[:n].sum())

            def show(text: str, part: float, done: float = done, share: float = work[n]) -> None:
                report(progress, text, done + part * share)

            exact.append(noise_coefficient(plane, x, found.first, found.samples, progress=show))
    return np.array(exact)
