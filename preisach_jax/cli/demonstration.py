"""`preisach demo`: a measured beam, a simulated stage with a hidden effect, a measured rock."""

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
    from preisach_jax.diagnosis.result import Candidate, Diagnosis
    from preisach_jax.fit import Fit
    from preisach_jax.record.core import Record

TRIED = ("creep", "delay", "input_lag", "output_lag")
"""What is tried, and what may be hidden: few effects, so that it takes less than a minute."""

LEVELS = 15
"""Of all models: what is compiled for one record serves the next of as many rows."""

SECONDS, RATE_HZ = 6.0, 500.0
"""Of the simulated stage: as many rows as the beam has."""

WORTH_A_PICTURE = 0.8
"""Error, over that which was shown last, above which what a model leaves is not drawn."""

LOOP_LINES, LOOP_SIGNS, RESIDUAL_LINES = 9, 46, 4


@command("preisach demo", "preisach demo --seed 7 --out demo", fits=True)
def demo(
    out: Annotated[Path, typer.Option(metavar="DIR", help="folder of the results")] = Path(
        "preisach-demo"
    ),
    seed: Annotated[
        int, typer.Option(metavar="S", help="seed of the stage and its hidden effect")
    ] = 1,
    force: Force = False,
) -> dict[str, Any]:
    """Diagnose a measured beam and a simulated stage, and fit a rock."""
    from preisach_jax.files import check_folder
    from preisach_jax.report import diagnosis_names

    folders = beam, stage, rock = out / "beam", out / "simulated-stage", out / "reversal-curves"
    check_folder(out)
    written = (diagnosis_names(beam), ["data.csv", "truth.json", *diagnosis_names(stage)], _ROCK)
    for folder, names in zip(folders, written, strict=True):
        check_folder(folder, [], names, force=force)

    record = _bundled("beam.csv", time="t_s", input="force", output="displacement_m")
    screen.say("1. Measured: a beam, pushed at random (data of NRC Canada, 3,000 rows, 23 s)\n")
    screen.loop_picture(
        record.input, record.output, ("force", "displacement (m)"), LOOP_LINES, LOOP_SIGNS
    )
    screen.say("\nIt looks like hysteresis: the way up is not the way down. A Preisach model is")
    screen.say(f"fitted, and {len(TRIED)} effects are tried on it: {', '.join(TRIED)}.")
    measured = _diagnose(record, beam)
    _close_the_loop(measured)

    screen.say("\n\n2. Simulated: a piezo stage, with one hidden effect\n")
    truth, seal = _seal(stage, seed)
    found = _diagnose(_stage_record(stage), stage)
    screen.say(f"\n{_judge(found, truth, seal)}")

    screen.say("\n\n3. Measured: first-order reversal curves of a rock (PmagPy, 8,634 rows)\n")
    shares = _fit_rock(rock)

    screen.say("\nReports:")
    results = [beam / "report.html", stage / "report.html", rock / "forc.svg"]
    for path in results:
        screen.say(f"  {path}")
    screen.say("\nYour own record: preisach diagnose FILE")
    return screen.written(
        results, measured=measured.to_json(), simulated=found.to_json(), rock_percent=shares
    )


def _bundled(name: str, **columns: str) -> Record:
    from preisach_jax.record.core import Record

    with as_file(files("preisach_jax") / "bundled" / name) as path:
        return Record.load(path, **columns)  # pyright: ignore[reportArgumentType]


def _diagnose(record: Record, folder: Path) -> Diagnosis:
    """Diagnose a record, show what each model on the way leaves, and write the report."""
    from preisach_jax.diagnosis import diagnose
    from preisach_jax.present import error_table, finding_parameters, headline
    from preisach_jax.report import write_report

    shown: list[Fit] = []

    def watch(fit: Fit, tried: tuple[Candidate, ...]) -> None:
        del tried
        if not shown or fit.rms_validation < WORTH_A_PICTURE * shown[-1].rms_validation:
            shown.append(fit)
            _show_residual(fit, shown[0])

    with screen.progress() as show:
        found = diagnose(record, TRIED, LEVELS, progress=screen.of_a_diagnosis(show), watch=watch)
        show("writing the report", 0.97)
        write_report(found, folder, command="preisach demo")
    screen.answer(f"{found.verdict}: {', '.join(found.effects) or 'nothing'}")
    screen.say(f"\n{headline(found)} ({found.verdict}).\n{found.sentence}\n")
    screen.table(*error_table(found.ladder, found.base.record, found.memoryless))
    for finding in found.findings:
        screen.say()
        for name, text in finding_parameters(finding):
            screen.say(f"{finding.effect}: {name} = {text}")
    return found


