"""What the file of a model holds."""

from __future__ import annotations

from dataclasses import asdict
from importlib.metadata import version
from typing import Any

from preisach_jax.model.core import Model

FORMAT = "preisach_jax model"

FORMAT_VERSION = 3


def content_of(model: Model) -> dict[str, Any]:
    """The content of the file of a model."""
    own = model.plane.own_thresholds
    origin = asdict(model.origin) | {"history": model.origin.history.tolist()}
    return {
        "format": FORMAT,
        "format_version": FORMAT_VERSION,
        "library_version": version("preisach_jax"),
        "hysteron": model.chain.hysteron,
        "levels": model.plane.levels,
        "low": model.plane.low,
        "high": model.plane.high,
        **({} if own is None else {"thresholds": own.tolist()}),
        "offset": model.offset,
        "weights": model.weights.tolist(),
        "memory": model.coefficients.memory.tolist(),
        "first_run": model.coefficients.first_run.tolist(),
        "visited": model.visited.astype(int).tolist(),
        "effects": [
            {
                "name": effect.name,
                "settings": effect.settings(),
                "parameters": {
                    name: asdict(estimate)
                    for name, estimate in model.parameters[effect.name].items()
                },
            }
            for effect in model.effects
        ],
        "columns": dict(model.columns),
        "units": dict(model.units),
        "sampling": {"step_s": model.origin.step_s, "rows": model.origin.rows},
        "identification": origin,
        "rms_validation": model.rms_validation,
        "noise": model.noise,
        "discretisation": model.discretisation,
        "band": None if model.band is None else model.band.to_json(),
    }
