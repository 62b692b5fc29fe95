"""Drive simulated stages along wanted courses by the inverse of a model that was fitted to them.

    python benchmarks/drive.py [--models FOLDER] [--seeds 1,2,3] [--levels 25]

Each stage is measured and fitted first (`preisach_jax.plant`, which shares no code with the
models), then `compensate` finds the drive for a course, and the same stage plays it after its
record.  The reading, with its noise, is compared with the course; so is that of an affine map.  Two
more courses a stage cannot be followed: one leaves the stroke, one needs more than the limits and
the slew allow.  Writes `benchmarks/results/drive.json`.
"""

from __future__ import annotations

import argparse
import time as clock
from pathlib import Path

import jax
import numpy as np
from conditions import write_results

import preisach_jax as pj
from preisach_jax.plant.effects import bend, move, respond
from preisach_jax.plant.stage import make_stage

COMBINATIONS = (
    (),
    ("creep",),
    ("input_lag",),
    ("output_lag",),
    ("delay",),
    ("resonance",),
    ("rate_dependence",),
    ("slew_limit",),
    ("moving",),
    ("drift", "hum"),
    ("ageing", "aux:load_N"),
    ("creep", "input_lag"),
    ("creep", "resonance"),
    ("creep", "input_lag", "drift"),
    ("creep", "delay", "output_nonlinearity"),
)
RATE_HZ, SECONDS, COURSE_S, FINE = 2000.0, 24.0, 4.0, 5
UNITS = {"input": "V", "output": "um", "load_N": "N"}


def settling(now: np.ndarray, tau: float, until: float) -> np.ndarray:
    return np.expm1(-now / tau) / np.expm1(-until / tau)


def play(record, drive: np.ndarray, load: np.ndarray, noise: np.random.Generator) -> np.ndarray:
    """The reading of a stage along a drive that follows its record, (time,) µm."""
    truth = record.truth
    hidden = {name: dict(own) for name, own in truth["parameters"].items()}
    whole = np.concatenate([record.input, drive])
    step = 1 / (RATE_HZ * FINE)
    time = np.arange(len(whole)) / RATE_HZ
    inner = np.arange((len(whole) - 1) * FINE + 1) * step
    stage = make_stage(truth["seed"])
    ageing = hidden.pop("ageing", None)
    position = move(stage, hidden, np.interp(inner, time, whole), step)
    if ageing:  # that of the record's length goes on beyond it
        position = position * (1 - ageing["loss"] * settling(inner, ageing["tau_s"], SECONDS))
    position = respond(hidden, position, inner, step)
    if own := hidden.get("drift"):
        position = position + own["amplitude_um"] * settling(inner, own["tau_s"], SECONDS)
    if own := hidden.get("hum"):
        lines = enumerate(zip(own["amplitude_um"], own["phase_rad"], strict=True), start=1)
        angle = 2 * np.pi * own["f_hz"] * inner
        position = position + sum(a * np.sin(n * angle + phase) for n, (a, phase) in lines)
    z = position[::FINE]
    if own := hidden.get("aux:load_N"):
        loads = np.concatenate([record.aux["load_N"], load])
        z = z + own["gain_um_per_N"] * (loads - loads[0])
    if own := hidden.get("output_nonlinearity"):
        stroke = stage.stroke()
        z = bend(z, own["coefficients_um"], stroke)
    z = z[len(record.input) :] + noise.normal(0.0, truth["noise_um"], len(drive))
    grating = truth["encoder_step_um"]
    return grating * np.floor(z / grating + 0.5)


def wanted_course(record, resonance_hz: float) -> tuple[np.ndarray, np.ndarray]:
    """Time and a course of loops, minor loops, a multisine and a hold, within the stroke."""
    time = np.arange(round(COURSE_S * RATE_HZ)) / RATE_HZ
    begin, low, high = record.output[-200:].mean(), record.output.min(), record.output.max()
    fast = min(20.0, resonance_hz / 6)
    waves = 0.26 * np.sin(2 * np.pi * 2.5 * time) * np.cos(2 * np.pi * 0.3 * time)
    waves += 0.05 * np.sin(2 * np.pi * fast * time) + 0.07 * np.sin(2 * np.pi * 6.1 * time + 1)
    hold = np.clip((time - 2.2) / 0.2, 0, 1) * np.clip((3.0 - time) / 0.2, 0, 1)
    waves *= 1 - hold**2 * (3 - 2 * hold) ** 2
    course = low + (high - low) * (0.5 + waves)
    blend = np.clip(time / 0.4, 0, 1)
    blend = blend**2 * (3 - 2 * blend)
    return time, begin + (course - begin) * blend


def rms(values: np.ndarray) -> float:
    return float(np.sqrt(np.mean(values**2)))


def model_of(name: str, record, effects, folder: Path | None, levels: int):
    path = folder / f"{name}.json" if folder else None
    if path and path.exists():
        return pj.Model.load(path)
    measured = pj.Record.from_arrays(
        record.time,
        record.input,
        record.output,
        aux=record.aux,
        units={key: unit for key, unit in UNITS.items() if key in ("input", "output", *record.aux)},
    )
    model = pj.fit(measured, effects=effects, levels=levels).model
    if path:
        model.save(path)
    return model


