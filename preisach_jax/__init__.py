"""Preisach hysteresis: identify it, diagnose what a model of it lacks, and filter it online."""

from importlib.metadata import version

from preisach_jax.diagnosis import Diagnosis, diagnose
from preisach_jax.diagnosis.design import Design, design
from preisach_jax.effects import library as effects
from preisach_jax.effects.base import (
    AddedEffect,
    Effect,
    HysteresisEffect,
    InputEffect,
    OutputEffect,
    Parameter,
    SensorEffect,
    Signals,
    Survey,
    WeightEffect,
)
from preisach_jax.errors import InputError
from preisach_jax.filter import AdaptiveFilter, simulate
from preisach_jax.fit import Fit, fit
from preisach_jax.fleet import FleetResult, fleet_to_folder, run_fleet
from preisach_jax.model import Model, ParameterEstimate, Prediction
from preisach_jax.online import OnlineFilter
from preisach_jax.plane import Plane
from preisach_jax.plant import simulate_stage
from preisach_jax.record import Record
from preisach_jax.recursion import RecursiveLeastSquares, compare_recursions
from preisach_jax.sweep import Sweep, sweep

__version__ = version("preisach_jax")

__all__ = [
    "AdaptiveFilter",
    "AddedEffect",
    "Design",
    "Diagnosis",
    "Effect",
    "Fit",
    "FleetResult",
    "HysteresisEffect",
    "InputEffect",
    "InputError",
    "Model",
    "OnlineFilter",
    "OutputEffect",
    "Parameter",
    "ParameterEstimate",
    "Plane",
    "Prediction",
    "Record",
    "RecursiveLeastSquares",
    "SensorEffect",
    "Signals",
    "Survey",
    "Sweep",
    "WeightEffect",
    "compare_recursions",
    "design",
    "diagnose",
    "effects",
    "fit",
    "fleet_to_folder",
    "run_fleet",
    "simulate",
    "simulate_stage",
    "sweep",
]
