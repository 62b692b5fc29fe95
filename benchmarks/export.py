"""Compare generated C with `Model.predict` on many models, and time it beside `relays.c`.

    python benchmarks/export.py
    python benchmarks/export.py --models 100 --samples 1000000 --folder build/export

Models have random weights and up to three random effects each; every fifth has relays, and every
tenth relays alone.  The input is half wild (jumps, holds, decaying swings, noise) and half smooth,
of numbers that a float holds, so that double and float see the same.  The outputs at the first
sample are left out where thresholds move with the speed, which is known at the second one; the
smooth form of rate dependence, which looks ahead in `predict`, is compared on the smooth half
alone, and told apart.  In float a jump (of a relay or a converter) may come a sample early or late,
so that such models are told apart as well.  Finished models are kept in the folder, and an
interrupted run goes on.  Time is that of N = 37 without effects, in ns a sample.
"""

from __future__ import annotations

import argparse
import json
import subprocess
import sys
import tempfile
from pathlib import Path

import jax
import numpy as np
from common import write_results

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "tests"))
from exported import HIGH, LOW, Compiled, drawn, predicted, smooth, wild

from preisach_jax.export.account import jumps
from preisach_jax.export.c import sources
from preisach_jax.export.description import describe
from preisach_jax.signals import bernoulli_ramp

HERE = Path(__file__).parent
EFFECTS = (
    "creep operator_creep reptation input_lag slew_limit input_quantisation rate_corners "
    "rate_corners_all rate_smooth eddy_currents moving output_lag delay resonance drift "
    "drift_waves hum ageing output_nonlinearity ripples output_quantisation aux:load_N"
).split()
EXCLUSIVE = ({"rate_corners", "rate_corners_all", "rate_smooth"}, {"drift", "drift_waves"},
             {"output_nonlinearity", "ripples"})  # fmt: skip


def chosen(seed: int) -> list[str]:
    """One to three effects that can be in one model; none for every tenth."""
    rng = np.random.default_rng(seed)
    if seed % 10 == 9:
        return []
    while True:
        names = rng.choice(EFFECTS, size=rng.integers(1, 4), replace=False).tolist()
        if all(len(set(names) & group) < 2 for group in EXCLUSIVE):
            return names


