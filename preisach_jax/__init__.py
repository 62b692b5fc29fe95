"""Preisach hysteresis: identify it, diagnose what a model of it lacks, and filter it online.

Names are loaded when they are first used: the command line answers `--help` and completes words
without the seconds that JAX takes.
"""

from __future__ import annotations

import sys
from collections.abc import Callable
from importlib import import_module
from importlib.util import find_spec
from types import ModuleType
from typing import TYPE_CHECKING, Any

from preisach_jax.hooks import HOOKS

if TYPE_CHECKING:
    from preisach_jax.compensation import (
        Compensation,
        Loop,
        OnlineInverse,
        compensate,
        simulate_loop,
    )
    from preisach_jax.diagnosis import Diagnosis, SparseForm, diagnose, find_form
    from preisach_jax.diagnosis.design import Design, design
    from preisach_jax.diagnosis.exploration import Exploration, explore
    from preisach_jax.effects import library as effects
    from preisach_jax.effects.base import (
        AddedEffect,
        Effect,
        HysteresisEffect,
        InputEffect,
        OutputEffect,
        SensorEffect,
        Signals,
        Survey,
        WeightEffect,
    )
    from preisach_jax.effects.parameter import Parameter, coefficient, parameter
    from preisach_jax.errors import InputError, PrecisionWarning
    from preisach_jax.filter.adaptive import AdaptiveFilter
    from preisach_jax.filter.comparison import compare_recursions
    from preisach_jax.filter.fleet import FleetResult, run_fleet
    from preisach_jax.filter.least_squares import RecursiveLeastSquares
    from preisach_jax.filter.online import OnlineFilter
    from preisach_jax.fit import Fit, fit
    from preisach_jax.look import Look, look
    from preisach_jax.loss import Cycle, Loss, loss_per_cycle
    from preisach_jax.model import Model, ParameterEstimate, Prediction
    from preisach_jax.operator.plane import Plane
    from preisach_jax.operator.simulation import simulate
    from preisach_jax.paper.sweep import Sweep, sweep
    from preisach_jax.plant import simulate_stage
    from preisach_jax.record.core import Record

    __version__: str

__all__ = [
    "AdaptiveFilter",
    "AddedEffect",
    "Compensation",
    "Cycle",
    "Design",
    "Diagnosis",
    "Effect",
    "Exploration",
    "Fit",
    "FleetResult",
    "HysteresisEffect",
    "InputEffect",
    "InputError",
    "Look",
    "Loop",
    "Loss",
    "Model",
    "OnlineFilter",
    "OnlineInverse",
    "OutputEffect",
    "Parameter",
    "ParameterEstimate",
    "Plane",
    "PrecisionWarning",
    "Prediction",
    "Record",
    "RecursiveLeastSquares",
    "SensorEffect",
    "Signals",
    "SparseForm",
    "Survey",
    "Sweep",
    "WeightEffect",
    "coefficient",
    "compare_recursions",
    "compensate",
    "design",
    "diagnose",
    "effects",
    "explore",
    "find_form",
    "fit",
    "look",
    "loss_per_cycle",
    "parameter",
    "run_fleet",
    "simulate",
    "simulate_loop",
    "simulate_stage",
    "sweep",
]

_NAMES = {
    "compensation": "Compensation Loop OnlineInverse compensate simulate_loop",
    "diagnosis": "Diagnosis SparseForm diagnose find_form",
    "diagnosis.design": "Design design",
    "diagnosis.exploration": "Exploration explore",
    "effects": "effects",
    "effects.base": (
        "AddedEffect Effect HysteresisEffect InputEffect "
        "OutputEffect SensorEffect Signals Survey WeightEffect"
    ),
    "effects.parameter": "Parameter coefficient parameter",
    "errors": "InputError PrecisionWarning",
    "filter.adaptive": "AdaptiveFilter",
    "filter.comparison": "compare_recursions",
    "filter.fleet": "FleetResult run_fleet",
    "filter.least_squares": "RecursiveLeastSquares",
    "filter.online": "OnlineFilter",
    "fit": "Fit fit",
    "look": "Look look",
    "loss": "Cycle Loss loss_per_cycle",
    "model": "Model ParameterEstimate Prediction",
    "operator.plane": "Plane",
    "operator.simulation": "simulate",
    "paper.sweep": "Sweep sweep",
    "plant": "simulate_stage",
    "record.core": "Record",
}
"""The names that each module defines, within this package."""

_HOMES = {name: home for home, names in _NAMES.items() for name in names.split()}

SHOWN_BY = {
    "Record._repr_html_": "present.record_html",
    "Model._repr_html_": "present.model_html",
    "Model.to_control": "export.control.to_control",
    "Fit._repr_html_": "present.fit_html",
    "Fit.summary": "present.fit_text",
    "Fit.plot": "plot.traces.overview",
    "Diagnosis._repr_html_": "present.diagnosis_html",
    "Diagnosis.summary": "present.diagnosis_text",
    "Exploration._repr_html_": "present.exploration_html",
    "Look.plot": "plot.look.first_look",
    "Loop.plot": "plot.compensation.draw_loop",
}
"""The function above that does the work of a result's method, within this package."""


def _loaded_when_called(place: str) -> Callable[..., Any]:
    module, _, name = place.rpartition(".")

    def call(*given: Any) -> Any:
        return getattr(import_module(f"{__name__}.{module}"), name)(*given)

    return call


HOOKS.update({method: _loaded_when_called(place) for method, place in SHOWN_BY.items()})

_OTHER_NAMES = {"effects": "library"}
"""Names that are others in their module."""


class _Package(ModuleType):
    """A package in which `fit`, `effects` and `sweep` are the functions.

    When a module of one of these names is imported, Python binds it to its package.
    """

    def __setattr__(self, name: str, value: Any) -> None:
        if not (name in _HOMES and isinstance(value, ModuleType)):
            super().__setattr__(name, value)


sys.modules[__name__].__class__ = _Package


def __getattr__(name: str) -> Any:
    if name in _HOMES:
        home = import_module(f"{__name__}.{_HOMES[name]}")
        value = getattr(home, _OTHER_NAMES.get(name, name))
    elif name == "__version__":
        from importlib.metadata import version

        value = version(__name__)
    elif not name.startswith("_") and find_spec(f"{__name__}.{name}") is not None:
        return import_module(f"{__name__}.{name}")
    else:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__, "__version__"})