def _show_residual(fit: Fit, first: Fit) -> None:
    """Show what a fit leaves over time, on the scale of what the first one left."""
    import numpy as np

    from preisach_jax.quantity import quantity, scaled

    record = fit.record
    rms = quantity(fit.rms_validation, record.output_unit, 3)
    share = 100 * fit.rms_validation / record.output_range
    name = " + ".join(["the Preisach model", *fit.effects])
    greatest = float(np.nanmax(np.abs(first.residual[record.measured])))
    factor, unit = scaled(greatest, record.output_unit)
    screen.say(f"\nWhat {name} leaves, in {unit}: {rms} RMS ({share:.2g} % of the stroke)")
    residual = np.where(record.measured, factor * fit.residual, np.nan)
    screen.picture(record.time, residual, RESIDUAL_LINES, (-factor * greatest, factor * greatest))


def _close_the_loop(found: Diagnosis) -> None:
    """Show the loop once more, its input as late as the lag or delay that was found."""
    import numpy as np

    times = [
        estimate.value
        for finding in found.findings
        for estimate in finding.parameters.values()
        if estimate.unit == "s"
    ]
    if len(times) != 1:
        return
    record = found.base.record
    late = np.interp(record.time - times[0], record.time, record.input)
    screen.say(f"\nThe same loop with the force {1000 * times[0]:.0f} ms later: no hysteresis.\n")
    names = ("force, later", "displacement (m)")
    screen.loop_picture(late, record.output, names, LOOP_LINES, LOOP_SIGNS)


def _seal(folder: Path, seed: int) -> tuple[Path, str]:
    """Write a simulated record and, first, what it hides; returns the latter's file and hash."""
    import numpy as np

    from preisach_jax.files import write_files
    from preisach_jax.plant import simulate_stage
    from preisach_jax.signals import diagnostic_record

    hidden = TRIED[int(np.random.default_rng(abs(seed)).integers(len(TRIED)))]
    drive = diagnostic_record(SECONDS, 2 * RATE_HZ)[::2]
    stage = simulate_stage(seed, effects=(hidden,), rate_hz=RATE_HZ, drive=drive)
    truth = folder / "truth.json"
    contents = stage_files(stage, folder / "data.csv", truth)
    write_files(contents)
    seal = hashlib.sha256(contents[truth]).hexdigest()
    screen.say(f"Hidden effect: in {truth} (SHA-256 {seal[:16]}...), read after the verdict.")
    return truth, seal


def _stage_record(folder: Path) -> Record:
    from preisach_jax.record.core import Record

    return Record.load(folder / "data.csv", time="t_s", input="u_V", output="z_um")


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


_ROCK = ["model.json", "forc.svg"]


def _fit_rock(folder: Path) -> dict[str, float]:
    """Fit the rock with thresholds equally spaced, and where its magnetisation moves."""
    from dataclasses import replace

    from preisach_jax.files import json_bytes, write_files
    from preisach_jax.fit import fit
    from preisach_jax.fit.stepwise import double_precision, held_out_rms, plain_model, plane_of
    from preisach_jax.identify.problem import evaluate
    from preisach_jax.plot.plane import forc_diagram
    from preisach_jax.plot.style import svg

    record = _bundled("conventional_example.forc")
    with screen.progress() as show, double_precision():
        show("fitting the rock", 0.1)
        _, problem, point = plain_model(record, LEVELS)
        chain = replace(point.chain, plane=plane_of(problem, LEVELS))
        even = held_out_rms(problem, evaluate(problem, chain, point.values, point.strength))
        show("fitting all rows", 0.6)
        fitted = fit(record, levels=LEVELS)
        figure = svg(forc_diagram(fitted.model)).encode()
        content = json_bytes(fitted.model.to_json())
        write_files({folder / "model.json": content, folder / "forc.svg": figure})
    shares = {
        "equally_spaced": 100 * even / record.output_range,
        "where_the_output_moves": 100 * fitted.rms_validation / record.output_range,
    }
    screen.table(
        (f"{LEVELS} thresholds an axis", "held-out RMS, % of the range"),
        [(name.replace("_", " "), f"{share:.3g}") for name, share in shares.items()],
    )
    return shares