def compared(seed: int, samples: int) -> dict:
    """The greatest difference of one model, in parts of the output's range."""
    names, hysteron = chosen(seed), "relay" if seed % 5 == 4 else "ramp"
    levels = int(np.random.default_rng(seed).integers(5, 40))
    model = drawn(names, seed, levels, hysteron)
    ahead = "rate_smooth" in names
    u = smooth(samples, seed)
    if not ahead:
        u[: samples // 2] = wild(samples // 2, seed)
    u = u.astype(np.float32).astype(float)
    aux = [smooth(samples, 9, 0.0, 1.0) for _ in model.columns["aux"]]
    aux = [column.astype(np.float32).astype(float) for column in aux]
    expected = predicted(model, u, aux)
    first = int(any(name.startswith("rate") for name in names))
    found = {}
    with tempfile.TemporaryDirectory() as folder:
        for precision in ("DOUBLE", "FLOAT"):
            outputs = Compiled(model, folder, "-O2", f"-DPREISACH_{precision}")(u, aux)
            missed = np.abs(outputs - expected)[first:] / np.ptp(expected)
            found[precision.lower()] = {
                "worst": float(missed.max()),
                "beyond_1e-5": float(np.mean(missed > 1e-5)),
                "equal_to_the_bit": bool(np.array_equal(outputs[first:], expected[first:])),
            }
    about = {"seed": seed, "effects": names, "hysteron": hysteron, "levels": levels}
    jumping = jumps(describe(model))
    return about | {"samples": samples, "looks_ahead": ahead, "jumps": jumping} | found


def kept(seed: int, samples: int, folder: Path) -> dict:
    """A model's row, from the folder if it is there."""
    path = folder / f"{seed}-{samples}.json"
    if not path.exists():
        path.write_text(json.dumps(compared(seed, samples)))
    return json.loads(path.read_text())


def courses(samples: int) -> dict[str, np.ndarray]:
    """Inputs on which the functions are timed."""
    ramp = np.asarray(bernoulli_ramp(jax.random.key(37), samples, 2000.0, high=1.0))
    t = np.arange(samples)
    return {
        "bernoulli_ramp": LOW + (HIGH - LOW) * ramp,
        "smooth": smooth(samples, 3),
        "wild": wild(samples, 1),
        "one_level_a_sample": 0.5 * (LOW + HIGH) + 5 * np.sin(0.2 * t) * np.sin(0.0031 * t),
    }


def timed(hysteron: str, samples: int) -> dict:
    """ns a sample of N = 37 without effects."""
    model, found = drawn([], 0, 37, hysteron), {}
    with tempfile.TemporaryDirectory() as folder:
        for name, text in sources(describe(model)).items():
            Path(folder, name).write_text(text)
        own = ["gcc", "-O2", "-std=c99", "-I", folder]
        kernel = ["gcc", "-O3", "-march=native", "-ffast-math", "-c", str(HERE / "relays.c")]
        subprocess.run([*kernel, "-o", f"{folder}/relays.o"], check=True)
        subprocess.run(
            [*own, "-o", f"{folder}/timed", str(HERE / "export.c"), f"{folder}/preisach_model.c",
             f"{folder}/relays.o", "-lm"], check=True,
        )  # fmt: skip
        for name, u in courses(samples).items():
            np.ascontiguousarray(u, float).tofile(f"{folder}/u.bin")
            limits = [str(LOW), repr((HIGH - LOW) / 37)]
            command = [f"{folder}/timed", str(samples), *limits, f"{folder}/u.bin"]
            done = subprocess.run(command, check=True, capture_output=True, text=True)
            found[name] = json.loads(done.stdout)
    return found


def summary_of(rows: list[dict]) -> dict:
    """What the rows say together."""
    plain = [row for row in rows if not row["looks_ahead"]]
    smooth_float = [row["float"]["worst"] for row in plain if not row["jumps"]]
    relays = [row for row in rows if row["hysteron"] == "relay" and not row["effects"]]
    ramps = [row["double"]["worst"] for row in plain if row["hysteron"] == "ramp"]
    return {
        "worst_double": max(row["double"]["worst"] for row in plain),
        "ramps_within_1e-12": sum(worst <= 1e-12 for worst in ramps),
        "ramps": len(ramps),
        "worst_where_predict_looks_ahead": max(
            (row["double"]["worst"] for row in rows if row["looks_ahead"]), default=0.0
        ),
        "relays_alone": len(relays),
        "relays_alone_equal_to_the_bit": sum(row["double"]["equal_to_the_bit"] for row in relays),
        "worst_float_without_jumps": max(smooth_float),
        "float_without_jumps_within_1e-5": sum(worst <= 1e-5 for worst in smooth_float),
        "float_without_jumps": len(smooth_float),
    }


def main(models: int = 60, samples: int = 20_000, folder: Path = Path("build/export")) -> None:
    """Compare, time, and write the figures."""
    speed = {hysteron: timed(hysteron, 50_000) for hysteron in ("relay", "ramp")}
    for hysteron, courses_of in speed.items():
        for course, row in courses_of.items():
            print(f"{hysteron}, {course}: {row} ns")
    folder.mkdir(parents=True, exist_ok=True)
    rows = []
    for seed in range(models):
        rows.append(kept(seed, samples, folder))
        row = rows[-1]
        print(seed, row["hysteron"], row["effects"], row["double"], row["float"], flush=True)
    summary = summary_of(rows)
    print(summary)
    settings = {"models": models, "samples": samples}
    write_results("export.json", settings | summary | {"ns_a_sample": speed, "rows": rows})


if __name__ == "__main__":
    parser = argparse.ArgumentParser()
    parser.add_argument("--models", type=int, default=60)
    parser.add_argument("--samples", type=int, default=20_000)
    parser.add_argument("--folder", type=Path, default=Path("build/export"))
    main(**vars(parser.parse_args()))
