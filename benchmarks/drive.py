"""Drive simulated stages along wanted courses by the inverse of a model that was fitted to them.

    python benchmarks/drive.py --folder build/drive [--seeds 1,2,3] [--levels 38]

The stages are those of `benchmarks/blind/world.py`, which shares no code with the models.  Each is
measured for 12 s and fitted with the effects hidden in it; `compensate` finds the drive for a
course, and the same stage plays that drive after its record.  Where the stage then is, without the
noise of its sensor, is compared with the course.  The held-out error of the model, by which the
tracking error is divided, contains that noise.

Two courses a stage can be followed.  `as recorded` consists of the kinds of motion of the record in
their shares (loops, decaying triangles, staircases with holds, minor loops), with other turning
points.  `moving` moves in all but an eighth of its rows.  The record rests in nearly half of its
rows, where every model errs least; so beside its held-out error stands that of the rows like those
of the course, as the band of the model tells it.  Two more courses cannot be followed: one leaves
the stroke, one needs more than the limits and the slew allow.

Models and finished stages are kept in the folder, and an interrupted run goes on.  Writes
`benchmarks/results/drive.json`.
"""

from __future__ import annotations

import argparse
import json
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import jax
import numpy as np
from blind import hidden, world
from blind.excitation import Drive, make_drive
from common import write_results

import preisach_jax as pj

COMBINATIONS = (
    (),
    ("input_lag",),
    ("output_lag",),
    ("delay",),
    ("slew_limit",),
    ("rate_dependence",),
    ("creep",),
    ("resonance",),
    ("drift",),
    ("hum",),
    ("ageing",),
    ("output_nonlinearity",),
    ("moving",),
    ("aux",),
    ("accommodation",),
    ("creep", "input_lag"),
    ("creep", "resonance"),
    ("output_lag", "hum"),
    ("ageing", "aux"),
    ("rate_dependence", "drift"),
    ("delay", "output_nonlinearity"),
    ("creep", "input_lag", "drift"),
    ("creep", "delay", "output_nonlinearity"),
    ("slew_limit", "ageing", "hum"),
)
RATE_HZ, SECONDS, MOVING_S = 1200.0, 12.0, 3.0
COURSES = ("as recorded", "moving")
MOST_RATIO, MOST_PERCENT = 1.2, 0.3


class Played:
    """The drive of a record, and what is played behind it, straight from sample to sample."""

    def __init__(self, drive: Drive, levels: np.ndarray):
        last = SECONDS - 1 / RATE_HZ
        self._drive, self._last = drive, last
        self._time = last + np.arange(len(levels) + 1) / RATE_HZ
        self._levels = np.concatenate([drive(np.array([last])), levels])

    def __call__(self, t: np.ndarray) -> np.ndarray:
        """(time,) level at the times t, in s."""
        before = self._drive(np.minimum(t, self._last))
        return np.where(t <= self._last, before, np.interp(t, self._time, self._levels))


