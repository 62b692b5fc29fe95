"""Models of every effect with drawn parameters, and their C code, compiled and called."""

import copy
import ctypes
import itertools
import shutil
import subprocess
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from preisach_jax import Model, ParameterEstimate, Plane, Record, Survey
from preisach_jax.chain.coefficients import Coefficients
from preisach_jax.chain.description import Chain
from preisach_jax.effects import BUILT_IN
from preisach_jax.effects.base import OfColumn
from preisach_jax.export.c import sources
from preisach_jax.export.description import describe
from preisach_jax.model import Origin

KINDS: dict[str, Any] = {kind().name: kind for kind in BUILT_IN}
STEP_S = 1 / 512  # so that times and their differences are exact
LOW, HIGH = -2.0, 8.0
NUMBERS = itertools.count()
GCC = shutil.which("gcc") or ""
STRICT = ["-std=c99", "-Wall", "-Wextra", "-Wconversion", "-Wshadow", "-Werror", "-pedantic"]
needs_compiler = pytest.mark.skipif(not GCC, reason="no gcc here")

RUNNER = """
#include "preisach_model.h"
#include <stddef.h>
size_t size_of_state(void) { return sizeof(preisach_state); }
void begin(preisach_state *s) { preisach_init(s); }
void run(preisach_state *s, long n, int kind, const double *u, const double *aux, const double *z,
         double *out)
{
    long k;
    (void)aux;
    for (k = 0; k < n; k++) {
        preisach_real value = (preisach_real)u[k];
        out[k] = kind == 0   ? (double)preisach_step(s, value AUX)
#ifndef PREISACH_NO_INVERSE
                 : kind == 1 ? (double)preisach_inverse_step(s, value AUX)
#endif
                             : (double)preisach_adapt_step(s, value AUX, (preisach_real)z[k]);
    }
}
void put_weights(preisach_state *s, const double *w)
{
    preisach_real own[PREISACH_CELLS];
    int i;
    for (i = 0; i < PREISACH_CELLS; i++) own[i] = (preisach_real)w[i];
    preisach_set_weights(s, own);
}
long refused(const preisach_state *s) { return (long)s->refused; }
void weights(const preisach_state *s, double *w)
{
    int i;
    for (i = 0; i < PREISACH_CELLS; i++) w[i] = (double)s->weights[i];
}
"""


def smooth(samples, seed=0, low=LOW, high=HIGH):
    """A sum of sines that is scaled to a range."""
    t = np.arange(samples) * STEP_S
    rng = np.random.default_rng(seed)
    sines = [a * np.sin(2 * np.pi * f * t + p)
             for a, f, p in zip(rng.uniform(0.3, 1, 4), rng.uniform(0.2, 3, 4),
                                rng.uniform(0, 6, 4), strict=True)]  # fmt: skip
    total = np.sum(sines, axis=0)
    return low + (high - low) * (total - total.min()) / np.ptp(total)


def wild(samples, seed=0, low=LOW, high=HIGH):
    """Moves of all sizes, holds, decaying swings and jumps."""
    rng = np.random.default_rng(seed)
    course, at = [], 0.5 * (low + high)
    while sum(map(len, course)) < samples:
        kind, count = rng.integers(5), int(rng.integers(5, 60))
        if kind == 0:
            to = rng.uniform(low, high)
            part = np.linspace(at, to, count)
        elif kind == 1:
            part = np.full(count, at)
        elif kind == 2:
            decay = rng.uniform(0.8, 0.99) ** np.arange(count)
            part = at + 0.5 * min(at - low, high - at) * decay * (-1.0) ** np.arange(count)
        elif kind == 3:
            part = np.clip(at + np.cumsum(rng.normal(size=count)) * 0.02, low, high)
        else:
            part = rng.uniform(low, high, 3)
        course.append(part)
        at = part[-1]
    return np.clip(np.concatenate(course)[:samples], low, high)


