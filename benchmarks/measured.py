"""Diagnose five measured records, and set what a physicist would say beside it.

    python benchmarks/measured.py FOLDER

FOLDER holds the records (their makers, licences and sources are in `RECORDS`; they are not part
of this project).  Writes `benchmarks/results/measured.json` with device, versions and date.
"""

from __future__ import annotations

import sys
import time
from dataclasses import dataclass
from pathlib import Path

from conditions import write_results

import preisach_jax as pj
from preisach_jax.quantity import quantity


@dataclass(frozen=True)
class Measured:
    """A measured record.

    Attributes:
        file: its name.
        source: whose it is, and its licence.
        units: of its columns x and z.
        aux: columns that may act as well.
        physics: what a physicist expects to be missing, before any diagnosis.
    """

    file: str
    source: str
    units: dict[str, str]
    physics: str
    aux: tuple[str, ...] = ()


DAMPER = "DanielMaurelE/vRTHS_AMBC_MRdamper @08753ff, MIT"
RECORDS = (
    Measured(
        "mrdamper_mts_5mm3Hz.csv",
        DAMPER,
        {"x": "mm", "z": "N"},
        "force goes with velocity (viscous and yield force), and the coil current sets the width "
        "of the loop: a gain, not a sum",
        ("current_A",),
    ),
    Measured(
        "mrdamper_mts_25mm0x5Hz.csv",
        DAMPER,
        {"x": "mm", "z": "N"},
        "as above, at a sixth of the frequency and five times the stroke",
        ("current_A",),
    ),
    Measured(
        "faster_beam_force_disp.csv",
        "decargroup/system_norm_koopman @a9509b8 (data: NRC Canada), MIT",
        {"x": "1", "z": "m"},
        "no hysteresis to speak of: a first-order lag of some 50 ms",
    ),
    Measured(
        "fsm_piezo_300mV.csv",
        "merijnfloren/fsm-benchmark-data @539a12f (M. Floren, KU Leuven), CC BY 4.0",
        {"x": "V", "z": "m"},
        "several modes between 0.6 and 2.5 kHz, a delay, and two other axes that leak in",
        ("u1", "u2"),
    ),
    Measured(
        "forc_feco_nanowire.csv",
        "peytondmurray/pyforc @abc3ffb, MIT",
        {"x": "T", "z": "A·m²"},
        "nothing but scatter of 0.3 %",
    ),
)


def diagnosed(measured: Measured, folder: Path) -> dict:
    """What the diagnosis says of one record."""
    record = pj.Record.load(
        folder / measured.file,
        time="t",
        input="x",
        output="z",
        aux=measured.aux,
        units=measured.units,
    )
    begin = time.perf_counter()
    found = pj.diagnose(record)
    seconds = time.perf_counter() - begin
    print(f"\n{measured.file}\n{found.summary()}", flush=True)
    stroke = record.output_range
    return {
        "file": measured.file,
        "source": measured.source,
        "samples": len(record),
        "physicist": measured.physics,
        "verdict": found.verdict,
        "sentence": found.sentence,
        "families": [list(finding.family) for finding in found.findings],
        "ladder": [
            {
                "effects": list(rung.effects),
                "held_out": quantity(rung.rms_validation, found.budget.unit, 3),
                "percent_of_stroke": 100 * rung.rms_validation / stroke,
                "fit_percent": rung.fit_percent,
            }
            for rung in found.ladder
        ],
        "budget_percent_of_stroke": {
            name: 100 * getattr(found.budget, name) / stroke
            for name in ("noise", "discretisation", "memory", "unexplained")
        },
        "located": found.located,
        "seconds": seconds,
    }


def main() -> None:
    """Diagnose all records of a folder and write the table."""
    if len(sys.argv) != 2 or not Path(sys.argv[1]).is_dir():
        sys.exit(f"usage: python {sys.argv[0]} FOLDER, a folder with the five records")
    folder = Path(sys.argv[1])
    if missing := [each.file for each in RECORDS if not (folder / each.file).is_file()]:
        sys.exit(f"{folder} lacks {', '.join(missing)}")
    write_results("measured.json", {"records": [diagnosed(each, folder) for each in RECORDS]})


if __name__ == "__main__":
    main()