@dataclass(frozen=True, eq=False)
class Stage:
    """A stage with hidden effects that was measured, and a model of it."""

    seed: int
    made: world.Measurement
    truth: dict[str, hidden.Truth]
    record: pj.Record
    model: pj.Model

    @staticmethod
    def of(effects: Sequence[str], seed: int, folder: Path, levels: int) -> Stage:
        """Measure and fit a stage, or take its model from the folder."""
        made = world.make_measurement(dict.fromkeys(effects, 1.0), seed, "rich", SECONDS, RATE_HZ)
        aux = {name: made.aux[name] for name in made.aux if name == world.LOAD}
        units = {"input": "V", "output": "um"} | dict.fromkeys(aux, "N")
        record = pj.Record.from_arrays(made.time, made.input, made.output, aux=aux, units=units)
        path = folder / f"{name_of(effects, seed)}-{levels}.json"
        if path.exists():
            model = pj.Model.load(path)
        else:
            model = pj.fit(record, effects=tuple(made.truth), levels=levels).model
            model.save(path)
        here = {called: own for own, called in world.KNOWN_AS.items()}
        truth = {here.get(name, name): own for name, own in made.truth.items()}
        return Stage(seed, made, truth, record, model)

    @property
    def first_hz(self) -> float:
        """Frequency of its first mode."""
        return self.truth.get("resonance", {}).get("f_hz", np.inf)

    def play(self, drive: np.ndarray) -> np.ndarray:
        """Where the stage is along a drive (V) behind its record, (time,) um without noise."""
        setting = world._setting(self.seed, "rich", SECONDS, RATE_HZ, "smooth")
        finer = setting.rows.step
        rows = len(self.record.time) + len(drive)
        lead = setting.rows.start
        t = (np.arange((rows - 1) * finer + 1 + lead) - lead) * setting.step_s
        played = Played(setting.drive, setting.position(drive))
        longer = replace(setting, drive=played, t=t, rows=slice(lead, None, finer))
        clean = world._clean(longer, self.truth)
        before, after = np.split(clean, [len(self.record.time)])
        # The speed at the last row depends on what is played behind it.
        off = rms((before - self.record.output)[:-1])
        assert off < 1.5 * self.made.noise_um, "this is not the stage that was measured"
        return after

    def course(self, z: np.ndarray) -> pj.Record:
        """A wanted course (um), with the load that there will be."""
        time = np.arange(len(z)) / RATE_HZ
        aux = {}
        if world.LOAD in self.record.aux:
            own = self.truth["aux"]["column_seed"]
            aux[world.LOAD] = 15 + world.LOAD_N * hidden.load(SECONDS + time, SECONDS, own)
        return pj.Record.from_arrays(time, 0 * time, z, aux=aux, units={"output": "um"})

    def affine(self, z: np.ndarray) -> np.ndarray:
        """The drive by the straight line that fits the record best."""
        slope, level = np.polyfit(self.record.output, self.record.input, 1)
        return np.clip(slope * z + level, self.record.input.min(), self.record.input.max())


def name_of(effects: Sequence[str], seed: int) -> str:
    return f"{'_'.join(effects) or 'none'}-{seed}"


def rms(values: np.ndarray) -> float:
    return float(np.sqrt(np.mean(values**2)))


def blended(record: pj.Record, course: np.ndarray) -> np.ndarray:
    """A course that begins where the record ends."""
    part = np.clip(np.arange(len(course)) / (0.4 * RATE_HZ), 0, 1)
    begin = record.output[-20:].mean()
    return begin + (course - begin) * part**2 * (3 - 2 * part)


