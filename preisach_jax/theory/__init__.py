"""Convergence of the adaptive filter in noise, eq. (13)-(25) and (27)-(31), and beyond."""

from preisach_jax.theory.bounds import (
    BoundCheck,
    check_bound,
    contraction_bound,
    error_after_period,
    error_recursion,
    every_triangle,
    expected_error,
    noise_gain_bound,
    residual_error_bound,
    residual_ratio_bound,
    switching_sum_bound,
)
from preisach_jax.theory.noise import measured_output, next_squared_error, noise_power
from preisach_jax.theory.propagation import (
    ErrorMoments,
    average_over_samples,
    noise_coefficient,
    propagate_error,
)
from preisach_jax.theory.residual import (
    auxiliary_norm,
    largest_slope,
    mean_output_error,
    quantisation_noise_power,
    quantisation_step,
)

__all__ = [
    "BoundCheck",
    "ErrorMoments",
    "auxiliary_norm",
    "average_over_samples",
    "check_bound",
    "contraction_bound",
    "error_after_period",
    "error_recursion",
    "every_triangle",
    "expected_error",
    "largest_slope",
    "mean_output_error",
    "measured_output",
    "next_squared_error",
    "noise_coefficient",
    "noise_gain_bound",
    "noise_power",
    "propagate_error",
    "quantisation_noise_power",
    "quantisation_step",
    "residual_error_bound",
    "residual_ratio_bound",
    "switching_sum_bound",
]
