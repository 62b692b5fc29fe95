"""Long runs of the generated C: jitter at rest, and samples that are no numbers.

    python benchmarks/endurance.py --jitter 1000000000 --fuzz 2000000

At rest with jitter inside some cells the output must come back to the bit; 10⁹ samples are 11 hours
at 25 kHz.  The fuzzed runs call all functions with NaN, infinities, numbers out of range and tiny
ones in turn, built with the address and undefined-behaviour sanitizers of gcc, and of clang where
it is installed; after each call the output must be finite and the memory within its bounds.
Writes `benchmarks/results/endurance.json`.
"""

from __future__ import annotations

import argparse
import json
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

from conditions import write_results

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "tests"))
from exported import STRICT, drawn

from preisach_jax.export.c import sources
from preisach_jax.export.description import describe

PRECISIONS = ("DOUBLE", "FLOAT")
CHAINS = (
    [],
    ["creep", "input_lag"],
    ["rate_corners", "resonance", "hum"],
    ["rate_smooth", "eddy_currents", "delay", "ripples"],
    ["operator_creep", "reptation", "moving", "slew_limit", "output_lag", "drift", "ageing"],
)


def written(names: list[str], hysteron: str, levels: int, folder: str) -> None:
    """The code of a model in a folder."""
    for name, text in sources(describe(drawn(names, 1, levels, hysteron))).items():
        Path(folder, name).write_text(text)


def jittered(hysteron: str, precision: str, samples: int) -> dict:
    """A long rest with jitter of a model of 37 levels."""
    with tempfile.TemporaryDirectory() as folder:
        written([], hysteron, 37, folder)
        own = [str(Path(__file__).with_name("jitter.c")), "preisach_model.c", "-lm"]
        build = ["gcc", "-O2", "-std=c99", f"-DPREISACH_{precision}", "-I.", "-o", "jitter", *own]
        subprocess.run(build, check=True, cwd=folder)
        done = subprocess.run(
            ["./jitter", str(samples)], check=True, cwd=folder, capture_output=True, text=True
        )
    about = {"hysteron": hysteron, "precision": precision.lower(), "samples": samples}
    return about | json.loads(done.stdout)


def fuzzed(names: list[str], hysteron: str, precision: str, compiler: str, samples: int) -> dict:
    """A run with odd samples under the sanitizers."""
    flags = ["-O1", "-g", "-fsanitize=address,undefined", "-fno-sanitize-recover=all"]
    with tempfile.TemporaryDirectory() as folder:
        written(names, hysteron, 9, folder)
        fuzz = Path(__file__).with_name("nonsense.c").read_text()
        Path(folder, "fuzz.c").write_text(fuzz)
        define = f"-DPREISACH_{precision}"
        strict = [compiler, *STRICT, define, "-c", "-O2", "preisach_model.c", "-o", "strict.o"]
        subprocess.run(strict, check=True, cwd=folder)
        flags += [define, f"-DSAMPLES={samples}"]
        build = [compiler, "-std=c99", *flags, "fuzz.c", "preisach_model.c", "-o", "fuzz"]
        subprocess.run([*build, "-lm"], check=True, cwd=folder)
        done = subprocess.run(["./fuzz"], cwd=folder, capture_output=True, text=True, check=False)
    about = {"effects": names, "hysteron": hysteron, "precision": precision.lower()}
    told = (done.stdout + done.stderr)[-500:] if done.returncode else ""
    return about | {
        "compiler": compiler, "samples": samples, "whole": done.returncode == 0, "told": told
    }  # fmt: skip


def main() -> None:
    """Run, print, and write what came of it."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("--jitter", type=int, default=10**8)
    parser.add_argument("--fuzz", type=int, default=200_000)
    given = parser.parse_args()
    rests, fuzz = [], []
    for hysteron in ("relay", "ramp"):
        for precision in PRECISIONS:
            rests.append(jittered(hysteron, precision, given.jitter))
            print(rests[-1], flush=True)
    compilers = [name for name in ("gcc", "clang") if shutil.which(name)]
    for names in CHAINS:
        for hysteron in ("relay", "ramp"):
            for precision in PRECISIONS:
                for compiler in compilers:
                    fuzz.append(fuzzed(names, hysteron, precision, compiler, given.fuzz))
                    print(fuzz[-1], flush=True)
    versions = {
        name: subprocess.run(
            [name, "--version"], capture_output=True, text=True, check=True
        ).stdout.splitlines()[0]
        for name in compilers
    }
    write_results(
        "endurance.json",
        {
            "compilers": versions,
            "rests": rests,
            "rests_that_came_back": sum(row["moved"] == 0 for row in rests),
            "fuzzed": fuzz,
            "fuzzed_whole": sum(row["whole"] for row in fuzz),
        },
    )


if __name__ == "__main__":
    main()
