"""Preisach hysteresis: fit it to a record, find the effect that is missing, predict."""

from __future__ import annotations

import csv
import io
import json
import math
import tempfile
from collections.abc import Sequence
from dataclasses import replace
from importlib.metadata import version
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from preisach_jax.cli import screen
from preisach_jax.cli.completion import complete_effect
from preisach_jax.cli.options import (
    READING,
    AsPng,
    Aux,
    Data,
    Effects,
    Force,
    HoldOut,
    Levels,
    ModelFile,
    Output,
    Rate,
    SeveralData,
    Time,
    Unit,
    check_choice,
    effect_names,
    load_all,
    numbers,
    units_by_column,
    with_columns_of,
    with_effects,
)
from preisach_jax.cli.shared import command
from preisach_jax.errors import InputError, require_positive

if TYPE_CHECKING:
    from preisach_jax.diagnosis.comparison import Comparison
    from preisach_jax.effects.base import Effect, Parameter
    from preisach_jax.model import Model
    from preisach_jax.plant import StageRecord
    from preisach_jax.record.columns import ReadOptions


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
            help="where no name fits, look for a form of what remains: a form, not a cause",
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
        searching = screen.of_a_diagnosis(lambda text, done: show(text, share * done))
        found = run(
            records, names or None, levels, hold_out=apart, tolerance=tolerance, progress=searching
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
    from preisach_jax.record.blemishes import torn_line
    from preisach_jax.record.core import Record

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


@command(
    "preisach compare model.json other.csv",
    "preisach compare model.json other.csv --initial-memory low --report other",
    "preisach compare model.json monday.csv tuesday.csv wednesday.csv",
    "preisach compare base.json model.json other.csv --json",
    reads=READING,
)
def compare(
    context: typer.Context,
    model: ModelFile,
    data: Data,
    columns: ReadOptions,
    others: Annotated[
        list[Path] | None,
        typer.Argument(
            metavar="[MORE]...", help="further records, or further models before one record"
        ),
    ] = None,
    report: Annotated[Path, typer.Option(metavar="DIR", help="folder of the report")] = Path(
        "preisach-comparison"
    ),
    as_png: AsPng = False,
    force: Force = False,
) -> dict[str, Any]:
    """Test a model against records, or several models against one."""
    from preisach_jax.files import check_folder
    from preisach_jax.report import comparison_names

    models, records = _sorted([model, data, *(others or ())])
    several = len(models) + len(records) > 2
    check_folder(report, [*models, *records], comparison_names(several), force=force)
    pairs = [(one, record) for one in models for record in records]
    found = {
        label: _compared(*pair, columns)
        for label, pair in zip(_labels(models, records), pairs, strict=True)
    }
    how = {"command": context.obj["command"], "as_png": as_png}
    if len(found) == 1:
        return _show_one(next(iter(found.values())), report, how)
    return _show_several(found, report, how)


def _sorted(paths: Sequence[Path]) -> tuple[list[Path], list[Path]]:
    """The models, first of all what stands first, and the records."""
    first, *others = paths
    models = [first, *(path for path in others if path.suffix.lower() == ".json")]
    records = [path for path in others if path.suffix.lower() != ".json"]
    if not records:
        raise InputError(
            f"{', '.join(map(str, paths))}: there is no record among them; give one after the "
            f"models, as in 'preisach compare base.json model.json stage.csv'"
        )
    if len(models) > 1 and len(records) > 1:
        raise InputError(
            f"{len(models)} models and {len(records)} records; give several records for one model, "
            "or several models for one record"
        )
    return models, records


def _labels(models: Sequence[Path], records: Sequence[Path]) -> list[str]:
    """What each comparison is called: the name of its file, or its path where names are alike."""
    varied = models if len(models) > 1 else records
    names = [path.name for path in varied]
    labels = names if len(set(names)) == len(names) else [str(path) for path in varied]
    if len(set(labels)) < len(labels):
        twice = next(label for label in labels if labels.count(label) > 1)
        raise InputError(f"{twice} is given {labels.count(twice)} times; give each file once")
    return labels


def _compared(model: Path, data: Path, columns: ReadOptions) -> Comparison:
    from preisach_jax.diagnosis.comparison import compare as run
    from preisach_jax.model import Model
    from preisach_jax.record.core import Record

    loaded = Model.load(model)
    notes: list[str] = []
    columns = with_columns_of(columns, loaded)
    record = Record.load(data, **{**columns, "announce": notes.append})
    screen.show_record(record, notes)
    return run(loaded, record)


def _show_one(comparison: Comparison, report: Path, how: dict[str, Any]) -> dict[str, Any]:
    from preisach_jax.report import write_comparison
    from preisach_jax.report.content import comparison_sentence, error_rows, test_rows

    write_comparison(comparison, report, **how)
    sentence = comparison_sentence(comparison)
    screen.answer(sentence)
    screen.say("\n".join(["", sentence, *comparison.notes, ""]))
    screen.table(("", "value"), error_rows(comparison))
    screen.say()
    screen.table(("test of the residual", "found", "expected"), test_rows(comparison))
    screen.say(f"\nReport: {report / 'report.html'}")
    return comparison.to_json()


def _show_several(
    found: dict[str, Comparison], report: Path, how: dict[str, Any]
) -> dict[str, Any]:
    from preisach_jax.report import comparisons_json, write_comparisons
    from preisach_jax.report.content import HEADERS, several_rows, several_sentence

    write_comparisons(found, report, **how)
    sentence = several_sentence(found)
    screen.answer(sentence)
    screen.say(f"\n{sentence}\n")
    screen.table(HEADERS, several_rows(found))
    screen.say(f"\nReport: {report / 'report.html'}")
    return comparisons_json(found)


_AGAIN = "write the report again with 'preisach diagnose'"


@command(
    "preisach design preisach-report",
    "preisach design report --seconds 30 --rate-limit 200 --out next.csv",
)
def design(
    report: Annotated[Path, typer.Argument(metavar="REPORT", help="folder of a diagnosis")],
    out: Annotated[
        Path, typer.Option(metavar="FILE", help="where to write the excitation (CSV)")
    ] = Path("next.csv"),
    seconds: Annotated[
        float | None, typer.Option(metavar="T", help="duration in s; else that of the record")
    ] = None,
    rate_limit: Annotated[
        float | None,
        typer.Option(metavar="V_PER_S", help="greatest rate of the input; else the record's own"),
    ] = None,
    force: Force = False,
) -> dict[str, Any]:
    """Choose what to record next, so that it tells the effects of a family apart."""
    from preisach_jax.diagnosis.design import design as run
    from preisach_jax.diagnosis.design import design_csv
    from preisach_jax.files import check_file, marked_csv, write_files

    given = {"--seconds": seconds, "--rate-limit": rate_limit}
    require_positive(**{name: value for name, value in given.items() if value is not None})
    noise, rivals = _read(report)
    models = _models(report, rivals)
    check_file(out, report / "diagnosis.json", *models, force=force)
    named, *others = models.values()
    with screen.progress() as show:
        plan = run(
            [named, *others],
            noise or named.rms_validation,
            seconds=seconds,
            rate_limit=rate_limit,
            progress=show,
        )
    write_files({out: marked_csv(design_csv(plan))})
    if plan.separations:
        screen.say(
            "Held-out error of the wrong model divided by that of the right one, both refitted; "
            "the first of each row is true\n"
        )
        screen.table(("", *plan.separations), plan.rows())
        screen.say()
    screen.say(f"{plan.excitation}: {plan.text}\n\nWhy: {plan.why}.\n")
    screen.say(f"{out}: {len(plan.time):,} rows")
    return screen.written(
        [out],
        rows=len(plan.time),
        excitation=plan.excitation,
        text=plan.text,
        why=plan.why,
        separations=plan.separations,
        sufficient=plan.sufficient,
    )


def _read(report: Path) -> tuple[float, list[str]]:
    """Noise and discretisation of a report, which no model removes, and its rivals' names."""
    path = report / "diagnosis.json"
    if not path.is_file() or not (report / "model.json").is_file():
        raise InputError(
            f"{report}: this folder holds no diagnosis.json and model.json; give the one that "
            "'preisach diagnose --report' has written"
        )
    try:
        found = json.loads(path.read_text(encoding="utf-8"))
        families = [list(finding["family"]) for finding in found["findings"]]
        shares = [found["budget"][name] or 0.0 for name in ("noise", "discretisation")]
        noise = sum(share**2 for share in shares) ** 0.5
    except (ValueError, KeyError, TypeError) as error:
        raise InputError(
            f"{path}: the diagnosis is damaged ({type(error).__name__}: {error}); {_AGAIN}"
        ) from error
    return noise, [str(name) for family in families for name in family[1:]]


def _models(report: Path, rivals: list[str]) -> dict[Path, Model]:
    """The models of a report by their files, first the one with all findings."""
    from preisach_jax.files import file_name
    from preisach_jax.model import Model

    files = {report / "alternatives" / f"{file_name(name)}.json": name for name in rivals}
    for path, name in files.items():
        if not path.is_file():
            raise InputError(f"{path}: the model with {name} is missing; {_AGAIN}")
    models = {path: Model.load(path) for path in (report / "model.json", *files)}
    for path, name in files.items():
        if name not in [effect.name for effect in models[path].effects]:
            raise InputError(f"{path}: this model lacks {name}, after which it is named; {_AGAIN}")
    return models


@command(
    "preisach compensate model.json wanted.csv --out drive.csv",
    "preisach compensate model.json wanted.csv --out drive.csv --limits 0,60",
    "preisach compensate model.json wanted.csv --out drive.csv --after played.csv",
)
def compensate(
    model: ModelFile,
    wanted: Annotated[
        Path, typer.Argument(metavar="WANTED", help="a file with time and wanted output")
    ],
    out: Annotated[Path, typer.Option(metavar="FILE", help="where to write the drive (CSV)")],
    after: Annotated[
        Path | None,
        typer.Option(
            metavar="RECORD",
            help="record of what was played before; it sets the memory; default: the (last) "
            "fitted record",
        ),
    ] = None,
    limits: Annotated[
        str | None,
        typer.Option(metavar="LOW,HIGH", help="limits of the drive; default: the model's range"),
    ] = None,
    slew: Annotated[
        float | None, typer.Option(metavar="MAX", help="maximum slew rate of the drive, per s")
    ] = None,
    time: Time = None,
    output: Output = None,
    aux: Aux = None,
    rate: Rate = None,
    unit: Unit = None,
    force: Force = False,
) -> dict[str, Any]:
    """Find the input that makes the output follow a wanted course."""
    from preisach_jax.compensation import compensate as run
    from preisach_jax.compensation.drive import COLUMNS, drive_csv, wanted_course
    from preisach_jax.files import check_file, write_files
    from preisach_jax.model import Model
    from preisach_jax.record.core import Record
    from preisach_jax.record.reading import read_table

    check_file(out, wanted, model, *([] if after is None else [after]), force=force)
    bounds = None if limits is None else numbers("--limits", limits, float)
    loaded = Model.load(model)
    course = wanted_course(
        loaded, read_table(wanted), wanted.name, time=time, output=output, aux=aux or (), rate=rate,
        units=units_by_column(unit or ()),
    )  # fmt: skip
    past = None
    if after is not None:
        columns = with_columns_of({"aux": tuple(aux or ())}, loaded)
        past = Record.load(after, **{**columns, "need_output": False})
    found = run(loaded, course, after=past, limits=bounds, slew=slew)
    write_files({out: drive_csv(found)})
    for sentence in found.notes:
        screen.note(f"{wanted}: {sentence}")
    screen.say(f"{out}: {len(found.time):,} rows")
    lost = int((~found.reachable).sum())
    return screen.written(
        [out], columns=COLUMNS, rows=len(found.time), unreachable=lost, notes=found.notes
    )


KINDS = ("c", "fmu")


@command(
    "preisach export model.json --to c --out controller",
    "preisach export model.json --to c --without drift --out controller",
    "preisach export model.json --to fmu --out simulation",
)
def export(
    model: ModelFile,
    to: Annotated[str, typer.Option("--to", metavar="c|fmu", help="C99, or FMI 3.0 co-simulation")],
    out: Annotated[Path, typer.Option(metavar="DIR", help="folder to write into")],
    rate: Annotated[
        float | None,
        typer.Option("--rate", metavar="HZ", help="sampling rate; else that of the record"),
    ] = None,
    without: Annotated[
        str | None, typer.Option("--without", metavar="A,B", help="effects to leave out, by commas")
    ] = None,
    force: Force = False,
) -> dict[str, Any]:
    """Write a model as C code or as an FMU."""
    from preisach_jax.export import C_FILES, export_c, export_fmu, fmu_name
    from preisach_jax.files import check_folder
    from preisach_jax.model import Model

    if to not in KINDS:
        raise InputError(f"--to is {to!r}; give one of {', '.join(KINDS)}")
    check_folder(out, [model], C_FILES if to == "c" else (), force=force)
    left_out = effect_names(without)
    loaded = Model.load(model)
    if to == "fmu":
        check_folder(out, [model], [fmu_name(loaded)], force=force)
    write = export_c if to == "c" else export_fmu
    files = write(loaded, out, rate, left_out)
    for path in files:
        screen.say(str(path))
    if to == "c":
        screen.say(f"\n'make -C {out}' builds and runs the self test")
    return screen.written(files, rate_hz=rate or 1 / loaded.origin.step_s, without=left_out)


@command("preisach app", "preisach app stage.csv --port 5006")
def app(
    data: Annotated[
        Path | None, typer.Argument(metavar="[DATA]", help="a file to begin with")
    ] = None,
    port: Annotated[
        int, typer.Option(metavar="PORT", help="where to listen; 0: any that is free")
    ] = 0,
    address: Annotated[
        str, typer.Option(metavar="IP", help="interface to listen on; others can then see the page")
    ] = "127.0.0.1",
    browser: Annotated[bool, typer.Option(help="open a browser")] = True,
) -> dict[str, Any]:
    """Look at a record, add what its model lacks, in a page on this machine."""
    if data is not None and not data.is_file():
        raise InputError(f"{data}: there is no such file; check the path")
    if missing := [name for name in ("bokeh", "panel") if find_spec(name) is None]:
        raise InputError(
            f"the page needs {' and '.join(missing)}; install with pip install 'preisach_jax[app]'"
        )
    from preisach_jax.app.server import PageServer

    server = PageServer(data, port=port, address=address)
    if server.is_open:
        screen.note(
            f"Warning: from other machines, too, this page can be reached at {address}, and what "
            "it sends is not encrypted. It asks for the token in its address: tell it nobody else."
        )
    screen.note(f"{server.url} (Ctrl-C ends it)")
    screen.answer(server.url)
    server.run(show=browser)
    return {"address": server.url}
