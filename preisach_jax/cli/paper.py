"""`preisach sweep` and `preisach figures`: the paper's noise sweep, and its figures."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from preisach_jax.cli import screen
from preisach_jax.cli.options import Force, numbers
from preisach_jax.cli.shared import Resume, command, named_by_option, resumable
from preisach_jax.errors import InputError

if TYPE_CHECKING:
    from preisach_jax.paper.sweep import Sweep

_EXPONENTS = {
    "paper": "norm (31) against W (29), switching samples",
    "paper_all_samples": "norm (31) against W (29), all samples",
    "truth": "what noise adds to ‖E‖² against its power",
}


_NAMES = ("levels", "noise", "seeds", "samples", "chunk")


@command(
    "preisach sweep --out sweep",
    "preisach sweep --levels 13,9 --seeds 4 --samples 20000 --out sweep",
    "preisach sweep --seeds 4096 --chunk 256 --out sweep",
)
def sweep(
    context: typer.Context,
    out: Annotated[
        Path, typer.Option(metavar="DIR", help="folder of the results; a sweep in it is resumed")
    ],
    levels: Annotated[
        str | None, typer.Option(metavar="N1,N2", help="levels of the planes [75,37,19,13,9]")
    ] = None,
    noise: Annotated[
        str | None,
        typer.Option(metavar="S1,S2", help="rms of known noise, µm [8 from 0.001 to 10]"),
    ] = None,
    seeds: Annotated[int, typer.Option(metavar="S", help="records of input and noise")] = 8,
    samples: Annotated[
        int, typer.Option(metavar="K", help="time steps of a record, at 2 kHz")
    ] = 50_000,
    seed: Annotated[int, typer.Option(metavar="KEY", help="draws all records")] = 0,
    chunk: Annotated[
        int, typer.Option(metavar="C", help="seeds that are computed together and then written")
    ] = 8,
    resume: Resume = True,
    force: Force = False,
) -> dict[str, Any]:
    """Measure how the residual error grows with noise, for several levels."""
    import jax

    from preisach_jax.devices import use_all_cores
    from preisach_jax.files import check_folder
    from preisach_jax.paper.sweep import LEVELS, NOISE_UM, RESULT, sweep_to_folder

    check_folder(out, [], [RESULT], force=force)
    use_all_cores()
    planes = LEVELS if levels is None else numbers("--levels", levels, int)
    powers = NOISE_UM if noise is None else numbers("--noise", noise, float)
    if not 0 <= seed < 2**63:
        raise InputError(f"--seed is {seed}: give a whole number of at least 0")
    settings = (jax.random.key(seed), planes, powers, seeds, samples, chunk, resume)
    with resumable(out, context.obj["command"]), screen.progress() as show:
        found = named_by_option(_NAMES, sweep_to_folder, out, *settings, show)
    show_sweep(found)
    screen.say(f"\nSweep: {out / RESULT}")
    return found.to_json()


def show_sweep(found: Sweep) -> None:
    """Print what a sweep found: a row for each plane, the exponents, and what they took."""
    columns = (
        found.delta_x, found.noise_power, found.mean_output_error(), found.auxiliary_norm(),
    )  # fmt: skip
    rows = [
        [str(N), str(found.cells[n]), str(int(found.events[n].mean())),
         *(f"{column[n]:.4g}" for column in columns),
         f"{found.coefficient[n]:.4g} ± {found.coefficient_error[n]:.2g}"]
        for n, N in enumerate(found.levels)
    ]  # fmt: skip
    headers = (
        "N",
        "L",
        "events",
        "δx (V)",
        "W (29) (µm²)",
        "⟨e⟩ (30) (µm)",
        "norm (31) (µm)",
        "coefficient",
    )
    screen.table(headers, rows)
    screen.say(
        "\ncoefficient: what noise adds to ⟨‖E‖²⟩ over its power, where the truth is known, ± its "
        "standard error"
    )
    laws = [
        (_EXPONENTS[name], f"{law.value:.3f}", f"{law.low:.3f} to {law.high:.3f}",
         f"{law.r_squared:.4f}", f"{law.correlation:.4f}")
        for name, law in found.exponents().items()
    ]  # fmt: skip
    short = [str(N) for N in found.levels[found.unsettled]]
    if short:
        screen.say(
            f"N = {', '.join(short)}: a record has fewer events than cells, and the initial "
            f"error dominates; take more --samples"
        )
    if not laws:
        screen.say("There are too few points for exponents: take more --levels or --noise.")
    else:
        screen.say()
        screen.table(("exponent (1 is proportional)", "found", "95 %", "R²", "correlation"), laws)
    screen.say(
        f"\n{len(found.seeds)} seeds of {found.samples:,} samples on {found.device}: compiled in "
        f"{found.compile_s:.1f} s, run in {found.run_s:.1f} s"
    )


@command("preisach figures --out figures", "preisach figures --only 4,8 --quick --out figures")
def figures(
    out: Annotated[Path, typer.Option(metavar="DIR", help="folder of the figures")],
    only: Annotated[
        str | None, typer.Option(metavar="4,8", help="numbers of figures, by commas; else all")
    ] = None,
    quick: Annotated[
        bool, typer.Option("--quick", help="short records: a preview, not the published result")
    ] = False,
    force: Force = False,
) -> dict[str, Any]:
    """Draw the figures of the paper, and those that go further."""
    from preisach_jax.devices import use_all_cores
    from preisach_jax.files import check_folder
    from preisach_jax.plot.paper import figure_names
    from preisach_jax.plot.paper import figures as run

    chosen = None if only is None else [str(number) for number in numbers("--only", only, int)]
    check_folder(out, [], figure_names(chosen, quick), force=force)
    use_all_cores()
    with screen.progress() as show:
        written = run(out, chosen, quick, show)
    screen.say(f"Figures: {out}, {len(written)} files")
    return screen.written(written)