def trial(effects, seed: int, folder: Path | None, levels: int) -> dict:
    record = pj.simulate_stage(seed, SECONDS, effects, RATE_HZ)
    name = f"{seed}-{'_'.join(effects).replace(':', '-') or 'none'}"
    model = model_of(name, record, effects, folder, levels)
    hidden = record.truth["parameters"]
    first_hz = hidden.get("resonance", {}).get("f_hz", np.inf)
    time, z = wanted_course(record, first_hz)
    aux = {}
    if "load_N" in record.aux:
        aux["load_N"] = record.aux["load_N"][-1] + 4 * np.sin(2 * np.pi * 0.6 * time)
    load = aux.get("load_N", 0 * time)
    noise = np.random.default_rng([seed, 77])

    def course(values):
        return pj.Record.from_arrays(time, 0 * time, values, aux=aux)

    started = clock.perf_counter()
    found = pj.compensate(model, course(z))
    took = clock.perf_counter() - started
    good = found.reachable
    reading = play(record, found.drive, load, noise)
    error = (reading - z)[good]
    predicted = rms((reading - found.expected)[good])
    slope, level = np.polyfit(record.output, record.input, 1)
    affine = play(record, np.clip(slope * z + level, 0, 75), load, noise) - z
    stroke = record.truth["stroke_um"]

    told = []
    middle = z.mean()
    courses = [
        ("outside the stroke", middle + 1.9 * (z - middle), {}),
        ("limits and slew", z, {"limits": (0.0, 50.0), "slew": 700.0}),
    ]
    for what, values, options in courses:
        other = pj.compensate(model, course(values), **options)
        reading = play(record, other.drive, load, noise)
        off = np.abs(reading - values)
        far = off > max(6 * model.rms_validation, 0.01 * stroke)
        moves = np.abs(np.diff(other.drive)) * RATE_HZ
        low, high = options.get("limits", (0.0, 75.0))
        told.append(
            {
                "course": what,
                "rows_flagged": int((~other.reachable).sum()),
                "rows_far_off": int(far.sum()),
                "rows_far_off_flagged": int((far & ~other.reachable).sum()),
                "rms_of_reachable_rows": rms((reading - values)[other.reachable]),
                "limits_kept": bool(
                    other.drive.min() >= low
                    and other.drive.max() <= high
                    and moves.max() <= options.get("slew", np.inf) * (1 + 1e-9)
                ),
                "told": bool((~other.reachable).any() and other.notes),
            }
        )
    return {
        "effects": list(effects),
        "seed": seed,
        "held_out_rms_um": model.rms_validation,
        "tracking_rms_um": rms(error),
        "ratio": rms(error) / model.rms_validation,
        "prediction_rms_um": predicted,
        "left_by_the_inverse_rms_um": rms((found.expected - z)[good]),
        "percent_of_stroke": 100 * rms(error) / stroke,
        "largest_error_um": float(np.abs(error).max()),
        "affine_rms_um": rms(affine),
        "affine_percent_of_stroke": 100 * rms(affine) / stroke,
        "rows_unreachable": int((~good).sum()),
        "rows": len(z),
        "within_band": float(np.mean(np.abs(error) <= (found.high - found.expected)[good])),
        "compensate_s": took,
        "unreachable": told,
    }


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--models", type=Path, help="folder in which fitted models are kept")
    parser.add_argument("--seeds", default="1,2,3")
    parser.add_argument("--levels", type=int, default=25)
    parser.add_argument("--only", help="effects by commas; 'none' for a stage without")
    parser.add_argument("--out", default="drive.json")
    given = parser.parse_args()
    rows = []
    for effects in COMBINATIONS:
        if given.only is not None and (",".join(effects) or "none") != given.only:
            continue
        for seed in map(int, given.seeds.split(",")):
            with jax.enable_x64(True):
                row = trial(effects, seed, given.models, given.levels)
            rows.append(row)
            print(
                f"{','.join(effects) or 'none':34} {seed}: held out "
                f"{1e3 * row['held_out_rms_um']:6.1f} nm, tracking "
                f"{1e3 * row['tracking_rms_um']:6.1f} nm ({row['ratio']:.2f}, "
                f"{row['percent_of_stroke']:.3f} %), affine {row['affine_percent_of_stroke']:.1f} "
                f"%, {row['rows_unreachable']} rows not reachable, told "
                + " ".join(
                    f"{t['rows_far_off_flagged']}/{t['rows_far_off']}"
                    f"({t['rows_flagged']};{1e3 * t['rms_of_reachable_rows']:.0f}nm"
                    f"{'' if t['limits_kept'] else ' LIMITS'})"
                    for t in row["unreachable"]
                )
                + f" {row['compensate_s']:.1f} s",
                flush=True,
            )
        if given.only is None:  # an interruption leaves what is done
            write_results(given.out, summary_of(rows))
    print({key: value for key, value in summary_of(rows).items() if key != "rows"})


def summary_of(rows: list[dict]) -> dict:
    passed = [r["ratio"] <= 1.2 and r["percent_of_stroke"] <= 0.3 for r in rows]
    told = [t["told"] for r in rows for t in r["unreachable"]]
    return {
        "stages": len(rows),
        "stages_within_both_bounds": sum(passed),
        "stages_within_0.3_percent_of_stroke": sum(r["percent_of_stroke"] <= 0.3 for r in rows),
        "stages_within_1.2_held_out_errors": sum(r["ratio"] <= 1.2 for r in rows),
        "unreachable_courses": len(told),
        "unreachable_courses_told": sum(told),
        "rows": rows,
    }


if __name__ == "__main__":
    main()
