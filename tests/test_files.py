"""Files as instruments and programs write them: opened right, or refused with what leads on.

Text files are typed after the manuals named beside them, binary ones are written by the libraries.
"""

import datetime
import gzip
import io
import json
import os
import sys
import zipfile
from dataclasses import dataclass, field

import numpy as np
import pandas as pd
import pytest
from scipy.io import savemat

import preisach_jax as pj

for needed in ("openpyxl", "h5py", "nptdms", "python_calamine", "pyarrow"):
    pytest.importorskip(needed)

K = 120
T = np.arange(K) / 100
U = 5 - 5 * np.cos(2 * np.pi * T)
Z = 0.7 * U + 0.2 * np.sin(2 * np.pi * T)


@dataclass
class Case:
    """A file, how it is asked for, and what must come out: a record, or words of a refusal."""

    content: object  # bytes, text, or a function of the path
    options: dict = field(default_factory=dict)
    refused: tuple = ()
    told: tuple = ()  # words of what is announced
    units: tuple = ()
    tolerance: float = 1e-12
    samples: int = K


def rows(*columns, sep=",", begin="", end="", form="{}"):
    lines = (sep.join(map(form.format, row)) for row in np.column_stack(columns))
    return "".join(f"{begin}{line}{end}\n" for line in lines)


CHANNELS = {"input": "CH1", "output": "CH2"}
SECOND = {"input": "2", "output": "3"}

# --- oscilloscopes ---

# MSO4000 and DPO4000 Series User Manual, Tektronix: saving waveforms to a spreadsheet file.
TEKTRONIX_MSO = """Model,MSO4034

Waveform Type,ANALOG,
Sample Interval,0.01,
Record Length,120,
Gating,0.0% to 100.0%,
Vertical Units,V,V
,,
Label,,
TIME,CH1,CH2
"""
# TDS1000 and TDS2000 Series User Manual, Tektronix: settings in the first three columns.
TDS_SETTINGS = """Record Length,1.200000e+02,
Sample Interval,1.000000e-02,
,,
Source,CH1,
Vertical Units,V,
Vertical Scale,5.000000e+00,
Horizontal Units,s,
Firmware Version,FV:v2.06,""".split("\n")


def tds(lines=K):
    settings = TDS_SETTINGS + [",,"] * (lines - len(TDS_SETTINGS))
    return "".join(
        f"{left},{t:018.12f},{u:10.5f},\n"
        for left, t, u in zip(settings, T[:lines], U[:lines], strict=True)
    )


# DS1000E Series User's Guide, Rigol.
RIGOL_E = "X,CH1,CH2,\nSecond,Volt,Volt,\n"
# MSO1000Z/DS1000Z Series User's Guide, Rigol.
RIGOL_Z = "X,CH1,CH2,Start,Increment,\nSequence,Volt,Volt,-6.000000e-01,1.000000e-02\n"
# InfiniiVision 3000 X-Series User's Guide, Keysight: three header rows with segments.
KEYSIGHT = "x-axis,1,2\nsecond,Volt,Volt\n"
# Infiniium Oscilloscopes Programmer's Reference, Keysight: CSV and TSV Header Format.
INFINIIUM = """Revision:,0
Points:,120,120
XInc:,1.0E-02,1.0E-02
XOrg:,-6.0E-01,-6.0E-01
Frame:,DSOX91604A:MY0000
Time:,12:00:00
XUnits:,second,second
YUnits:,Volt,Volt
Data:
"""
# Teledyne LeCroy 9300C Series Operator's Manual, ASCII waveform export, spreadsheet format.
LECROY = """LECROYHDO4104,15423,Waveform
Segments,1,SegmentSize,120
Segment,TrigTime,TimeSinceSegment1
#1,21-Mar-2024 09:37:08,0
Time,Ampl,Ampl1
"""
# PicoScope 6 User's Guide, Pico Technology: text formats.
PICO = "Time,Channel A,Channel B\n(ms),(V),(mV)\n\n"
# As files of an SDS1104X-U begin in public repositories, units apart: the columns have one name.
SIGLENT_VALUES = """Record Length,Analog:120
Sample Interval,Analog:0.01
Vertical Units,CH1:V,CH2:A
Horizontal Units,s
Model Number,SDS1104X-U
Source,CH1,CH2
Second,Value,Value
"""
# RTM20 User Manual, Rohde & Schwarz: the first line has units and the names of the waveforms.
ROHDE = "in s,C1 in V,C2 in V\n"
# 8807-01 Instruction Manual, Hioki: text file internal format.
HIOKI = """"COMMENT","8807 MEM DATA"
"TIME","15:26:55"
"NUM_SIGS",3
"INTERVAL",1.000E-02
"HORZ_UNITS","S"
"VERT_UNITS","S","V","V"
"SIGNAL"
"TIME","ACH1","ACH2"
"""

