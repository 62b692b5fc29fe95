"""Layouts of instruments as data: what marks them, which column is what, where they are described.

A further one is a `Layout` here and a sample in `tests/test_record_layouts.py`.  What stands in no
row is left to what any text is asked: its delimiter, its names, its units, its quantities.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from preisach_jax.record.delimited import HEAD_BYTES, read_all
from preisach_jax.record.table import Table
from preisach_jax.record.units import plain_unit


@dataclass(frozen=True)
class Layout:
    """A kind of text files.

    Arguments:
        name: the instrument or its program.
        source: where the layout is described or shown.
        mark: pattern that the beginning of such a file holds.
        begin: pattern of what stands above the line of names, where its place does not tell them.
        time, input, output: patterns of the names of columns, the first that has values is taken.
        aside: pattern of the names of columns that are no signals.
        named_by: pattern of lines that hold the name of one column each, in their order; then
            `begin` is that of what stands above the rows.
        units: by name, where neither the names nor a row state them.
    """

    name: str
    source: str
    mark: str
    begin: str = ""
    time: Sequence[str] = ()
    input: Sequence[str] = ()
    output: Sequence[str] = ()
    aside: str = ""
    named_by: str = ""
    units: Sequence[tuple[str, str]] = ()


LAYOUTS: tuple[Layout, ...] = (
    Layout(
        "Quantum Design MPMS, PPMS, VersaLab (.dat)",
        "MPMS3 and PPMS VSM user's manuals, Quantum Design, data file format",
        mark=r"\[Header\][\s\S]*\n\[Data\]",
        begin=r"\n\[Data\][^\n]*\n",
        time=(r"Time Stamp \(sec\)", r"Time"),
        input=(r"Magnetic Field \(Oe\)", r"Field \(Oe\)"),
        output=(
            r"Moment \(emu\)", r"DC Moment Free Ctr \(emu\)", r"DC Moment Fixed Ctr \(emu\)",
            r"Long Moment \(emu\)", r"M-DC \(emu\)", r"Bridge \d Resistance \(Ohms?\)",
            r"Bridge \d Resistivity \(Ohm-?(m|cm)\)",
        ),
        aside=r"(Min|Max)\. .*|.*Std\. (Err|Dev)\..*",
    ),
    Layout(
        "Lake Shore 8600 VSM (.csv)",
        "8600 Series VSM user's manual, Lake Shore Cryotronics, exported data",
        mark=r"##DATA TABLE",
        begin=r"##DATA TABLE[^\n]*\n",
        time=(r"Time Stamp.*", r"Elapsed Time.*"),
        input=(r"Field.*",),
        output=(r"Moment \(m\).*", r"Moment.*"),
        aside=r"Step|Iteration|Segment|.*(Status|Std).*",
    ),
    Layout(
        "MicroSense EasyVSM (.VHD)",
        "EasyVSM user manual, MicroSense; published loops of EZ VSMs",
        mark=r"@@END Columns",
        named_by=r"(?m)^@?Column \d+: ([^,\n]*(?:, [^\n\[]*)?\[[^\]]*\])",
        begin=r"@@Data[^\n]*\n(New Section[^\n]*\n)?",
        time=(r"Time.*",),
        input=(r"Applied Field .*", r"Raw Applied Field.*", r"Field.*"),
        output=(r"Signal .*Moment.*", r".*Moment.*", r"Signal X.*", r"Signal.*"),
    ),
    Layout(
        "VFTB of Petersen Instruments",
        "RockMagAnalyzer 1.0, R. Leonhardt, Comput. Geosci. 32 (2006) 1420: VFTB files",
        mark=r"field / Oe\s+mag / emu",
        time=(r"time.*",),
        input=(r"field / Oe",),
        output=(r"mag / emu.*",),
        aside=r"std dev.*|susceptibility.*",
        units=(("field / Oe", "Oe"), ("mag / emu / g", "emu/g"), ("time / s", "s")),
    ),
    Layout(
        "aixACCT TF Analyzer",
        "TF Analyzer 2000 operating manual, aixACCT Systems, ASCII export",
        mark=r"DynamicHysteresis|Hysteresis Frequency \[Hz\]",
        time=(r"Time \[s\]",),
        input=(r"V\+ \[V\]", r"E \[.*"),
        output=(r"P1? \[.*", r"D1? \[.*"),
    ),
    Layout(
        "Radiant Vision",
        "Vision data acquisition manual, Radiant Technologies, text export of hysteresis tasks",
        mark=r"Radiant|Drive Voltage\s+Measured Polarization",
        time=(r"Time.*",),
        input=(r"Drive Voltage.*", r"Field.*"),
        output=(r"Measured Polarization.*", r"Polarization.*"),
        units=(
            ("Time (ms)", "ms"), ("Drive Voltage", "V"), ("Measured Polarization", "uC/cm2"),
        ),
    ),
    Layout(
        "Instron WaveMatrix",
        "WaveMatrix2 reference, Instron, tracking file",
        mark=r"Total Time \(s\),Cycle Elapsed Time \(s\)",
        time=(r"Total Time \(s\)",),
    ),
    Layout(
        "BioLogic EC-Lab (.mpt)",
        "EC-Lab software user's manual, BioLogic, text export",
        mark=r"EC-Lab ASCII FILE|mode\s+ox/red\s+error",
        begin=r"\n(?=mode\tox/red)",
        time=(r"time/s",),
        input=(r"\(Q-Qo\)/.*", r"Capacity/.*", r"Q charge/discharge/.*", r"control/.*"),
        output=(r"Ewe/V", r"<Ewe>/V", r"Ecell/V"),
        aside=r"mode|ox/red|error|.*changes|Ns.*|half cycle|cycle number",
    ),
    Layout(
        "Arbin MITS Pro (.csv)",
        "MITS Pro user's manual, Arbin Instruments, channel data",
        mark=r"Data_Point,[^\n]*Test_Time",
        time=(r"Test_Time.*",),
        input=(r"Discharge_Capacity.*", r"Charge_Capacity.*"),
        output=(r"Voltage.*",),
        aside=r"Data_Point|Step.*|Cycle_Index|Date_Time|.*Energy.*|dV/dt.*|Internal.*",
    ),
    Layout(
        "Gamry Framework (.DTA)",
        "Framework data file format, Gamry Instruments",
        mark=r"^\s*EXPLAIN",
        begin=r"CURVE\d*\tTABLE[^\n]*\n",
        time=(r"T",),
        input=(r"Vf", r"Vu"),
        output=(r"Im",),
        aside=r"Pt|Sig|Ach|IERange|Over|Temp",
        units=(("T", "s"), ("Vf", "V"), ("Im", "A")),
    ),
    Layout(
        "Physik Instrumente GCS array (.dat)",
        "PZ205 GCS data format, Physik Instrumente",
        mark=r"#\s*NAME0\s*=[\s\S]*#\s*END_HEADER",
        named_by=r"#\s*NAME\d+\s*=\s*([^\n]+)",
        begin=r"#\s*END_HEADER[^\n]*\n",
        input=(r"Target.*|Commanded.*|.*Control Voltage.*",),
        output=(r"(Current|Actual|Real) Position.*",),
    ),
    Layout(
        "Brockhaus MPG",
        "MPG 200 measuring system, Brockhaus Measurements, exported curves",
        mark=r"H \[A/m\].*(J|B) \[(mT|T)\]|H in A/m.*J in m?T",
        input=(r"H .*",),
        output=(r"J .*", r"B .*"),
    ),
)  # fmt: skip


def read_known(text: str, source: str) -> list[Table]:
    """The tables of a text, with what its layout knows of their columns, if it is a known one."""
    layout = next((each for each in LAYOUTS if re.search(each.mark, text[:HEAD_BYTES])), None)
    if layout is None:
        return read_all(text, source)
    first_row = 1
    if layout.named_by:
        text, first_row = _with_names(layout, text), 0  # a line more, which no row of the file is
    elif above := re.search(layout.begin, text) if layout.begin else None:
        first_row += text.count("\n", 0, above.end())
        text = text[above.end() :]
    return [_known(layout, table) for table in read_all(text, source, first_row)]


def _with_names(layout: Layout, text: str) -> str:
    """The same with the names that stand one a line as a line above the rows, in tabs."""
    names = [name.strip() for name in re.findall(layout.named_by, text)]
    begin = re.search(layout.begin, text)
    if not names or begin is None:
        return "\n" + text
    head, rows = text[: begin.end()], text[begin.end() :].rstrip("\n").split("\n")
    body = "\n".join(re.sub(r"[ \t]+", "\t", row.strip()) for row in rows if "@" not in row)
    comments = "\n".join(f"# {line.lstrip('# ')}" for line in head.rstrip("\n").split("\n"))
    return "\n".join([comments, "\t".join(names), body, ""])


def _known(layout: Layout, table: Table) -> Table:
    """A table with the roles, units and signals that its layout knows."""
    columns = {
        name: cells for name, cells in table.columns.items()
        if not (layout.aside and re.fullmatch(layout.aside, name))
    }  # fmt: skip
    aside = {name: f"the layout of {layout.name} says that it is no signal"
             for name in table.columns if name not in columns}  # fmt: skip
    known = replace(
        table,
        columns=columns,
        units={**table.units, **{n: plain_unit(u) for n, u in layout.units if n in columns}},
        left_aside={**table.left_aside, **aside},
        notes=(*table.notes, f"{table.source}: read as a file of {layout.name}"),
    )
    chosen = {
        "time": _first_of(known, layout.time),
        "input": _first_of(known, layout.input),
        "output": _first_of(known, layout.output),
    }
    roles = {role: name for role, name in chosen.items() if name is not None}
    return replace(known, roles={**roles, **table.roles})


def _first_of(table: Table, patterns: Sequence[str]) -> str | None:
    """The first column of a name like one of the patterns that holds numbers that differ."""
    for pattern in patterns:
        for name in table.columns:
            values = table.lenient_numbers(name) if re.fullmatch(pattern, name) else None
            if (
                values is not None
                and np.isfinite(values).any()
                and np.nanmin(values) < np.nanmax(values)
            ):
                return name
    return None
