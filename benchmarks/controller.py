"""Count the instructions that a sample of the generated C takes on a Cortex-M4.

    python benchmarks/controller.py

The code is compiled for a Cortex-M4 with its unit for single precision, and runs in the emulator of
QEMU as the package Unicorn has it, which counts every instruction. Needs Debian's
`gcc-arm-none-eabi` and `libnewlib-arm-none-eabi`, and `pip install unicorn`. Outputs are compared
with `Model.predict`. Most instructions take one cycle, loads two, a division 14; waiting for flash
memory comes on top, and is the controller's own.
"""

from __future__ import annotations

import shutil
import struct
import subprocess
import sys
import tempfile
from pathlib import Path

import jax
import numpy as np
from common import write_results

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "tests"))
from exported import HIGH, LOW, drawn, predicted, smooth, wild

from preisach_jax.export.c import sources
from preisach_jax.export.description import describe
from preisach_jax.signals import bernoulli_ramp

HERE = Path(__file__).parent
RATE_HZ = 5000
CODE, STACK, MEMORY, RETURN = 0x10000, 0x8000, 1 << 20, 0xF0000
FLAGS = ["-O2", "-mcpu=cortex-m4", "-mthumb", "-mfpu=fpv4-sp-d16", "-mfloat-abi=hard"]
CHAINS = {
    "hysteresis": [],
    "with creep and an amplifier's lag": ["creep", "input_lag"],
    "with creep, rate dependence and a resonance": ["creep", "rate_corners_all", "resonance"],
}
FUNCTIONS = ("step", "inverse", "adapt")


class Controller:
    """A model on an emulated Cortex-M4."""

    def __init__(self, model, folder: Path) -> None:
        from unicorn import UC_ARCH_ARM, UC_HOOK_CODE, UC_MODE_MCLASS, UC_MODE_THUMB, Uc
        from unicorn.arm_const import UC_CPU_ARM_CORTEX_M4

        for name, text in sources(describe(model)).items():
            (folder / name).write_text(text)
        program = folder / "program.elf"
        files = [HERE / "controller.c", folder / "preisach_model.c"]
        ends = ["-nostartfiles", "-specs=nosys.specs", f"-Wl,-Ttext={CODE:#x},-e,start", "-lm"]
        command = ["arm-none-eabi-gcc", *FLAGS, "-std=c99", "-DPREISACH_FLOAT", f"-I{folder}"]
        subprocess.run([*command, *files, "-o", program, *ends], check=True, capture_output=True)
        binary = folder / "program.bin"
        subprocess.run(["arm-none-eabi-objcopy", "-O", "binary", program, binary], check=True)
        names = subprocess.run(
            ["arm-none-eabi-nm", program], check=True, capture_output=True, text=True
        ).stdout
        self.at = {row.split()[2]: int(row.split()[0], 16) for row in names.splitlines()}
        sizes = subprocess.run(
            ["arm-none-eabi-size", program], check=True, capture_output=True, text=True
        ).stdout.splitlines()[1].split()  # fmt: skip
        self.flash, self.memory = int(sizes[0]) + int(sizes[1]), int(sizes[1]) + int(sizes[2])

        self.cpu = Uc(UC_ARCH_ARM, UC_MODE_THUMB | UC_MODE_MCLASS)
        self.cpu.ctl_set_cpu_model(UC_CPU_ARM_CORTEX_M4)
        self.cpu.mem_map(0, MEMORY)
        self.cpu.mem_write(CODE, binary.read_bytes())
        self.cpu.mem_map(0xE000E000, 0x1000)
        self.count = 0
        self.cpu.hook_add(UC_HOOK_CODE, self._counted)
        self.call("start")

    def _counted(self, *_) -> None:
        self.count += 1

    def call(self, name: str) -> int:
        """Instructions of one call."""
        from unicorn.arm_const import UC_ARM_REG_LR, UC_ARM_REG_SP

        self.count = 0
        self.cpu.reg_write(UC_ARM_REG_SP, STACK)
        self.cpu.reg_write(UC_ARM_REG_LR, RETURN | 1)
        self.cpu.emu_start(self.at[name] | 1, RETURN)
        return self.count

    def put(self, name: str, value: float) -> None:
        """Write one of the variables of `controller.c`."""
        self.cpu.mem_write(self.at[name], struct.pack("<f", value))

    def found(self) -> float:
        """The last output."""
        return struct.unpack("<f", self.cpu.mem_read(self.at["found"], 4))[0]


def counted(names: list[str], levels: int, samples: int) -> dict:
    """Instructions a sample of one model, and how far its outputs are from `predict`."""
    model = drawn(names, 1, levels, "ramp")
    ramp = np.asarray(bernoulli_ramp(jax.random.key(37), samples, RATE_HZ, high=1.0))
    courses = {
        "ramp": LOW + (HIGH - LOW) * ramp,
        "smooth": smooth(samples, 3),
        "wild": wild(samples, 1),
    }
    rows: dict = {function: {} for function in FUNCTIONS}
    worst = 0.0
    with tempfile.TemporaryDirectory() as folder:
        controller = Controller(model, Path(folder))
        for course, u in courses.items():
            z = predicted(model, u, [])
            for function in FUNCTIONS:
                controller.call("start")
                counts, outputs = [], []
                for k in range(samples):
                    controller.put("given", z[k] if function == "inverse" else u[k])
                    controller.put("measured", z[k])
                    counts.append(controller.call(function))
                    outputs.append(controller.found())
                if function == "step":
                    worst = max(worst, float(np.max(np.abs(outputs - z)[1:]) / np.ptp(z)))
                rows[function][course] = {"median": float(np.median(counts)), "most": max(counts)}
    return {
        "effects": names,
        "levels": levels,
        "flash_bytes": controller.flash,
        "memory_bytes": controller.memory,
        "worst_difference": worst,
        "instructions": rows,
    }


def main(samples: int = 300) -> None:
    """Count, print, and write the figures."""
    if not shutil.which("arm-none-eabi-gcc"):
        sys.exit("no arm-none-eabi-gcc: install gcc-arm-none-eabi and libnewlib-arm-none-eabi")
    rows = []
    for name, effects in CHAINS.items():
        for levels in (9, 37):
            rows.append({"name": name} | counted(effects, levels, samples))
            print(name, levels, rows[-1]["instructions"], flush=True)
    compiler = subprocess.run(
        ["arm-none-eabi-gcc", "--version"], check=True, capture_output=True, text=True
    ).stdout.splitlines()[0]
    write_results(
        "controller.json",
        {"controller": "Cortex-M4F, emulated", "compiler": compiler, "rate_hz": RATE_HZ,
         "samples": samples, "rows": rows},
    )  # fmt: skip


if __name__ == "__main__":
    main()