# --- LabVIEW: Specification for the LabVIEW Measurement File (.lvm), National Instruments ---


def lvm(columns, x_columns="One", repeat=1):
    header = f"""LabVIEW Measurement
Writer_Version\t2
Separator\tTab
Decimal_Separator\t.
Multi_Headings\tYes
X_Columns\t{x_columns}
Time_Pref\tRelative
***End_of_Header***

"""
    segments = [
        f"""Channels\t2
Samples\t{K}\t{K}
Date\t2024/03/01\t2024/03/01
Y_Unit_Label\tVolts\tum
X_Dimension\tTime\tTime
X0\t0.0000000000000000E+0\t0.0000000000000000E+0
Delta_X\t1.000000E-2\t1.000000E-2
Time\t12:00:{2 * k:02d}.123456789123\t12:00:{2 * k:02d}.123456789123
***End_of_Header***
X_Value\tdrive\tsensor\tComment
{columns}"""
        for k in range(repeat)
    ]
    return "\n".join([header + segments[0], *segments[1:]])


# --- workbooks ---


def workbook(*sheets):
    def write(path):
        from openpyxl import Workbook

        book = Workbook()
        book.remove(book.worksheets[0])
        for name, lines in sheets:
            sheet = book.create_sheet(name)
            for line in lines:
                sheet.append(list(line))
        book.save(path)

    return write


def numbers(*columns):
    return [[float(v) for v in row] for row in zip(*columns, strict=True)]


HEADED = [["t_s", "u_V", "z_um"], *numbers(T, U, Z)]
UNITS_ROW = [["Messung 7"], ["Operator", "lab"], ["Rate (Hz)", 100], [],
             ["Zeit", "Spannung", "Weg"], ["s", "V", "µm"], *numbers(T, U, Z)]  # fmt: skip
NOON = datetime.datetime(2024, 3, 1, 12)
DATED = [["Datum", "u_V", "z_um"],
         *[[NOON + datetime.timedelta(milliseconds=10 * k), *row]
           for k, row in enumerate(numbers(U, Z))]]  # fmt: skip


def with_macros(path):
    workbook(("Sheet1", HEADED))(path)
    with zipfile.ZipFile(path, "a") as archive:
        archive.writestr("xl/vbaProject.bin", b"\0" * 100)


def protected(path):
    """The container that Office writes for a workbook with a password, by its beginning."""
    entry = "EncryptedPackage".encode("utf-16-le")
    path.write_bytes(b"\xd0\xcf\x11\xe0\xa1\xb1\x1a\xe1" + bytes(504) + entry + bytes(2000))


# --- HDF5, MATLAB, TDMS, NumPy, Arrow ---


def hdf5(build):
    def write(path):
        import h5py

        with h5py.File(path, "w") as file:
            build(file)

    return write


def own_layout(file):
    group = file.create_group("run_1")
    for name, values, unit in (("t", T, "s"), ("u", U, "V"), ("z", Z, "um")):
        group[name] = values
        group[name].attrs["units"] = unit
    file["about/comment"] = np.array([b"a text"])


def with_rate(file):
    file["drive"], file["sensor"] = U, Z
    file["drive"].attrs.update(unit="V", sample_rate=100.0)
    file["sensor"].attrs.update(unit="um", sample_rate=100.0)


def matlab_73(path):
    """As MATLAB writes -v7.3: a block of 512 bytes before the HDF5, matrices transposed."""
    import h5py

    with h5py.File(path, "w", userblock_size=512) as file:
        for name, values in (("t", T), ("run/u", U), ("run/z", Z)):
            file[name] = values[None, :]
            file[name].attrs["MATLAB_class"] = np.bytes_("double")
        file["note"] = np.array([[65, 66]], dtype="u2")
        file["note"].attrs["MATLAB_class"] = np.bytes_("char")
    with path.open("r+b") as file:
        file.write(b"MATLAB 7.3 MAT-file, Platform: GLNXA64".ljust(124) + b"\x00\x02IM")


