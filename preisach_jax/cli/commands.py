"""Preisach hysteresis: fit it to a record, find the effect that is missing, predict."""

from __future__ import annotations

import csv
import io
import math
import tempfile
from dataclasses import replace
from importlib.metadata import version
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from preisach_jax.cli import screen
from preisach_jax.cli.completion import complete_effect
from preisach_jax.cli.options import (
    READING,
    AsPng,
    Data,
    Effects,
    Force,
    HoldOut,
    Levels,
    ModelFile,
    SeveralData,
    check_choice,
    effect_names,
    load_all,
    with_columns_of,
    with_effects,
)
from preisach_jax.cli.shared import command
from preisach_jax.errors import InputError

if TYPE_CHECKING:
    from preisach_jax.effects.base import Effect, Parameter
    from preisach_jax.plant import StageRecord
    from preisach_jax.record import ReadOptions


FIRST_STEPS = (
    "preisach demo",
    "preisach diagnose stage.csv",
    "preisach predict preisach-report/model.json next.csv --out next-pred.csv",
)
"""Examples for whoever asks for no command."""


def _show_version(wanted: bool) -> None:
    if wanted:
        screen.say(f"preisach {version('preisach_jax')}")
        raise typer.Exit


def common(
    show_version: Annotated[
        bool,
        typer.Option(
            "--version", callback=_show_version, is_eager=True, help="show the version and exit"
        ),
    ] = False,
) -> None:
    """Fit Preisach hysteresis to a record, find the effect that is missing, predict."""
    del show_version


@command(
    "preisach diagnose stage.csv",
    "preisach diagnose stage.csv --time t_s --input u_V --output z_um",
    "preisach diagnose stage.csv --effects aux:load_N --explore --report load",
    "preisach diagnose slow.csv fast.csv --hold-out other.csv --json > found.json",
    fits=True,
    reads=READING,
)
def diagnose(
    context: typer.Context,
    data: SeveralData,
    columns: ReadOptions,
    effects: Effects = None,
    levels: Levels = None,
    hold_out: HoldOut = None,
    tolerance: Annotated[
        str | None,
        typer.Option(
            metavar="SIZE",
            help="error that may be ignored: per cent of the stroke (0.1%), or with a unit (20nm)",
        ),
    ] = None,
    explore: Annotated[
        bool,
        typer.Option(
            "--explore",
            help="where no name fits, look for a form of what remains, sparse or else learned: "
            "a form, not a cause",
        ),
    ] = False,
    report: Annotated[Path, typer.Option(metavar="DIR", help="folder of the report")] = Path(
        "preisach-report"
    ),
    as_png: AsPng = False,
    force: Force = False,
) -> dict[str, Any]:
    """Find out which effects a plain hysteresis model lacks."""
    from preisach_jax.diagnosis import diagnose as run
    from preisach_jax.diagnosis import find_form
    from preisach_jax.files import check_folder
    from preisach_jax.report import diagnosis_names, write_report

    check_folder(report, [*data, *(hold_out or ())], diagnosis_names(report), force=force)
    names = effect_names(effects)
    check_choice(names, levels)
    records, apart = load_all(
        with_effects(columns, names), data, hold_out or (), screen.show_record
    )
    if names:  # a column that was asked for is tried as well
        names += [f"aux:{name}" for name in columns.get("aux", ()) if f"aux:{name}" not in names]
    own = context.obj["command"]
    share = 0.5 if explore else 1.0
    with screen.progress() as show:
        found = run(
            records,
            names or None,
            levels,
            hold_out=apart,
            tolerance=tolerance,
            progress=lambda text, done: show(text, share * done),
        )
        show("writing the report", 0.97 * share)
        write_report(found, report, command=own, as_png=as_png)
        if explore:  # the report without a form stays if this is interrupted
            form = find_form(
                found, progress=lambda text, done: show(text, share + (0.97 - share) * done)
            )
            show("writing the form into the report", 0.97)
            found = replace(found, form=form)
            write_report(found, report, command=own, as_png=as_png)
    screen.show_diagnosis(found)
    screen.say(f"\nReport: {report / 'report.html'}")
    return found.to_json()


