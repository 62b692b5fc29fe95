"""`preisach design`: what to record next, computed from the models of a report."""

from __future__ import annotations

import json
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from preisach_jax.cli import screen
from preisach_jax.cli.options import Force
from preisach_jax.cli.shared import command
from preisach_jax.errors import InputError, require_positive

if TYPE_CHECKING:
    from preisach_jax.model import Model

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