def tdms(*channels):
    def write(path):
        from nptdms import ChannelObject, TdmsWriter

        objects = [
            ChannelObject(group, name, values, properties=properties)
            for group, name, values, properties in channels
        ]
        with TdmsWriter(str(path)) as writer:
            writer.write_segment(objects)

    return write


def wave(step, unit):
    return {"wf_increment": step, "wf_start_offset": 0.0, "unit_string": unit}


TDMS_ONE = tdms(("run", "drive", U, wave(0.01, "V")), ("run", "sensor", Z, wave(0.01, "um")))


def matlab(**arrays):
    return lambda path: savemat(path, arrays)


def frame():
    return pd.DataFrame({"t_s": T, "u_V": U, "z_um": Z})


def saved(array):
    file = io.BytesIO()
    np.save(file, array)
    return file.getvalue()


def zipped(**members):
    file = io.BytesIO()
    with zipfile.ZipFile(file, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, content in members.items():
            archive.writestr(name, content)
    return file.getvalue()


CSV = "t_s,u_V,z_um\n" + rows(T, U, Z)
LONG_HEADER = "".join(f"# line {k} of a long protocol\nNote {k}: text\n" for k in range(300))


def thousands_csv(thousands, decimal, sep, quote=""):
    signs = {ord(","): thousands, ord("."): decimal, ord("|"): sep}
    lines = rows(1000 * T, 1000 * U, 1000 * Z, sep="|", form=quote + "{:,.4f}" + quote)
    return sep.join(["t_ms", "u_mV", "z_nm"]) + "\n" + lines.translate(signs)


def with_units(*columns, units):
    lines = rows(*columns, sep=" {},", end=" {}")
    return "".join(line.format(*units.split()) + "\n" for line in lines.splitlines())


def twelve_hours():
    """Clock times from a second before one in the afternoon, as an American logger writes them."""
    begin = datetime.datetime(2024, 3, 1, 12, 59, 59)
    clock = [begin + datetime.timedelta(milliseconds=10 * k) for k in range(K)]
    return "Time,u_V,z_um\n" + "".join(
        f"{at:%I:%M:%S}.{at.microsecond // 1000:03d} {at:%p},{u:.9g},{z:.9g}\n"
        for at, u, z in zip(clock, U, Z, strict=True)
    )


SIGNALS = pd.DataFrame({"t": T, "u": U, "z": Z}).to_dict("records")

OPENED = {
    "tektronix_tds.csv": Case(
        tds(), {"input": "CH1", "need_output": False}, units=("V", ""), tolerance=1e-5
    ),
    "tektronix_mso.csv": Case(TEKTRONIX_MSO + rows(T, U, Z), CHANNELS),
    "rigol_ds1000e.csv": Case(RIGOL_E + rows(T, U, Z, end=","), CHANNELS, units=("V", "V")),
    "rigol_ds1000z.csv": Case(
        RIGOL_Z + rows(np.arange(K), U, Z, end=","), {"input": "CH1 (Volt)", "output": "CH2 (Volt)"}
    ),
    "keysight_infiniivision.csv": Case(KEYSIGHT + rows(T, U, Z), SECOND, units=("V", "V")),
    "keysight_infiniium.csv": Case(
        INFINIIUM + rows(U, Z), {"input": "Channel 1", "output": "Channel 2"}, units=("V", "V")
    ),
    "lecroy.csv": Case(LECROY + rows(T, U, Z), {"input": "Ampl", "output": "Ampl1"}),
    "picoscope.csv": Case(PICO + rows(1000 * T, U, Z), SECOND, units=("V", "mV")),
    "picoscope.mat": Case(
        matlab(A=U, B=Z, Tstart=0.0, Tinterval=0.01, Length=float(K)), {"input": "A", "output": "B"}
    ),
    "siglent_values.csv": Case(
        SIGLENT_VALUES + rows(T - 0.6, U, Z), CHANNELS, units=("V", "A")
    ),
    "rohde_schwarz.csv": Case(ROHDE + rows(T, U, Z), SECOND, units=("V", "V")),
    "hioki.csv": Case(HIOKI + rows(T, U, Z), SECOND),
    "labview.lvm": Case(lvm(rows(T, U, Z, sep="\t")), units=("V", "um")),
    "labview_no_x.lvm": Case(lvm(rows(U, Z, sep="\t", begin="\t"), "No"), units=("V", "um")),
    "labview.tdms": Case(TDMS_ONE, units=("V", "um")),
    "labview_rates.tdms": Case(
        tdms(("run", "drive", U, wave(0.01, "V")), ("run", "sensor", Z[::2], wave(0.02, "um"))),
        told=("sensor (50 Hz) interpolated", "drive (100 Hz)"), samples=K - 1, tolerance=2e-2,
    ),
    "protocol.xlsx": Case(workbook(("Tabelle1", UNITS_ROW)), units=("V", "µm")),
    "dated.xlsx": Case(workbook(("Sheet1", DATED))),
    "two_sheets.xlsx": Case(
        workbook(("About", [["Operator", "lab"], ["Rate", 1]]), ("Data", HEADED)),
        told=("of 2 sheets, 'Data' was read",),
    ),
    "no_time.xlsx": Case(
        workbook(("Sheet1", [["Sample rate [Hz]", 100], ["u_V", "z_um"], *numbers(U, Z)])),
        told=("Sample rate [Hz]: 10 ms between two rows",),
    ),
    "own_layout.h5": Case(hdf5(own_layout), units=("V", "um")),
    "rate.hdf5": Case(hdf5(with_rate), units=("V", "um")),
    "version_73.mat": Case(matlab_73),
    "structure.mat": Case(
        matlab(run={"t": T, "u": U, "z": Z}), {"input": "run.u", "output": "run.z"}
    ),
    "matrix.mat": Case(
        matlab(data=np.column_stack([T, U, Z])), told=("time 1, input 2, output 3",)
    ),
    "two_tables.csv": Case(CSV + "\n# run 2\n" + CSV, told=("of 2 tables the first was read",)),
    "structured.npy": Case(saved(frame().to_records(index=False))),
    "dated.feather": Case(
        lambda path: frame().assign(t_s=pd.to_datetime(T, unit="s")).to_feather(path)
    ),
    "plain.csv.gz": Case(gzip.compress(CSV.encode())),
    "long_header.csv": Case(LONG_HEADER + CSV),
    "thousands_english.csv": Case(
        thousands_csv(",", ".", ",", '"'), told=("between groups",), tolerance=1e-1
    ),
    "thousands_german.csv": Case(
        thousands_csv(".", ",", ";"), told=("between groups",), tolerance=1e-1
    ),
    "thousands_swiss.csv": Case(
        thousands_csv("'", ".", ";"), told=("between groups",), tolerance=1e-1
    ),
    "rate_in_comment.csv": Case(
        "# Sample rate: 0.1 kHz\nu_V,z_um\n" + rows(U, Z), told=("10 ms between two rows",)
    ),
    "units_beside_numbers.csv": Case(
        "t,u,z\n" + with_units(1000 * T, U, Z, units="ms V um"), units=("V", "um"),
        told=("column u read without the V in its cells",),
    ),
    "fortran.dat": Case(
        "t u z\n" + rows(T, U, Z, sep=" ", form="{:.12E}").replace("E", "D"), tolerance=1e-9
    ),
    "twelve_hours.csv": Case(twelve_hours()),
    "epoch_ms.csv": Case(
        "timestamp,u_V,z_um\n" + rows(1_767_225_600_000 + 1000 * T, U, Z, form="{:.13g}"),
        told=("taken as ms",),
    ),
    "tab_separated.xls": Case(
        ("Zeit [s]\tSpannung [V]\tWeg [µm]\n" + rows(T, U, Z, sep="\t")).encode("latin-1"),
        units=("V", "µm"),
    ),
    "nested.json": Case(json.dumps({"by": "Ada", "run": SIGNALS})),
    "lines.jsonl": Case("".join(json.dumps(each) + "\n" for each in SIGNALS)),
    "with_readme.zip": Case(
        zipped(**{"run.csv": CSV, "README.txt": "by Ada", "loop.png": b"\x89PNG"}),
        told=("run.csv was read, and README.txt, loop.png left aside",),
    ),
    "unequal_rates.csv": Case(
        "t_s,u_V,z_um\n" + rows(T, U, np.where(np.arange(K) % 2, np.nan, Z)).replace("nan", "")
    ),
}  # fmt: skip


def put(path, content):
    if callable(content):
        content(path)
    else:
        path.write_bytes(content.encode() if isinstance(content, str) else content)


@pytest.mark.parametrize("name", OPENED)
def test_opened_right(tmp_path, name):
    case = OPENED[name]
    put(tmp_path / name, case.content)
    told = []
    record = pj.Record.load(tmp_path / name, announce=told.append, **case.options)
    scale = 1000.0 if "thousands" in name else 1.0
    count = case.samples
    assert len(record) == count
    measured = record.measured
    np.testing.assert_allclose(record.input, scale * U[:count], atol=case.tolerance)
    np.testing.assert_allclose(
        record.output[measured], scale * Z[:count][measured], atol=case.tolerance
    )
    np.testing.assert_allclose(np.diff(record.time), 0.01, rtol=1e-4)
    if case.units:
        assert (record.input_unit, record.output_unit) == case.units
    for words in case.told:
        assert any(any(word in line for word in words.split("|")) for line in told), told


def test_segments_of_labview_follow_each_other(tmp_path):
    path = tmp_path / "segments.lvm"
    path.write_text(lvm(rows(T[:60], U[:60], Z[:60], sep="\t"), repeat=2))
    told = []
    record = pj.Record.load(path, announce=told.append)
    np.testing.assert_allclose(record.input, np.tile(U[:60], 2), atol=1e-6)
    np.testing.assert_allclose(record.time[60] - record.time[0], 2.0, atol=1e-6)
    assert any("2 segments" in line for line in told)


BOMB = b"0,0,0\n" * 12_000_000
WIDE = ",".join(f"c{k}" for k in range(1_000_000))


REFUSED = {
    "macros.xlsm": Case(with_macros, refused=("has macros", "save it as .xlsx")),
    "password.xlsx": Case(protected, refused=("protected by a password", "save it without")),
    "broken.xlsx": Case(b"PK\x03\x04" + bytes(1000), refused=("not a readable workbook", "CSV")),
    "no_vectors.h5": Case(hdf5(lambda file: file.create_group("a")), refused=("no vectors",)),
    "many.zip": Case(
        zipped(**{f"run_{k}.csv": CSV for k in range(9)}), refused=("holds 9 files", "unpack it")
    ),
    "bomb.csv.gz": Case(gzip.compress(BOMB), refused=("unpack to", "no record is compressed")),
    "bomb.zip": Case(zipped(**{"a.csv": BOMB}), refused=("no record is compressed",)),
    "bomb.xlsx": Case(
        zipped(**{"[Content_Types].xml": b" " * 70_000_000}), refused=("no record is compressed",)
    ),
    "twice.csv.gz": Case(gzip.compress(gzip.compress(CSV.encode())), refused=("gzip twice",)),
    "million_columns.csv": Case(WIDE + "\n" + "1," * 999_999 + "1\n", refused=("1,000,000 col",)),
    "mixed.csv": Case(
        CSV + "broken here,and,there\n" + rows(T + 2, U, Z), refused=("row 122", "remove the row")
    ),
    "long.csv": Case(
        "t_s,u_V,z_um\n" + rows(*np.arange(60_000.0).reshape(3, -1)) + "1,2\n",
        refused=("row 20002: 2 field(s)",),
    ),
    "another_unit_in_a_cell.csv": Case(
        "t,u,z\n" + with_units(T, U, Z, units="s V um") + "9 s,5 kV,1 um\n",
        refused=("column u, row 122: '5 kV' is not a number",),
    ),
    "rows_are_channels.csv": Case(
        "".join(f"{name},{','.join(map(str, values))}\n" for name, values in
                zip("tuz", (T, U, Z), strict=True)),
        refused=("121 columns and 2 rows", "transpose the table"),
    ),
    "login_page.csv": Case("<!DOCTYPE html><html><body>log in</body></html>\n",
                           refused=("a web page or XML", "save it as CSV")),
    "decimal_commas.csv": Case(
        "t,u,z\n" + rows(T, U, Z).replace(".", ","), refused=("complete or remove the row",)
    ),
    "settings_only.csv": Case("Instrument: x\nRate: 5 Hz\nOperator: me\n",
                              refused=("holds settings only",)),
    "one_column.csv": Case(rows(U), refused=("an input and an output, each a column",)),
    "deep.json": Case("[" * 100_000, refused=("not a readable JSON",)),
    "tds_bad_cell.csv": Case(
        tds().replace("  10.00000,", "?,"), {"input": "TIME", "output": "CH1", "rate": 100.0},
        refused=("row 51",),
    ),
    "picture.npy": Case(saved(np.zeros((50, 50))), refused=("no vectors",)),
    "no_second_header.lvm": Case("LabVIEW Measurement\t\n***End_of_Header***\n1\t2\n",
                                 refused=("no second ***End_of_Header***", "CSV")),
    "not_together.tdms": Case(
        tdms(("r", "u", U, wave(0.01, "V")),
             ("r", "z", Z[:50], {**wave(0.02, "um"), "wf_start_offset": 60.0})),
        refused=("not recorded at the same time",),
    ),
}  # fmt: skip


@pytest.mark.parametrize("name", REFUSED)
def test_refused_with_what_leads_on(tmp_path, name):
    case = REFUSED[name]
    put(tmp_path / name, case.content)
    begun = sum(os.times()[:4])  # of the child that reads it as well
    with pytest.raises(pj.InputError) as caught:
        pj.Record.load(tmp_path / name, **case.options)
    message = str(caught.value)
    assert name in message
    assert "\n" not in message
    assert len(message) < 600
    for words in case.refused:
        assert any(word in message for word in words.split("|")), message
    assert sum(os.times()[:4]) - begun < 10


@pytest.mark.parametrize(
    ("name", "module", "package", "content"),
    [
        ("a.xlsx", "python_calamine", "python-calamine", workbook(("Sheet1", HEADED))),
        ("a.h5", "h5py", "h5py", b"\x89HDF\r\n\x1a\n"),
        ("a.tdms", "nptdms", "npTDMS", b"TDSm"),
        ("a.parquet", "pyarrow", "pyarrow", b"PAR1"),
    ],
)
def test_a_missing_library_is_named_with_the_extra(
    tmp_path, monkeypatch, name, module, package, content
):
    put(tmp_path / name, content)
    monkeypatch.setitem(sys.modules, module, None)
    with pytest.raises(pj.InputError, match=rf"{package}.*pip install 'preisach_jax\[files\]'"):
        pj.Record.load(tmp_path / name)


@pytest.mark.parametrize(("sep", "end"), [(",", "\n"), (" ", "")])
def test_a_long_regular_file_is_read_as_line_by_line(tmp_path, monkeypatch, sep, end):
    from preisach_jax.record import delimited

    count = 20_000
    signal = np.random.default_rng(1).normal(size=(3, count))
    text = sep.join(["t_s", "u_V", "z_um"]) + "\n" + rows(*signal, sep=sep, form="{:.15g}")
    text = text.rstrip("\n") + end
    fast = delimited.read_delimited(text, "long.csv")
    assert delimited._regular(text, "long.csv", 1) is not None
    slow = delimited._table(text.split("\n"), "long.csv", 1)
    assert list(fast.columns) == list(slow.columns)
    for name, values in slow.columns.items():
        np.testing.assert_array_equal(fast.columns[name], values)
    np.testing.assert_array_equal(fast.rows, slow.rows)


def test_a_sheet_is_named_behind_the_workbook(tmp_path):
    path, notes = tmp_path / "book.xlsx", []
    workbook(("Long", HEADED), ("Run 2", HEADED[:61]))(path)
    assert len(pj.Record.load(path, announce=notes.append)) == K
    assert any("Run 2" in note and "book.xlsx#NAME" in note for note in notes)
    assert len(pj.Record.load(f"{path}#Run 2")) == 60
    with pytest.raises(pj.InputError, match=r"no sheet 'Run 3'.*; give one of Long, Run 2"):
        pj.Record.load(f"{path}#Run 3")
    odd = tmp_path / "a#b.csv"  # a mark in any other name is part of it
    odd.write_text(CSV)
    assert len(pj.Record.load(odd)) == K
