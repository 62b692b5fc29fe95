"""One case: make the record, diagnose it, and say what could have been reached."""

from __future__ import annotations

import time
import traceback
from typing import Any

import numpy as np

import preisach_jax as pj
from blind.cases import Case
from blind.rivals import rival_names
from blind.world import KIN, Measurement, make_measurement


def judge(case: Case) -> dict[str, Any]:
    """Diagnose one case without telling what is hidden."""
    made = make_measurement(
        case.effects, case.seed, case.excitation, case.seconds, case.rate_hz, case.nothing
    )
    library = sorted(pj.effects())
    result: dict[str, Any] = {
        "id": case.id,
        "suite": case.suite,
        "drawn": list(case.effects),
        "excitation": case.excitation,
        "asked": case.asked,
        "size": next(iter(case.effects.values()), None),
        "hidden": list(made.truth),
        "in_library": [name for name in made.truth if is_known(name, library)],
        "kin": [name for hidden in made.truth for name in KIN.get(hidden, ())],
        "truth": dict(made.truth),
        "stroke_um": made.stroke_um,
        "noise_um": made.noise_um,
        "change": made.change,
        "circumstances": dict(made.circumstances),
        "library": library,
        "error": None,
    }
    if case.ends:
        return result | {"error": "the process ended again and again (too little memory?)"}
    try:
        result |= _said(made, result["in_library"], library if case.asked else None)
    except Exception:
        result["error"] = traceback.format_exc(limit=-3)
    return result


def is_known(name: str, library: list[str]) -> bool:
    """Whether the library has a hidden effect."""
    kind, colon, _ = name.partition(":")
    return (f"{kind}:COL" if colon else name) in library


def _said(made: Measurement, known: list[str], asked: list[str] | None) -> dict[str, Any]:
    units = {"input": "V", "output": "um"}
    record = pj.Record.from_arrays(made.time, made.input, made.output, aux=made.aux, units=units)
    begin = time.perf_counter()
    found = pj.diagnose(record, asked)
    seconds = time.perf_counter() - begin
    content = found.to_json()
    shown = ("effect", "quantity", "value", "above", "rms")
    oracle, kind = _oracle(record, found, made, known)
    return {
        "verdict": found.verdict,
        "effects": list(found.effects),
        "families": [list(finding.family) for finding in found.findings],
        "parameters": {row["effect"]: row["parameters"] for row in content["findings"]},
        "evidence": {row["effect"]: row["evidence"] for row in content["findings"]},
        "limits": [
            {name: row[name] for name in shown}
            for row in content["limits"]
            if row["effect"] in known
        ],
        "close": content["close"],
        "budget": content["budget"],
        "levels": found.model.plane.levels,
        "held_out": {
            "base": found.ladder[0].rms_validation,
            "final": found.ladder[-1].rms_validation,
            "oracle": oracle,
        },
        "oracle_is": kind,
        "rivals": rival_names(found),
        "seconds": seconds,
    }


def _oracle(
    record: pj.Record, found: pj.Diagnosis, made: Measurement, known: list[str]
) -> tuple[float, str]:
    """The held-out error to measure the diagnosis by, and what it is.

    Where the library has all that is hidden, that of the library's own model with the true
    effects, on the plane that the diagnosis chose; else the RMS of the noise.
    """
    if not known or len(known) < len(made.truth):
        return made.noise_um, "noise"
    try:
        fit = pj.fit(record, effects=known, levels=found.model.plane.levels)
    except (FloatingPointError, np.linalg.LinAlgError):
        return made.noise_um, "noise, as the true model could not be fitted"
    return fit.rms_validation, "fit with the true effects"