def as_recorded(stage: Stage) -> np.ndarray:
    """The motions of the record with other turning points, smooth below the first mode."""
    time = np.arange(round(SECONDS * RATE_HZ)) / RATE_HZ
    level = make_drive("rich", SECONDS, stage.seed + 1000, RATE_HZ)(time)
    width = 2 * round(RATE_HZ / min(40.0, stage.first_hz / 5) / 2) + 1
    bell = np.hanning(width + 2)[1:-1]
    level = np.convolve(np.pad(level, width // 2, mode="edge"), bell / bell.sum(), "valid")
    low, high = stage.record.output.min(), stage.record.output.max()
    return blended(stage.record, low + (high - low) * (0.04 + 0.92 * level))


def moving(stage: Stage) -> np.ndarray:
    """Loops, minor loops, two faster sines and a short hold, within the stroke."""
    time = np.arange(round(MOVING_S * RATE_HZ)) / RATE_HZ
    low, high = stage.record.output.min(), stage.record.output.max()
    waves = 0.26 * np.sin(2 * np.pi * 2.5 * time) * np.cos(2 * np.pi * 0.3 * time)
    waves += 0.05 * np.sin(2 * np.pi * min(20.0, stage.first_hz / 6) * time)
    waves += 0.07 * np.sin(2 * np.pi * 6.1 * time + 1)
    hold = np.clip((time - 1.6) / 0.2, 0, 1) * np.clip((2.4 - time) / 0.2, 0, 1)
    waves *= 1 - hold**2 * (3 - 2 * hold) ** 2
    return blended(stage.record, low + (high - low) * (0.5 + waves))


def followed(stage: Stage, name: str, z: np.ndarray) -> dict:
    """How well a course is followed."""
    found = pj.compensate(stage.model, stage.course(z))
    good, stroke = found.reachable, stage.made.stroke_um
    error = rms((stage.play(found.drive) - z)[good])
    line = rms(stage.play(stage.affine(z)) - z)
    return {
        "course": name,
        "tracking_rms_um": error,
        "ratio": error / stage.model.rms_validation,
        "ratio_to_rows_alike": error / rms((found.high - found.low)[good] / (2 * 1.96)),
        "percent_of_stroke": 100 * error / stroke,
        "affine_percent_of_stroke": 100 * line / stroke,
        "rows_unreachable": int((~good).sum()),
    }


def refused(stage: Stage, name: str, z: np.ndarray, limits: tuple | None, slew: float) -> dict:
    """Whether it is told where a course cannot be followed."""
    found = pj.compensate(stage.model, stage.course(z), limits=limits, slew=slew)
    off = np.abs(stage.play(found.drive) - z)
    far = off > max(6 * stage.model.rms_validation, 0.01 * stage.made.stroke_um)
    moves = np.abs(np.diff(found.drive)) * RATE_HZ
    plane = stage.model.plane
    low, high = limits or (plane.low, plane.high)
    kept = found.drive.min() >= low and found.drive.max() <= high
    told = bool((~found.reachable).any() and any("reach" in note for note in found.notes))
    return {
        "course": name,
        "rows_flagged": int((~found.reachable).sum()),
        "rows_far_off": int(far.sum()),
        "rows_far_off_flagged": int((far & ~found.reachable).sum()),
        "limits_kept": bool(kept and moves.max() <= slew * (1 + 1e-9)),
        "told": told,
    }


def trial(effects: Sequence[str], seed: int, folder: Path, levels: int) -> dict:
    """All courses of one stage."""
    stage = Stage.of(effects, seed, folder, levels)
    z = moving(stage)
    middle, plane = z.mean(), stage.model.plane
    width = plane.high - plane.low
    limits = (plane.low, plane.low + 0.65 * width)
    return {
        "effects": list(effects),
        "seed": seed,
        "levels": levels,
        "held_out_rms_um": stage.model.rms_validation,
        "noise_rms_um": stage.made.noise_um,
        "stroke_um": stage.made.stroke_um,
        "followed": [
            followed(stage, "as recorded", as_recorded(stage)),
            followed(stage, "moving", z),
        ],
        "unreachable": [
            refused(stage, "outside the stroke", middle + 1.9 * (z - middle), None, np.inf),
            refused(stage, "limits and slew", z, limits, 9 * width),
        ],
    }


def summary_of(rows: list[dict]) -> dict:
    """What the rows say together."""
    told = [each for row in rows for each in row["unreachable"]]
    by_course = {}
    for name in COURSES:
        own = [each for row in rows for each in row["followed"] if each["course"] == name]
        by_course[name] = {
            "within_0.3_percent": sum(each["percent_of_stroke"] <= MOST_PERCENT for each in own),
            "within_1.2": sum(each["ratio"] <= MOST_RATIO for each in own),
            **{
                f"{what}_{key}": float(measure([each[key] for each in own]))
                for key in ("ratio", "ratio_to_rows_alike", "percent_of_stroke")
                for what, measure in (("median", np.median), ("most", np.max))
            },
            "median_affine_percent": float(
                np.median([each["affine_percent_of_stroke"] for each in own])
            ),
        }
    return {
        "stages": len(rows),
        "courses": by_course,
        "unreachable_courses": len(told),
        "unreachable_courses_told": sum(
            each["told"] and each["rows_far_off"] == each["rows_far_off_flagged"] for each in told
        ),
        "limits_kept": sum(each["limits_kept"] for each in told),
        "rows": rows,
    }


def main() -> None:
    """Run all stages that are not yet in the folder, and write what came out."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--folder", type=Path, default=Path("build/drive"))
    parser.add_argument("--seeds", default="1,2,3")
    parser.add_argument("--levels", type=int, default=38)
    given = parser.parse_args()
    given.folder.mkdir(parents=True, exist_ok=True)
    rows, seeds = [], [int(seed) for seed in given.seeds.split(",")]
    for turn in range(len(seeds)):  # an interrupted run has all effects and several seeds
        for i, effects in enumerate(COMBINATIONS):
            seed = seeds[(i + turn) % len(seeds)]
            kept = given.folder / f"{name_of(effects, seed)}-{given.levels}.row.json"
            if not kept.exists():
                with jax.enable_x64(True):
                    row = trial(effects, seed, given.folder, given.levels)
                kept.write_text(json.dumps(row))
            rows.append(json.loads(kept.read_text()))
            print(json.dumps(rows[-1]), flush=True)
        write_results("drive.json", summary_of(rows))


if __name__ == "__main__":
    main()
