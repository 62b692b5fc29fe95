"""`preisach demo`: a real record, and a simulated one with a hidden effect."""

from __future__ import annotations

import hashlib
import json
from importlib.resources import as_file, files
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from preisach_jax.cli import screen
from preisach_jax.cli.commands import stage_files
from preisach_jax.cli.options import Force
from preisach_jax.cli.shared import command

if TYPE_CHECKING:
    from preisach_jax.diagnosis.result import Diagnosis

HIDDEN = ("creep", "input_lag", "delay", "drift", "ageing")
"""What may be hidden; an auxiliary column would give itself away."""

SECONDS, RATE_HZ = 12.0, 1000.0


@command("preisach demo", "preisach demo --seed 7 --out demo", fits=True)
def demo(
    out: Annotated[Path, typer.Option(metavar="DIR", help="folder of the two reports")] = Path(
        "preisach-demo"
    ),
    seed: Annotated[
        int, typer.Option(metavar="S", help="seed of the stage and its hidden effect")
    ] = 1,
    force: Force = False,
) -> dict[str, Any]:
    """Diagnose a bundled measurement and a simulated stage."""
    from preisach_jax.files import check_folder
    from preisach_jax.report import diagnosis_names

    curves, stage = out / "reversal-curves", out / "simulated-stage"
    check_folder(out)
    check_folder(curves, [], diagnosis_names(curves), force=force)
    check_folder(stage, [], ["data.csv", "truth.json", *diagnosis_names(stage)], force=force)
    screen.say("1. Measured: first-order reversal curves of a rock sample (bundled)\n")
    with as_file(files("preisach_jax") / "bundled" / "conventional_example.forc") as path:
        measured = _diagnose(path, curves)
    screen.say(f"\n{_at_calibration(measured)}")
    screen.say("\n\n2. Simulated: a piezo stage with one hidden effect\n")
    truth, seal = _seal(stage, seed)
    found = _diagnose(stage / "data.csv", stage)
    screen.say(f"\n{_judge(found, truth, seal)}")
    screen.say("\nReports:")
    reports = [folder / "report.html" for folder in (curves, stage)]
    for report in reports:
        screen.say(f"  {report}")
    return screen.written(reports, measured=measured.to_json(), simulated=found.to_json())


def _diagnose(path: Path, folder: Path) -> Diagnosis:
    from preisach_jax.diagnosis import diagnose
    from preisach_jax.record import Record
    from preisach_jax.report import write_report

    notes: list[str] = []
    record = Record.load(path, announce=notes.append)
    screen.show_record(record, notes)
    with screen.progress() as show:
        found = diagnose(record, progress=screen.of_a_diagnosis(show))
        show("writing the report", 0.97)
        write_report(found, folder, command="preisach demo")
    screen.show_diagnosis(found)
    return found


def _at_calibration(found: Diagnosis) -> str:
    """Errors at the calibration points: the same state, measured again before every curve."""
    import numpy as np

    record = found.base.record
    again = np.flatnonzero(record.measured[1:] & ~record.measured[:-1]) + 1
    shares = [
        100 * np.sqrt(np.mean(fit.residual[again] ** 2)) / record.output_range
        for fit in (found.base, found.final)
    ]
    return (
        f"At the {len(again)} calibration points, where one state is measured again and again, the "
        f"error falls from {shares[0]:.3f} to {shares[1]:.3f} % of the range."
    )


def _seal(folder: Path, seed: int) -> tuple[Path, str]:
    """Write a simulated record and, first, what it hides; returns the latter's file and hash."""
    import numpy as np

    from preisach_jax.files import write_files
    from preisach_jax.plant import simulate_stage

    hidden = HIDDEN[int(np.random.default_rng(abs(seed)).integers(len(HIDDEN)))]
    stage = simulate_stage(seed, SECONDS, (hidden,), RATE_HZ)
    truth = folder / "truth.json"
    contents = stage_files(stage, folder / "data.csv", truth)
    write_files(contents)
    seal = hashlib.sha256(contents[truth]).hexdigest()
    screen.say(f"Hidden effect: in {truth} (SHA-256 {seal[:16]}...), read after the verdict.")
    return truth, seal


def _judge(found: Diagnosis, truth: Path, seal: str) -> str:
    """Open the truth and say whether the verdict was right."""
    content = truth.read_bytes()
    if hashlib.sha256(content).hexdigest() != seal:
        return f"{truth} was changed since it was written: the verdict cannot be checked."
    hidden = json.loads(content)["effects"][0]
    text = f"The hidden effect was {hidden}."
    first = found.findings[0] if found.findings else None
    if first is None:
        return f"{text} The verdict was wrong: it names nothing."
    if first.effect == hidden:
        later = found.effects[1:]
        beside = f", though it names {', '.join(later)} beside it" if later else ""
        return f"{text} The verdict was right{beside}."
    if hidden in first.family:
        return f"{text} The verdict names {first.effect}, which it cannot tell from {hidden}."
    return f"{text} The verdict was wrong: it names {first.effect} first."