@command(
    "preisach fit stage.csv --out model.json",
    "preisach fit stage.csv --effects creep,delay --levels 25 --out model.json",
    "preisach fit loop.csv --rate 2000 --input u --output z --out model.json",
    "preisach fit slow.csv fast.csv --effects creep --out model.json",
    fits=True,
    reads=READING,
)
def fit(
    data: SeveralData,
    columns: ReadOptions,
    out: Annotated[Path, typer.Option(metavar="FILE", help="where to write the model")],
    effects: Effects = None,
    levels: Levels = None,
    hold_out: HoldOut = None,
    force: Force = False,
) -> dict[str, Any]:
    """Fit a model with chosen effects, or with none."""
    from preisach_jax.files import check_file, json_bytes, write_files
    from preisach_jax.fit import fit as run

    check_file(out, *data, *(hold_out or ()), force=force)
    names = effect_names(effects)
    check_choice(names, levels)
    columns = with_effects(columns, names)
    records, apart = load_all(columns, data, hold_out or (), screen.show_record)
    with screen.progress() as show:
        show("fitting", 0.0)
        fitted = run(records, names, levels, hold_out=apart, progress=show)
    write_files({out: json_bytes(fitted.model.to_json())})
    screen.say(f"\n{fitted.summary()}\n\nModel: {out}")
    return fitted.model.to_json()


@command(
    "preisach predict model.json next.csv --out prediction.csv",
    "preisach predict model.json next.csv --input drive --out prediction.csv",
    reads=("time", "input", "aux", "rate", "unit", "initial_memory", "table"),
)
def predict(
    model: ModelFile,
    data: Data,
    columns: ReadOptions,
    out: Annotated[Path, typer.Option(metavar="FILE", help="where to write the prediction (CSV)")],
    force: Force = False,
) -> dict[str, Any]:
    """Predict the output of a record from its input alone."""
    from preisach_jax.files import check_file, write_files
    from preisach_jax.model import Model, past_sentence
    from preisach_jax.record import Record
    from preisach_jax.record.blemishes import torn_line

    check_file(out, data, model, force=force)
    loaded = Model.load(model)
    columns = with_columns_of(columns, loaded)
    record = Record.load(data, **{**columns, "need_output": False})
    if record.torn_row is not None:
        screen.note(f"{data}: {torn_line(record)}")
    prediction = loaded.predict(record)
    if past := past_sentence(loaded, record, prediction):
        screen.note(f"{data}: {past}")
    ratio = record.step_s / loaded.origin.step_s
    if not 0.5 <= ratio <= 2:
        screen.note(
            f"{data}: the median time step is {ratio:.3g} times that of the record on which the "
            "model was identified; the band z_low to z_high does not allow for that"
        )
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    names = ("t", "z_pred", "z_low", "z_high")
    writer.writerow(names)
    series = (record.time_values, prediction.output, prediction.low, prediction.high)
    writer.writerows(zip(*(values.tolist() for values in series), strict=True))
    write_files({out: text.getvalue().encode()})
    screen.say(f"{out}: {len(record.time):,} rows")
    return screen.written([out], columns=names, rows=len(record.time))


@command(
    "preisach simulate --out stage.csv",
    "preisach simulate --effects creep,drift --seconds 60 --out stage.csv",
    "preisach simulate --effects delay --out stage.csv --truth truth.json",
)
def simulate(
    out: Annotated[Path, typer.Option(metavar="FILE", help="where to write the record (CSV)")],
    effects: Effects = None,
    seed: Annotated[int, typer.Option(metavar="S", help="seed of the stage and its effects")] = 0,
    seconds: Annotated[float, typer.Option(metavar="T", help="duration in s")] = 24.0,
    rate: Annotated[float, typer.Option(metavar="HZ", help="sampling rate")] = 2000.0,
    truth: Annotated[
        Path | None, typer.Option(metavar="FILE", help="where to write the hidden effects (JSON)")
    ] = None,
    force: Force = False,
) -> dict[str, Any]:
    """Simulate a piezo stage with chosen effects."""
    from preisach_jax.files import check_file, is_same, write_files
    from preisach_jax.plant import simulate_stage

    check_file(out, force=force)
    if truth is not None:
        check_file(truth, force=force)
        if is_same(truth, out):
            raise InputError(f"{out} is both --out and --truth; give two files")
    stage = simulate_stage(seed, seconds, effect_names(effects), rate)
    write_files(stage_files(stage, out, truth))
    columns = ["t_s", "u_V", "z_um", *stage.aux]
    screen.say(f"{out}: {len(stage.time):,} rows of {', '.join(columns)}")
    if truth is not None:
        screen.say(f"{truth}: the hidden effects")
    files = [out] if truth is None else [out, truth]
    return screen.written(files, columns=columns, rows=len(stage.time))


