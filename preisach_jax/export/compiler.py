"""This platform's C compiler: the binary of an FMU, and the self test of generated C."""

from __future__ import annotations

import os
import shutil
import subprocess  # noqa: TID251
import tempfile
from collections.abc import Mapping, Sequence
from pathlib import Path

from preisach_jax.errors import InputError

PROGRAM = "compiled"


def compiler() -> str | None:
    """The C compiler: `$CC`, cc, gcc or clang."""
    asked = [os.environ.get("CC", ""), "cc", "gcc", "clang"]
    return next((found for name in asked if name and (found := shutil.which(name))), None)


def compiled(texts: Mapping[str, str], options: Sequence[str], folder: str) -> Path:
    """The program or library of some sources, in a folder."""
    found = compiler()
    if found is None:
        raise InputError(
            "there is no C compiler (looked for $CC, cc, gcc, clang), and an FMU holds a binary of "
            "this platform: install one, or take --to c"
        )
    for name, text in texts.items():
        Path(folder, Path(name).name).write_text(text, encoding="utf-8")
    sources = [Path(name).name for name in texts if name.endswith(".c")]
    done = subprocess.run(
        [found, "-std=c99", *options, "-o", PROGRAM, *sources, "-lm"],
        cwd=folder, capture_output=True, text=True, check=False,
    )  # fmt: skip
    if done.returncode:
        first = (done.stderr.strip() or "no message").splitlines()[0]
        raise InputError(
            f"the C compiler {found} fails ({first}): set CC to another one, or take --to c"
        )
    return Path(folder, PROGRAM)


def run_self_test(texts: Mapping[str, str]) -> str:
    """Build and run the self test of generated C in both precisions."""
    if compiler() is None:
        return "was not run, since there was no C compiler where the code was written"
    for option in ("-DPREISACH_DOUBLE", "-DPREISACH_FLOAT"):
        with tempfile.TemporaryDirectory() as folder:
            try:
                program = compiled(texts, ["-O1", option], folder)
            except InputError as error:
                return f"was not run: {error}"
            done = subprocess.run([program], capture_output=True, text=True, check=False)
        if done.returncode:
            said = "; ".join(done.stdout.split("\n")) or f"exit code {done.returncode}"
            raise RuntimeError(
                f"the self test of the generated C fails with {option}, and nothing was written: "
                f"{said} (please report this with the model file)"
            )
    return "was run when the code was written, and passed in both precisions"
