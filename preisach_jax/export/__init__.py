"""Models outside of Python: as C99 for a controller, as an FMU for a simulation."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from preisach_jax.export.c import files
from preisach_jax.export.compiler import run_self_test
from preisach_jax.export.fmu import fmu_archive, fmu_name
from preisach_jax.files import check_folder, write_files
from preisach_jax.model import Model

__all__ = ["C_FILES", "export_c", "export_fmu", "fmu_name"]

C_FILES = ("preisach_model.h", "preisach_model.c", "preisach_test.c", "Makefile", "README.md")


def export_c(
    model: Model, folder: Path | str, rate_hz: float | None = None, without: Sequence[str] = ()
) -> list[Path]:
    """Write a model as C99 with a self test, a Makefile and a README.

    Where there is a C compiler, the self test is run before anything is written; the README says
    what came of it.

    Arguments:
        model: the model.
        folder: where to; it is made if it does not exist.
        rate_hz: sampling rate in Hz; by default that of the record on which it was identified.
        without: names of effects that are left out.

    Returns:
        The files: `preisach_model.h`, `preisach_model.c`, `preisach_test.c`, `Makefile` and
        `README.md`.

    Raises:
        InputError: if the model cannot be written in C, or the folder
            cannot be written to; then nothing was.
        RuntimeError: if the self test fails, which is a fault of this package; nothing was written.

    Example:
        >>> import tempfile, numpy as np, preisach_jax as pj
        >>> t = np.arange(3000) / 100
        >>> u = 5 - 5 * np.cos(t * (1 + t / 40))
        >>> model = pj.fit(pj.Record.from_arrays(t, u, u**1.1), levels=9).model
        >>> with tempfile.TemporaryDirectory() as folder:
        ...     print(*(path.name for path in export_c(model, folder)))
        preisach_model.h preisach_model.c preisach_test.c Makefile README.md
    """
    folder = Path(folder)
    check_folder(folder)
    contents = files(model, rate_hz, without, run_self_test)
    return write_files({folder / name: text.encode() for name, text in contents.items()})


def export_fmu(
    model: Model, folder: Path | str, rate_hz: float | None = None, without: Sequence[str] = ()
) -> list[Path]:
    """Write a model as an FMU of FMI 3.0 for co-simulation.

    Its inputs and its output are named as the columns of the record, with their units. It takes a
    sample in at each multiple of the sample interval, whatever the communication step; see
    `sources/fmi3_functions.c` in it.

    Arguments:
        model: the model.
        folder: where to; it is made if it does not exist.
        rate_hz: sampling rate in Hz; by default that of the record on which it was identified.
        without: names of effects that are left out.

    Returns:
        The file, named after the record.

    Raises:
        InputError: if the model cannot be written in C, there is no C compiler, or the folder
            cannot be written to; then nothing was.
        RuntimeError: if the self test fails, which is a fault of this package; nothing was written.

    Example:
        >>> export_fmu(model, "simulation")  # doctest: +SKIP
    """
    folder = Path(folder)
    check_folder(folder)
    archive = fmu_archive(model, rate_hz, without)
    files(model, rate_hz, without, run_self_test)  # of the code that the binary was built from
    return write_files({folder / fmu_name(model): archive})