def stage_files(stage: StageRecord, out: Path, truth: Path | None) -> dict[Path, bytes]:
    """A simulated record and its truth as the contents of files."""
    from preisach_jax.files import json_bytes, marked_csv

    contents = {} if truth is None else {truth: json_bytes(stage.truth)}
    with tempfile.TemporaryDirectory() as folder:
        whole = Path(folder) / "stage.csv"
        stage.save(whole)
        contents[out] = marked_csv(whole.read_bytes())
    return contents


@command("preisach effects", "preisach effects creep", "preisach effects --json")
def effects(
    name: Annotated[
        str | None,
        typer.Argument(
            metavar="[NAME]", help="show all about this one", autocompletion=complete_effect
        ),
    ] = None,
) -> Any:
    """List the library of effects, or show all about one."""
    from preisach_jax.effects import library, placeholder, resolve

    known = library()
    if name is None:
        screen.answer(" ".join(known))
        rows = [
            (
                effect.name + "*" * effect.on_request,
                effect.place,
                ", ".join(f"{p.name} ({_unit(p)})".replace(" ()", "") for p in _parameters(effect)),
                ", ".join(effect.confused_with) or "none",
            )
            for effect in known.values()
        ]
        screen.table(("effect", "acts on", "parameters", "confused with"), rows, numbers=False)
        screen.say(f"\n* tried only if asked for by name (--effects)\n{_UNITS}")
        screen.say("'preisach effects NAME' shows all about one")
        return [_about(effect) for effect in known.values()]
    name = placeholder(name)
    (effect,) = [known[name]] if name in known else resolve([name], {})
    screen.say(f"{effect.name}: acts on {effect.place.acts_on}\n")
    screen.say(effect.physics)
    screen.say(f"\nParameters ({_UNITS})")
    for parameter in _parameters(effect):
        unit = _unit(parameter)
        bounds = f"{parameter.low:.3g} to {parameter.high:.3g} {unit}".rstrip()
        if not math.isfinite(parameter.high - parameter.low):
            bounds = f"any value, in {unit}"
        screen.say(f"  {parameter.name}: {parameter.meaning} ({bounds})")
    screen.say(f"\nSeen in the residual as: {effect.signature}")
    screen.say(f"Confused with: {', '.join(effect.confused_with) or 'none'}")
    screen.say(f"Told apart by: {effect.experiment}")
    screen.say(f"Source: {effect.source}")
    if effect.on_request:
        screen.say(f"Tried only if asked for: --effects {effect.name},...")
    return _about(effect)


def _about(effect: Effect) -> dict[str, Any]:
    """All about an effect as data; `{u}`, `{z}` and `{aux}` in units stand for a record's own."""
    return {
        "name": effect.name,
        "place": effect.place,
        "physics": effect.physics,
        "parameters": [
            {
                "name": parameter.name,
                "unit": _unit(parameter) or "1",
                "low": parameter.low,
                "high": parameter.high,
                "meaning": parameter.meaning,
            }
            for parameter in _parameters(effect)
        ],
        "signature": effect.signature,
        "confused_with": list(effect.confused_with),
        "experiment": effect.experiment,
        "source": effect.source,
        "on_request": effect.on_request,
    }


_UNITS = "units: {u} is that of the input, {z} of the output, {aux} of the auxiliary column"


def _unit(parameter: Parameter) -> str:
    """A parameter's unit where there is no record yet to say what the placeholders are."""
    return "" if parameter.unit == "1" else parameter.unit.replace("/1", "/{aux}")


def _parameters(effect: Effect) -> list[Parameter]:
    return [*effect.parameters(), *getattr(effect, "coefficients", tuple)()]
