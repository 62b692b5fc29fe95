"""Hand-made results for tests of what is shown of them: no model is fitted for these."""

from contextlib import contextmanager
from types import SimpleNamespace
from typing import Any

import numpy as np

from preisach_jax.chain.description import Chain
from preisach_jax.diagnosis.limits import Limit
from preisach_jax.diagnosis.result import Budget, Candidate, Diagnosis, Experiment, Finding, Rung
from preisach_jax.effects.creep import Creep
from preisach_jax.effects.drift import Drift
from preisach_jax.model import ParameterEstimate
from preisach_jax.operator.plane import Plane
from preisach_jax.record.core import Record

ROWS = 1200


@contextmanager
def client_in_this_process(workers, scheduler):
    """What `preisach fleet` asks of Dask, in a thread of this process: nothing need be started."""
    from distributed import Client, as_completed

    address = "127.0.0.1:0"
    with Client(
        processes=False, n_workers=1, threads_per_worker=1, dashboard_address=address
    ) as own:
        yield own, as_completed()


def make_record(rows: int = ROWS, **options: Any) -> Record:
    """Loops that shrink, with a stretch in the middle where the output was not measured."""
    time = np.arange(rows) * 0.01
    drive = 50 + 45 * np.exp(-time / time[-1]) * np.sin(2 * np.pi * time / time[-1] * 9)
    output = 0.6 * drive + 2 * np.cos(2 * np.pi * time / time[-1] * 9)
    output[rows // 2 : rows // 2 + rows // 20] = np.nan
    settings: dict[str, Any] = {"units": {"input": "V", "output": "um"}, "name": "stage.csv"}
    return Record.from_arrays(time, drive, output, **(settings | options))


def make_model(effects=(), levels: int = 6, visited=None) -> Any:
    """What reports read of a model."""
    plane = Plane(levels, 0.0, 100.0)
    weights = np.linspace(0.5, 1.5, plane.cells)
    if visited is None:
        visited = np.arange(plane.cells) % 5 != 0
    content = {"weights": weights.tolist(), "noise": float("nan")}
    return SimpleNamespace(
        plane=plane,
        chain=Chain(plane),
        weights=weights,
        visited=visited,
        effects=effects,
        units={"time": "s", "input": "V", "output": "um"},
        origin=SimpleNamespace(record="stage.csv", sha256="0" * 64, rows=ROWS),
        rms_validation=0.1,
        half_width=lambda record: np.ones(len(record)),
        check_invertible=lambda: None,
        to_json=lambda: content,
    )


def make_fit(record: Record, effects=(), error: float = 0.5) -> Any:
    """What figures read of a fit; every fifth of 30 blocks is held out."""
    rng = np.random.default_rng(len(effects))
    residual = rng.normal(0, error / 3, len(record)) + error * np.sin(record.time)
    block = np.arange(len(record)) * 30 // len(record)
    held_out = record.measured & (block % 5 == 2)
    return SimpleNamespace(
        record=record,
        model=make_model(effects),
        prediction=np.where(record.measured, record.output, 30.0) - residual,
        residual=np.where(record.measured, residual, np.nan),
        identification=record.measured & ~held_out,
        validation=held_out,
        effects=tuple(effect.name for effect in effects),
        by_record=(),
        loss=None,
    )


def make_diagnosis(verdict: str = "partly_explained", **changes: Any) -> Diagnosis:
    """A diagnosis with two effects, or with none if the verdict says so."""
    record = changes.pop("record", None) or make_record()
    base = Rung((), 0.55, 0.6, 1.9, 96.0)
    first = Rung(("creep",), 0.2, 0.21, 0.8, 98.5)
    second = Rung(("creep", "drift"), 0.03, 0.031, 0.2, 99.8)
    estimates = {
        "c_1": ParameterEstimate(0.0213, 0.0201, 0.0225, "1"),
        "tau_s": ParameterEstimate(0.0542, 0.0538, np.inf, "s"),
    }
    drift = {"amplitude": ParameterEstimate(-0.4, -0.5, -0.3, "um")}
    numbers = {"gain": 0.878, "score": 15.1, "blocks": 24}
    findings = (
        Finding("creep", ("creep", "drift"), estimates, 0.6, 0.21, numbers),
        Finding("drift", ("drift",), drift, 0.21, 0.031, numbers),
    )
    candidates = (
        Candidate("creep", 0, 0.878, 0.21, numbers, True, ""),
        Candidate("drift", 0, 0.41, 0.46, numbers, False, "creep does more"),
        Candidate("delay", 0, -0.5, 0.7, {}, False, "the held-out error does not fall"),
        Candidate("drift", 1, 0.978, 0.031, numbers, True, ""),
        Candidate("delay", 2, 0.01, 0.031, {}, False, "the gain is too small " * 8),
    )
    creep = Creep(tau_s=(0.1,))
    steps = (
        make_fit(record),
        make_fit(record, (creep,), 0.2),
        make_fit(record, (creep, Drift()), 0.03),
    )
    named = verdict in ("explained", "partly_explained")
    content: dict[str, Any] = {
        "verdict": verdict,
        "sentence": "The plain hysteresis model lacks creep and a drift.",
        "findings": findings if named else (),
        "ladder": (base, first, second) if named else (base,),
        "budget": Budget(0.012, 0.003, 0.004, 0.016, 0.009, 0.024, "um"),
        "candidates": candidates if named else candidates[1:3],
        "limits": (
            Limit("delay", "delay_s", 3.1e-6, "s", False, 1.1e-3, 0.39),
            Limit("moving", "a", None, "V/um", False, None, 0.9999),
        ),
        "alternatives": {},
        "next_experiment": Experiment("hold for a minute", "it splits them", (("creep", "drift"),)),
        "located": "most of it lies at the turns",
        "steps": steps if named else steps[:1],
    }
    content |= {"close": (), "remainder": (), "notes": ()}
    return Diagnosis(**content | changes)