def drawn(names, seed=0, levels=9, hysteron="ramp", polarity=1, thresholds=None):
    """A model of some effects, named as in the library or as `FORMS` has them."""
    rng = np.random.default_rng(seed)
    u = smooth(2048, seed)
    z = 3.0 * (u - LOW) / (HIGH - LOW) + 0.3 * np.sin(u)
    time = np.arange(len(u)) * STEP_S
    survey = Survey(float(time[-1]), STEP_S, time, u, z, 0.1 * rng.normal(size=len(u)))
    effects = tuple(_bound(name, survey) for name in names)
    plane = Plane(levels, LOW, HIGH, thresholds)
    chain = Chain(plane, effects, hysteron, polarity)
    values = {}
    for effect in effects:
        values[effect.name] = own = {}
        for parameter in effect.parameters():
            inside = 10 ** rng.uniform(-0.5, 0.5) * np.median(parameter.start)
            if parameter.name in ("loss", "a") or parameter.name.startswith("c_"):
                inside = rng.uniform(0.01, 0.1)
            own[parameter.name] = float(np.clip(inside, parameter.low, parameter.high))
        if effect.name == "delay":
            own["delay_s"] = float(rng.uniform(0.3, 6.3)) * STEP_S
        if effect.name == "slew_limit":
            own["slew"] = 0.3 * getattr(effect, "slew_high")  # noqa: B009
        usual = USUAL.get(effect.name, {})
        own |= {name: value for name, value in usual.items() if name in own}
    weights = polarity * rng.uniform(0.0, 0.1, plane.cells)
    added = []
    for _, parameter in chain.coefficients:
        size = 0.02 if "ripple" not in parameter.name else 0.0003
        added.append(rng.uniform(-size, size) if parameter.amount else 5.0)
    aux = [effect.column for effect in effects if isinstance(effect, OfColumn)]
    record = Record.from_arrays(time, u, z, aux={name: smooth(len(u), 7) for name in aux})
    numbers = Coefficients(weights, 0.3 * weights, 0.25, np.array(added))
    return model_with(chain, values, numbers, record, ("t", "u", "z"), 0.01)


def model_with(chain, values, coefficients, record, names, error):
    """A model of given numbers, for a record whose columns have these names."""
    found = [(e.name, p, values[e.name][p.name]) for e in chain.effects for p in e.parameters()]
    added = zip(chain.coefficients, coefficients.added, strict=True)
    found += [(*of, value) for of, value in added]
    parameters = {effect.name: {} for effect in chain.effects}
    for effect, parameter, value in found:
        number = float(value)
        estimate = ParameterEstimate(number, number, number, parameter.unit)
        parameters[effect][parameter.name] = estimate
    columns = dict(zip(("time", "input", "output"), names, strict=True)) | {"aux": [*record.aux]}
    units = {"time": "s", "input": "V", "output": "um"}
    visited = np.ones(chain.plane.cells, bool)
    origin = Origin.of(record)
    return Model(chain, values, coefficients, parameters, visited, columns, units, origin, error)


USUAL = {
    "resonance": {"f_hz": 40.0, "zeta": 0.05, "f_2_hz": 90.0, "zeta_2": 0.1, "gain_2": -0.3},
    "input_quantisation": {"step": 0.13},
    "rate_dependence": {"coefficient": 0.3},
}
FORMS = {
    "drift_waves": lambda survey: KINDS["drift"](horizon_s=survey.duration_s, waves=6),
    "drift_by_path": lambda survey: KINDS["drift"](horizon_s=90.0, by_path=True),
    "waves_by_path": lambda survey: KINDS["drift"](horizon_s=90.0, by_path=True, waves=6),
    "ageing_by_path": lambda survey: KINDS["ageing"](horizon_s=90.0, by_path=True),
    "rate_smooth": lambda survey: KINDS["rate_dependence"](40.0, HIGH - LOW, False, False),
    "rate_corners": lambda survey: KINDS["rate_dependence"](40.0, HIGH - LOW, False, True),
    "rate_corners_all": lambda survey: KINDS["rate_dependence"](40.0, HIGH - LOW, True, True),
    "rate_smooth_all": lambda survey: KINDS["rate_dependence"](40.0, HIGH - LOW, True, False),
    "ripples": lambda survey: KINDS["output_nonlinearity"](0.25, 4.0, 24),
    "input_filter": lambda survey: KINDS["input_lag"](STEP_S / 4, 1.0, of_samples=True),
    "output_filter": lambda survey: KINDS["output_lag"](STEP_S / 4, 1.0, of_samples=True),
    "two_modes": lambda survey: KINDS["resonance"](f_low_hz=1.0, f_high_hz=200.0, modes=2),
    "cross:y_V": lambda survey: KINDS["cross:COL"](
        "y_V", "V", STEP_S / 2.8, 0.1, modes=2, turned=True
    ),
    "aux:load_N": lambda survey: KINDS["aux:COL"]("load_N", "N", STEP_S / 10, 1.0),
}


