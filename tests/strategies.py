"""What laws are tried on: planes, input histories, weights, records, effects and models."""

import math
from typing import Any

import hypothesis.strategies as st
import numpy as np
from exported import KINDS, model_with

import preisach_jax as pj
from preisach_jax.chain.coefficients import Coefficients
from preisach_jax.chain.description import Chain
from preisach_jax.operator.inputs import HYSTERONS

SAMPLES = 40
"""Samples of every history, so that what is compiled for one serves all."""

hysterons = st.sampled_from(HYSTERONS)

# What runs on a plane is compiled for it, so these are few. The width of a cell is a power of two:
# thresholds are exact.
PLANES = (pj.Plane(2, -1.0, 1.0), pj.Plane(5, 16.0, 26.0))
planes = st.sampled_from(PLANES)


@st.composite
def histories(draw, plane: pj.Plane, samples: int = SAMPLES) -> np.ndarray:
    """Inputs by eighths of a cell, which often rest, turn on thresholds and reach the limits."""
    eighths = st.integers(0, 8 * plane.levels)
    return plane.low + plane.delta_x / 8 * np.array(
        draw(st.lists(eighths, min_size=samples, max_size=samples)), dtype=float
    )


@st.composite
def weights(draw, plane: pj.Plane) -> np.ndarray:
    """Weights of at least zero, some of them zero; small whole numbers, whose sums are exact."""
    count = plane.cells
    return np.array(draw(st.lists(st.integers(0, 1000), min_size=count, max_size=count))) / 8.0


moderate = st.floats(-100.0, 100.0, allow_subnormal=False)
numbers = st.floats(-1e9, 1e9, allow_nan=False, allow_subnormal=False)
UNITS = ("V", "mV", "um", "µm", "N", "A/m", "degC", "%")
_NAMES = st.text("abcdefgxyzäµ0123456789 _-", min_size=1, max_size=12).map(str.strip)
_TAKEN = {"time", "input", "output", ""}


@st.composite
def records(draw, great: bool = False) -> pj.Record:
    """Records of any values and units, with holes in the output and auxiliary columns.

    Where they are `great`, times may be so too, as those of a file that counts from an epoch.
    """
    count = draw(st.integers(60, 90))
    rng = np.random.default_rng(draw(st.integers(0, 2**32 - 1)))
    scale = 10.0 ** draw(st.integers(-9, 9 if great else 3))
    steps = scale * rng.uniform(0.1, 1.0, count)
    begin = draw(st.sampled_from([0.0, -5.0, 1e4])) * scale
    drive, output = rng.normal(size=(2, count)) * 10.0 ** draw(st.integers(-12, 12))
    drive[:5] = draw(st.lists(numbers, min_size=5, max_size=5))
    output[rng.uniform(size=count) < draw(st.sampled_from([0.0, 0.1]))] = np.nan
    names = draw(st.lists(_NAMES.filter(lambda name: name not in _TAKEN), unique=True, max_size=2))
    aux = {name: rng.normal(size=count) for name in names}
    units = {key: draw(st.sampled_from(UNITS)) for key in ("input", "output", *aux)}
    options: dict[str, Any] = {
        "name": draw(_NAMES.filter(bool)),
        "initial_memory": draw(st.sampled_from(["low", "high", "demagnetised", "free"])),
    }
    time = begin + np.cumsum(steps)
    return pj.Record.from_arrays(time, drive, output, aux=aux, units=units, **options)


@st.composite
def values_of(draw, parameter: pj.Parameter) -> float:
    """A value within the bounds of a parameter, both of them included."""
    low, high = (min(max(bound, -10.0), 10.0) for bound in (parameter.low, parameter.high))
    if parameter.log:
        low, high = float(parameter.low), float(parameter.high)
        exponent = draw(st.floats(math.log(low), math.log(high)))
        return min(max(math.exp(exponent), low), high)
    return draw(st.floats(low, high, allow_subnormal=False))


def columns() -> dict[str, np.ndarray]:
    """Time, input and output of a small record, with an auxiliary column."""
    t = np.arange(60) / 20
    u = 5 - 5 * np.cos(t * (1 + t / 4))
    return {"t_s": t, "u_V": u, "z_um": u**1.1 + 0.01 * t, "load_N": np.sin(3 * t)}


def modelled(chain: Chain, values, coefficients: Coefficients) -> pj.Model:
    """A model of given numbers for the record of `columns`, made without a fit."""
    arrays = columns()
    aux = {"load_N": arrays.pop("load_N")}
    record = pj.Record.from_arrays(*arrays.values(), aux=aux)
    return model_with(chain, values, coefficients, record, arrays, 0.02)


def model_content() -> dict[str, Any]:
    """The content of a model file with an effect of every place."""
    settings: dict[str, dict[str, Any]] = {
        "input_lag": {}, "rate_dependence": {"with_corners": True}, "ageing": {},
        "creep": {"tau_s": (0.1, 1.0)}, "drift": {}, "aux:COL": {"column": "load_N", "unit": "N"},
        "output_nonlinearity": {},
    }  # fmt: skip
    effects = tuple(KINDS[name](**given) for name, given in settings.items())
    chain = Chain(pj.Plane(levels=3, low=0.0, high=10.0), effects)

    def start(p):
        return float(np.clip(p.start[0], max(p.low, -1e3), min(p.high, 1e3)))

    values = {effect.name: {p.name: start(p) for p in effect.parameters()} for effect in effects}
    added = np.array([start(p) for _, p in chain.coefficients])
    cells = np.arange(6.0)
    own = Coefficients(cells + 0.5, cells / 10, 0.25, added, np.linspace(0, 1, 6))
    return modelled(chain, values, own).to_json()


@st.composite
def models(draw, effects: tuple[pj.Effect, ...], levels: int = 3) -> pj.Model:
    """Models of some effects on the record of `columns`."""
    plane = pj.Plane(levels, 0.0, 10.0)
    chain = Chain(plane, effects)
    # A sensor whose map turns back on itself reads several values at once, and is none.
    bent = {effect.name for effect in effects if isinstance(effect, pj.SensorEffect)}
    values = {
        effect.name: {p.name: draw(values_of(p)) for p in effect.parameters()} for effect in effects
    }
    added = [
        draw(values_of(coefficient)) * (1e-6 if name in bent else 1.0)
        for name, coefficient in chain.coefficients
    ]
    first_run = np.array(draw(st.lists(moderate, min_size=2 * levels, max_size=2 * levels)))
    own = Coefficients(
        draw(weights(plane)), np.zeros(plane.cells), draw(moderate), np.array(added), first_run
    )
    return modelled(chain, values, own)
