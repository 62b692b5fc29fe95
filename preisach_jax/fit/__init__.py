"""Fit a model of chosen effects to a record."""

from preisach_jax.fit.chosen import fit
from preisach_jax.fit.finish import FINAL_ROWS, finished, on_all_rows, with_regressors
from preisach_jax.fit.mechanical import fit_inside
from preisach_jax.fit.result import Added, Fit
from preisach_jax.fit.running import Progress, double_precision, in_silence
from preisach_jax.fit.start import (
    COARSE_LEVELS,
    DEFAULT_LEVELS,
    SEARCH_ROWS,
    aux_units,
    base_point,
    begun,
    checked_levels,
    freed_of_blemishes,
    in_reduced_basis,
    mended_by,
    plane_of,
)
from preisach_jax.fit.steps import (
    REFINEMENT,
    at_levels,
    best_start,
    feeds_back,
    held_out_rms,
    moved_to,
    on_a_coarser_plane,
    roughly_with,
    settled,
    with_effect,
    with_signs,
    without_effect,
)
from preisach_jax.fit.training import Schedule, Training, trained

__all__ = [
    "COARSE_LEVELS",
    "DEFAULT_LEVELS",
    "FINAL_ROWS",
    "REFINEMENT",
    "SEARCH_ROWS",
    "Added",
    "Fit",
    "Progress",
    "Schedule",
    "Training",
    "at_levels",
    "aux_units",
    "base_point",
    "begun",
    "best_start",
    "checked_levels",
    "double_precision",
    "feeds_back",
    "finished",
    "fit",
    "fit_inside",
    "freed_of_blemishes",
    "held_out_rms",
    "in_reduced_basis",
    "in_silence",
    "mended_by",
    "moved_to",
    "on_a_coarser_plane",
    "on_all_rows",
    "plane_of",
    "roughly_with",
    "settled",
    "trained",
    "with_effect",
    "with_regressors",
    "with_signs",
    "without_effect",
]