def _bound(name, survey):
    if name in FORMS:
        return FORMS[name](survey)
    return KINDS[name]().bound_to(survey)


class Compiled:
    """C code of a model as a library, and one state of it."""

    def __init__(self, model, folder, *options, rate_hz=None, without=()):
        self.model = model
        self.texts = sources(describe(model, rate_hz, without))
        self.folder = Path(folder)
        for name, text in self.texts.items():
            (self.folder / name).write_text(text)
        aux = "".join(
            f", (preisach_real)aux[{i} * n + k]" for i in range(len(model.columns["aux"]))
        )
        (self.folder / "runner.c").write_text(RUNNER.replace(" AUX", aux))
        # Of two libraries of one name the second would be the first.
        library = self.folder / f"model_{next(NUMBERS)}.so"
        done = subprocess.run(
            [GCC, *STRICT, "-O0", "-fPIC", "-shared", *options, "preisach_model.c", "runner.c",
             "-o", str(library), "-lm"],
            cwd=self.folder, capture_output=True, text=True, check=False,
        )  # fmt: skip
        assert done.returncode == 0, done.stderr[:3000]
        self.library = ctypes.CDLL(str(library))
        self.library.size_of_state.restype = ctypes.c_size_t
        self.library.refused.restype = ctypes.c_long
        self.state = ctypes.create_string_buffer(self.library.size_of_state())
        self.begin()

    def with_weights(self, weights):
        """The same code, as another stage: with weights of its own and a state that begins."""
        other = copy.copy(self)
        other.state = ctypes.create_string_buffer(self.library.size_of_state())
        other.begin()
        other.put_weights(weights)
        return other

    def begin(self):
        self.library.begin(self.state)

    def __call__(self, u, aux=(), kind=0, z=None):
        u = np.ascontiguousarray(u, float)
        stacked = np.ascontiguousarray(np.stack(aux) if len(aux) else np.zeros((1, len(u))), float)
        z = np.ascontiguousarray(np.zeros_like(u) if z is None else z, float)
        out = np.empty_like(u)
        pointers = [each.ctypes.data_as(ctypes.c_void_p) for each in (u, stacked, z, out)]
        self.library.run(self.state, ctypes.c_long(len(u)), kind, *pointers)
        return out

    def again(self, u, aux=()):
        """Outputs from the beginning, after which the state begins again."""
        self.begin()
        outputs = self(u, aux)
        self.begin()
        return outputs

    def inverse(self, wanted, aux=()):
        return self(wanted, aux, kind=1)

    def adapt(self, u, z, aux=()):
        return self(u, aux, kind=2, z=z)

    @property
    def weights(self):
        found = np.empty(self.model.plane.cells)
        self.library.weights(self.state, found.ctypes.data_as(ctypes.c_void_p))
        return found

    def put_weights(self, weights):
        weights = np.ascontiguousarray(weights, float)
        self.library.put_weights(self.state, weights.ctypes.data_as(ctypes.c_void_p))


def predicted(model, u, aux=()):
    """What `Model.predict` says to a record at the model's rate that continues none."""
    names = model.columns["aux"]
    time = np.arange(len(u)) * model.origin.step_s
    blank = np.full(len(u), np.nan)
    columns = dict(zip(names, aux, strict=True))
    return model.predict(Record.from_arrays(time, u, blank, aux=columns)).output
