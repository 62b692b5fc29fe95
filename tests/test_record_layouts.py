"""Files in the layouts that people keep: opened with no option, asked once, or refused with why.

Those of `tests/files` hold simulated numbers in layouts met in public repositories of this field;
the others are typed here after the manuals and published samples that stand beside them.
"""

import json
import tempfile
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import preisach_jax as pj
from preisach_jax.cli import main
from preisach_jax.diagnosis.selection import effects_to_try
from preisach_jax.effects import library
from preisach_jax.export import export_c
from preisach_jax.look.prospects import judged_effects, needing_a_clock
from preisach_jax.plot.axes import record_axes
from preisach_jax.record.columns import QuestionError

FILES = Path(__file__).parent / "files"
SAMPLES = ("sample", "samples")

# name: channels, words that are said, and how many records
OPENED = {
    "squid_moment_elsewhere.dat": (
        "Time Stamp (sec)", "Magnetic Field (Oe)", "DC Moment Free Ctr (emu)",
        ("time counts from the first row"), 1,
    ),
    "squid_saved_with_tabs.dat": (
        "Time Stamp (sec)", "Magnetic Field (Oe)", "DC Moment Free Ctr (emu)", (), 1,
    ),
    "vsm_many_fields.dat": ("Time Stamp (sec)", "Magnetic Field (Oe)", "Moment (emu)", (), 1),
    "micromag_initial_and_loop.hys": (
        None, "field", "moment", ("samples are counted", "at a demagnetised state"), 1,
    ),
    "ferroelectric_three_tables.dat": (
        "Time [s]", "V+ [V]", "P1 [uC/cm2]", ("a table of 3 rows from row 5 on",), 3,
    ),
    "no_names_constant_columns.dat": (
        None, "1", "5", ("samples are counted", "5 columns that are constant", "--rate HZ"), 1,
    ),
    "no_names_two_columns.txt": (None, "1", "2", ("samples are counted",), 1),
    "units_row_no_time.csv": (
        None, "Lead Actuator Displacment", "Lead Actuator Force", ("samples are counted",), 1,
    ),
    "fatigue_rig_many_clocks.csv": (
        "Total Time (s)", "Strain 1 (%)", "Stress",
        ("Position (mm) and Force (kN) are another pair", "were spread evenly"), 1,
    ),
    "cycler_decimal_comma.txt": ("time/s", "Capacity/mA.h", "Ewe/V", (), 1),
    "object_with_rows.json": ("time", "displacement", "friction force", (), 1),
    "straight_line.tsv": (
        "Time s", "Vplus V", "P1 uC_per_cm2", ("no hysteresis: a straight line does as well",), 1,
    ),
}  # fmt: skip
ASKED = {
    "tabs_no_names_ms.csv": ("column 1 is the time", "--time 1 --input 2 --output 4"),
    "three_clocks.csv": (
        "2 clocks, 3 and 5, were brought on one (5 begins 94.4 ms later than 3)",
        "--input 1 --output 4",
    ),
}
REFUSED = {
    "trap_sorted_by_field.dat": "rows are sorted by the input",
    "trap_first_curve_only.txt": "never turns",
    "trap_table_of_results.csv": "a table of results, one row for each specimen, not a record",
    "trap_one_signal.csv": "one signal only, Value, and no input",
}


def looked_at(path, capsys, *options):
    """Exit code and what `preisach look --json` shows; what it says if it fails."""
    capsys.readouterr()
    code = main(["look", str(path), "--json", *options])
    out = capsys.readouterr()
    return code, json.loads(out.out) if code == 0 else out.err, out.err


@pytest.mark.parametrize("name", OPENED)
def test_a_look_opens_it_with_no_option(name, capsys):
    time, driven, output, words, count = OPENED[name]
    code, found, said = looked_at(FILES / name, capsys)
    assert code == 0, found
    channels = found["channels"]
    assert (channels["input"]["column"], channels["output"]["column"]) == (driven, output)
    assert found["clock"]["kind"] == ("none" if time is None else "column")
    assert found["clock"]["column"] == time
    assert len(found["records"]) == count
    assert (found["hysteresis"] is not None) == (name == "straight_line.tsv")
    told = " ".join([*found["notes"], said])
    if name.startswith("squid_moment"):
        assert found["sampling"]["unmeasured"] == 9
    for each in words:
        assert each in told
    if time is None:
        assert not set(found["can_tell"]) & set(needing_a_clock())


@pytest.mark.parametrize("name", ASKED)
def test_what_names_do_not_tell_is_asked_once_with_a_command_to_copy(name, capsys):
    code, found, _ = looked_at(FILES / name, capsys)
    assert code == 0
    assert all(words in found["question"] for words in ASKED[name])
    command = found["command"].split()[2:]
    code, found, _ = looked_at(command[0], capsys, *command[1:])
    assert code == 0
    assert found["channels"]["input"]["column"] == command[command.index("--input") + 1]
    with pytest.raises(QuestionError):
        pj.Record.load(FILES / name)


@pytest.mark.parametrize("name", REFUSED)
def test_what_is_no_record_is_refused_in_a_line_that_says_why(name, capsys):
    code, said, _ = looked_at(FILES / name, capsys)
    assert code == 2
    (line,) = [each for each in said.splitlines() if each.startswith("preisach: ")]
    assert REFUSED[name] in line
    with pytest.raises(pj.InputError, match=REFUSED[name].split(",")[0]):
        pj.Record.load_all(FILES / name)


def test_the_values_are_those_of_the_files():
    record = pj.Record.load(FILES / "micromag_initial_and_loop.hys")
    assert record.initial_memory == "demagnetised"
    assert (record.input[0], record.output[0]) == (0.0, -5.236930e-06)
    assert (record.input_unit, record.output_unit) == ("T", "A·m²")
    assert (record.channels["time"].name, record.channels["time"].unit) == SAMPLES
    np.testing.assert_array_equal(record.time, np.arange(253))
    assert not record.has_clock
    three = pj.Record.load_all(FILES / "ferroelectric_three_tables.dat")
    np.testing.assert_allclose([r.step_s for r in three], [5e-5, 5e-5 / 3, 5e-6], rtol=2e-2)
    second = pj.Record.load(FILES / "ferroelectric_three_tables.dat", table=2)
    assert second.sha256 == three[1].sha256
    rows = json.loads((FILES / "object_with_rows.json").read_text())["data"]
    found = pj.Record.load(FILES / "object_with_rows.json")
    np.testing.assert_array_equal(np.array(rows).T[1:], [found.input, found.output])
    assert (found.input_unit, found.output_unit) == ("in", "kip")
    clocks = np.loadtxt(FILES / "three_clocks.csv", delimiter=",").T
    merged = pj.Record.load(FILES / "three_clocks.csv", input="4", output="1")
    fast = merged.time[len(merged) // 2]
    np.testing.assert_allclose(
        merged.output[len(merged) // 2], np.interp(fast, clocks[2], clocks[0]), rtol=1e-3
    )
    np.testing.assert_allclose(
        merged.input[len(merged) // 2], np.interp(fast, clocks[4], clocks[3]), rtol=1e-3
    )


def test_time_none_counts_samples_and_only_such_effects_are_judged():
    record = pj.Record.load(FILES / "vsm_many_fields.dat", time="none")
    assert not record.has_clock
    assert not record.part(3, 100).has_clock
    needing = {name for name, effect in library().items() if effect.needs_clock}
    assert set(needing_a_clock()) == needing & set(judged_effects())
    tried = {effect.name for effect in effects_to_try(record, None)}
    assert tried < set(library()) - needing
    assert {"drift", "ageing", "reptation"} < tried
    with pytest.raises(pj.InputError, match=r"'creep' needs a clock.*--rate HZ"):
        pj.diagnose(record, ["creep"])
    channels = {**record.channels, "load": record.channels["input"]}
    beside = replace(record, aux={"load": record.input}, channels=channels)
    with pytest.raises(pj.InputError, match=r"'cross:load' needs a clock"):
        effects_to_try(beside, ["cross:load"])
    for refused in (
        lambda: pj.fit(record, ["creep"]),
        lambda: pj.explore(record, levels=5).add("creep"),
    ):
        with pytest.raises(pj.InputError, match=r"'creep' needs a clock.*--rate HZ"):
            refused()
    with pytest.raises(pj.InputError, match="has no clock, and others have one"):
        pj.fit([record, pj.Record.load(FILES / "vsm_many_fields.dat")])


def test_without_a_clock_slow_effects_go_with_the_path_of_the_input(tmp_path):
    """Cycles of many lengths and heights, with rests, so that the path is not the samples."""
    cycles = [
        np.append(height * (1 - np.cos(2 * np.pi * np.arange(count) / count)), np.zeros(rest))
        for count, height, rest in zip(
            [40, 160, 80] * 5, [5, 3, 5, 4, 4] * 3, [0, 30, 0, 100, 0] * 3, strict=True
        )
    ]
    u = np.concatenate(cycles)
    moves = np.abs(np.diff(u, prepend=u[:1]))
    path = np.cumsum(moves) - moves
    plane = pj.Plane(levels=9, low=0.0, high=10.0)
    rng = np.random.default_rng(0)
    weights = rng.uniform(0.2, 1.0, plane.cells)
    h = np.asarray(pj.simulate(plane, weights, u, hysteron="ramp"))
    lost = 0.2 * np.expm1(-path / 60) / np.expm1(-path[-1] / 60)
    z = h * (1 - lost) + 1e-3 * np.ptp(h) * rng.normal(size=len(u))
    np.savetxt(
        tmp_path / "rig.csv", np.stack([u, z], 1), "%.9g", ",", header="u_mm,z_kN", comments=""
    )
    record = pj.Record.load(tmp_path / "rig.csv")
    assert not record.has_clock
    fitted = pj.fit(record, levels=9, effects=["ageing"])
    tau = fitted.model.parameters["ageing"]["tau_s"]
    assert tau.low < 60 < tau.high
    assert tau.high < 1.1 * tau.low
    assert tau.unit == "mm"
    assert record_axes(record)["time"].label == "sample"
    assert record_axes(record)["since"].label.endswith("(samples)")
    assert record_axes(record)["rate"].label.endswith("(mm/sample)")
    fitted.model.save(tmp_path / "model.json")
    model = pj.Model.load(tmp_path / "model.json")
    later = model.predict(record.part(1000, len(record)))
    assert np.abs(later.output - z[1000:]).max() < 0.01 * np.ptp(z)
    export_c(model, tmp_path / "c")
    readme = (tmp_path / "c" / "README.md").read_text()
    assert "no clock" in readme
    assert " Hz" not in readme
    with pytest.raises(pj.InputError, match=r"has no clock.*leave the rate out"):
        export_c(model, tmp_path / "d", rate_hz=100)


# --- layouts of instruments -----------------------------------------------------------------------

K = 240
T = np.arange(K) / 100
U = 5 * np.sin(2 * np.pi * T) * (1 - T / 4)
Z = 0.7 * U + 0.4 * np.sign(np.gradient(U)) * np.sqrt(np.abs(U) + 0.1)
ONES = np.arange(1.0, K + 1)


@dataclass
class Layout:
    """A file of an instrument: its text, where it is described, and what is taken of it."""

    source: str
    text: str
    time: str | None
    input: str
    output: str
    units: tuple[str, str]


def rows(*columns, sep="\t", decimal=".", quote=""):
    """Lines of the columns; texts stand in every row, arrays give a number a row."""
    cells = [
        [c] * K if isinstance(c, str) else [f"{v:.12g}".replace(".", decimal) for v in c]
        for c in columns
    ]
    return "".join(sep.join(quote + c + quote for c in row) + "\n" for row in zip(*cells))  # noqa: B905


QD = "[Header]\nTITLE,\nBYAPP,{app},1.0\nINFO,x,SAMPLE_MATERIAL\n[Data]\n"
LAYOUTS = {
    "qd_mpms_xl.dat": Layout(
        "MPMS XL user's manual, Quantum Design",
        QD.format(app="MPMS") + "Time,Comment,Field (Oe),Temperature (K),Long Moment (emu),"
        "Long Scan Std Dev,Long Reg Fit\n"
        + rows(3.6e9 + T, "", U, 5 + 0 * T, Z, 1e-6 * ONES, "0.9", sep=","),
        "Time", "Field (Oe)", "Long Moment (emu)", ("Oe", "emu"),
    ),
    "qd_acms.dat": Layout(
        "PPMS ACMS option manual, Quantum Design",
        QD.format(app="ACMS") + "Comment,Time Stamp (sec),Temperature (K),Magnetic Field (Oe),"
        "M-DC (emu),M-Std.Dev. (emu)\n"
        + rows("", 3.6e9 + T, 5 + 0 * T, U, Z, 1e-6 * ONES, sep=","),
        "Time Stamp (sec)", "Magnetic Field (Oe)", "M-DC (emu)", ("Oe", "emu"),
    ),
    "qd_resistivity.dat": Layout(
        "PPMS resistivity option manual, Quantum Design",
        QD.format(app="Resistivity") + "Comment,Time Stamp (sec),Status (code),Temperature (K),"
        "Magnetic Field (Oe),Bridge 1 Resistance (Ohms),Bridge 1 Excitation (uA)\n"
        + rows("", 3.6e9 + T, "4401", 2 + 0 * T, U, Z, "10", sep=","),
        "Time Stamp (sec)", "Magnetic Field (Oe)", "Bridge 1 Resistance (Ohms)", ("Oe", "Ohms"),
    ),
    "lakeshore_8600.csv": Layout(
        "8600 Series VSM user's manual, Lake Shore Cryotronics",
        "##HEADER\n#INSTRUMENT,8600 VSM\n#SAMPLE,example\n##DATA TABLE\nStep,Iteration,Segment,"
        "Field [Oe],Moment (m) [emu],Time Stamp [s],Field Status,Moment Status\n"
        + rows("1", "1", "1", U, Z, T, "0", "0", sep=","),
        "Time Stamp [s]", "Field [Oe]", "Moment (m) [emu]", ("Oe", "emu"),
    ),
    "lakeshore_7400.txt": Layout(
        "7400 Series VSM user's manual, Lake Shore Cryotronics",
        "Sample ID: example\nStart Time: 11:02:10 AM\nSample Mass = 12.1 mg\n\n"
        "Field(G)\tMoment(emu)\n" + rows(U, Z),
        None, "Field(G)", "Moment(emu)", ("G", "emu"),
    ),
    "microsense.VHD": Layout(
        "EasyVSM data file, as its users read it (github.com, VSM_GenExtract)",
        "@Date: 1/2/2020\n@Column Contents:\nColumn 0: Time since start, Time [s]\n"
        "Column 1: Applied Field, Applied Field [Oe]\nColumn 2: Signal parallel, Moment [emu]\n"
        "@@END Columns\n@@End of Header.\n@@Data\nNew Section: Section 0:\n"
        + rows(T, U, Z, sep="   ") + "@@END Data.\n",
        "Time since start, Time [s]", "Applied Field, Applied Field [Oe]",
        "Signal parallel, Moment [emu]", ("Oe", "emu"),
    ),
    "loop.hys.vftb": Layout(
        "RockPy (github.com/volkm/RockPy), writer of VFTB files",
        "name: example\tweight: 102 mg\n\nSet 1:\n field / Oe\tmag / emu / g\ttemp / centigrade\t"
        "time / s\tstd dev / %\tsuscep / emu / g / Oe\n" + rows(U, Z, "21.5", T, "1", "0"),
        "time / s", "field / Oe", "mag / emu / g", ("Oe", "emu/g"),
    ),
    "aixacct_e.dat": Layout(
        "TF Analyzer 2000 operating manual, aixACCT Systems",
        "DynamicHysteresis\nSampleName: example\nTable 1\nHysteresis Frequency [Hz]: 1\n"
        "Time [s]\tE [kV/cm]\tI1 [A]\tP [uC/cm2]\n" + rows(T, U, np.gradient(Z), Z),
        "Time [s]", "E [kV/cm]", "P [uC/cm2]", ("kV/cm", "uC/cm2"),
    ),
    "radiant.txt": Layout(
        "Vision manual, Radiant Technologies",
        "Radiant Technologies Vision\nHysteresis: example\nSample Area (cm2): 1e-4\n\n"
        "Point\tTime (ms)\tDrive Voltage\tMeasured Polarization\n" + rows(ONES, 1000 * T, U, Z),
        "Time (ms)", "Drive Voltage", "Measured Polarization", ("V", "uC/cm2"),
    ),
    "instron_bluehill.csv": Layout(
        "Bluehill Universal reference, Instron: raw data file",
        '"Specimen label","1"\n"Rate 1","2.0","mm/min"\n\n"Time","Extension","Load"\n'
        '"(s)","(mm)","(N)"\n' + rows(T, U, Z, sep=",", quote='"'),
        "Time", "Extension", "Load", ("mm", "N"),
    ),
    "instron_wavematrix.csv": Layout(
        "WaveMatrix2 reference, Instron: tracking file",
        "Total Time (s),Cycle Elapsed Time (s),Total Cycles,Elapsed Cycles,Step,"
        "Position(Linear:Digital Position) (mm),Load(Linear:Load) (kN)\n"
        + rows(T, T % 1, np.floor(T), np.floor(T), "1", U, Z, sep=","),
        "Total Time (s)", "Position(Linear:Digital Position) (mm)", "Load(Linear:Load) (kN)",
        ("mm", "kN"),
    ),
    "mts_station.dat": Layout(
        "MTS Series 793 data acquisition, MTS Systems: text data file",
        "MTS793|MPT|ENU|1|2|.|/|:|1|0|0|A\n\nData Acquisition: Timed data\t\t\t"
        "Time:\t12.3\tSec\nTime\tAxial Displacement\tAxial Force\nSec\tmm\tkN\n" + rows(T, U, Z),
        "Time", "Axial Displacement", "Axial Force", ("mm", "kN"),
    ),
    "mts_german.dat": Layout(
        "header of Series 793 files that their owners have published",
        "MTS793|MPT|DEU|1|2|,|.|:|49|1|1|A\n\nDatenerfassung: Zeit\t\t\tZeit:\t10,0\tSek\n"
        "Zeit\tKolbenweg\tKraft\nSek\tmm\tkN\n" + rows(T, U, Z, decimal=","),
        "Zeit", "Kolbenweg", "Kraft", ("mm", "kN"),
    ),
    "mts_testsuite.csv": Layout(
        "TestSuite TW user guide, MTS Systems: export",
        "Crosshead ,Load ,Time \nmm,N,s\n" + rows(U, Z, T, sep=","),
        "Time", "Crosshead", "Load", ("mm", "N"),
    ),
    "zwick.TRA": Layout(
        "testXpert III, ZwickRoell: ASCII export",
        "Prüfzeit;Standardweg;Standardkraft\ns;mm;N\n" + rows(T, U, Z, sep=";", decimal=","),
        "Prüfzeit", "Standardweg", "Standardkraft", ("mm", "N"),
    ),
    "shimadzu.csv": Layout(
        "Trapezium X reference, Shimadzu: raw data",
        "Name,1 _ 1,,\nTime,Stroke,Force\nsec,mm,N\n" + rows(T, U, Z, sep=","),
        "Time", "Stroke", "Force", ("mm", "N"),
    ),
    "electroforce.csv": Layout(
        "WinTest user manual, TA ElectroForce",
        "Points,Elapsed Time (Sec),Disp (mm),Load (N)\n" + rows(ONES, T, U, Z, sep=","),
        "Elapsed Time (Sec)", "Disp (mm)", "Load (N)", ("mm", "N"),
    ),
    "extensometer.txt": Layout(
        "published tests of steel coupons: engineering strain and stress",
        "strain [mm/mm]\tstress [MPa]\n" + rows(U / 100, Z),
        None, "strain [mm/mm]", "stress [MPa]", ("mm/mm", "MPa"),
    ),
    "wall.csv": Layout(
        "published tests of masonry walls: force first",
        "Horizontal load (kN),Top displacement (mm)\n" + rows(Z, U, sep=","),
        None, "Top displacement (mm)", "Horizontal load (kN)", ("mm", "kN"),
    ),
    "biologic.mpt": Layout(
        "EC-Lab user's manual, BioLogic: text export",
        "EC-Lab ASCII FILE\nNb header lines : 4\n\nmode\tox/red\terror\tNs changes\ttime/s\t"
        "control/V\tEwe/V\t<I>/mA\t(Q-Qo)/mA.h\n"
        + rows("1", "1", "0", "0", T, U, Z, np.gradient(U), U, decimal=","),
        "time/s", "(Q-Qo)/mA.h", "Ewe/V", ("mA.h", "V"),
    ),
    "arbin.csv": Layout(
        "MITS Pro manual, Arbin Instruments",
        "Data_Point,Date_Time,Test_Time(s),Step_Time(s),Step_Index,Cycle_Index,Current(A),"
        "Voltage(V),Charge_Capacity(Ah),Discharge_Capacity(Ah)\n"
        + rows(ONES, "", T, T % 1, "1", "1", np.gradient(U), Z, "0", U, sep=","),
        "Test_Time(s)", "Discharge_Capacity(Ah)", "Voltage(V)", ("Ah", "V"),
    ),
    "gamry.DTA": Layout(
        "Framework data file format, Gamry Instruments",
        "EXPLAIN\nTAG\tCV\nTITLE\tLABEL\tCyclic\tTest\nCURVE1\tTABLE\t240\n"
        "\tPt\tT\tVf\tIm\tSig\n\t#\ts\tV vs. Ref.\tA\tV\n" + rows("", ONES, T, U, Z, "0"),
        "T", "Vf", "Im", ("V", "A"),
    ),
    "chi_cv.csv": Layout(
        "CH Instruments electrochemical software manual: text file",
        "Jan. 2, 2020   11:00:00\nCyclic Voltammetry\nInit E (V) = 0\nScan Rate (V/s) = 0.1\n\n"
        "Potential/V, Current/A\n\n" + rows(U, Z, sep=", "),
        None, "Potential/V", "Current/A", ("V", "A"),
    ),
    "keithley.csv": Layout(
        "2450 reference manual, Keithley: buffer saved as CSV",
        "Index,Time (s),Voltage (V),Current (A)\n" + rows(ONES, T, U, Z, sep=","),
        "Time (s)", "Voltage (V)", "Current (A)", ("V", "A"),
    ),
    "pi_gcs.dat": Layout(
        "GCS array data format, Physik Instrumente",
        "# REM E-712\n# VERSION = 1\n# TYPE = 1\n# SEPARATOR = 32\n# DIM = 2\n"
        "# SAMPLE_TIME = 0.01\n# NDATA = 240\n# NAME0 = Target Position of axis 1\n"
        "# NAME1 = Current Position of axis 1\n# END_HEADER\n" + rows(U, Z, sep=" "),
        "time", "Target Position of axis 1", "Current Position of axis 1", ("", ""),
    ),
    "brockhaus.txt": Layout(
        "MPG 200 manual, Brockhaus Measurements: exported curve",
        "Material: M270-50A\nFrequency: 50 Hz\nH [A/m]\tJ [mT]\n" + rows(U, Z),
        None, "H [A/m]", "J [mT]", ("A/m", "mT"),
    ),
    "catman.asc": Layout(
        "catman easy manual, HBM: ASCII export",
        "HBM_CATMAN_DATAFILE_40\nTime 1 [s]\tForce [kN]\tDisplacement [mm]\n" + rows(T, Z, U),
        "Time 1 [s]", "Displacement [mm]", "Force [kN]", ("mm", "kN"),
    ),
    "dic_strain.csv": Layout(
        "published tests of shape-memory wire: temperature and strain",
        "time [s],Temperature [°C],Strain [%]\n" + rows(T, U, Z, sep=","),
        "time [s]", "Temperature [°C]", "Strain [%]", ("°C", "%"),
    ),
    "pneumatic.csv": Layout(
        "published tests of soft actuators",
        "timestamp_ms,pressure_kPa,angle_deg\n" + rows(1000 * T, U, Z, sep=","),
        "timestamp_ms", "pressure_kPa", "angle_deg", ("kPa", "deg"),
    ),
    "stretch_sensor.csv": Layout(
        "published tests of stretch sensors",
        "Time (s),Strain (%),Resistance (Ohm)\n" + rows(T, U, Z, sep=","),
        "Time (s)", "Strain (%)", "Resistance (Ohm)", ("%", "Ohm"),
    ),
    "damper.csv": Layout(
        "published tests of magnetorheological dampers",
        "Time [s],Displacement [mm],Force [N],Current [A]\n"
        + rows(T, U, Z, 1 + 0 * T, sep=","),
        "Time [s]", "Displacement [mm]", "Force [N]", ("mm", "N"),
    ),
    "torsion.csv": Layout(
        "published tests of joints", "angle [deg],torque [Nm]\n" + rows(U, Z, sep=","),
        None, "angle [deg]", "torque [Nm]", ("deg", "Nm"),
    ),
    "all_zero_time.csv": Layout(
        "loggers whose clock was never set",
        "time_s,u_V,z_um\n" + rows(0 * T, U, Z, sep=","),
        None, "u_V", "z_um", ("V", "um"),
    ),
    "opensees.out": Layout(
        "OpenSees recorders: no names, time first", rows(T, U, Z, sep=" "), "1", "2", "3", ("", ""),
    ),
    "misspelt.csv": Layout(
        "names as people type them",
        "Tme [s],Displacment [mm],Forec [kN]\n" + rows(T, U, Z, sep=","),
        "Tme [s]", "Displacment [mm]", "Forec [kN]", ("mm", "kN"),
    ),
    "two_names_rows.csv": Layout(
        "spreadsheets with a row of groups above the names",
        "Run 1,,\nTime,Displacement,Force\n(s),(mm),(kN)\n" + rows(T, U, Z, sep=","),
        "Time", "Displacement", "Force", ("mm", "kN"),
    ),
    "pandas_split.json": Layout(
        "pandas.DataFrame.to_json(orient='split')",
        json.dumps({"columns": ["t_s", "u_V", "z_um"], "index": list(range(K)),
                    "data": np.column_stack([T, U, Z]).tolist()}),
        "t_s", "u_V", "z_um", ("V", "um"),
    ),
}  # fmt: skip
NAMES_ELSEWHERE = {
    "chinese.csv": ("时间(s),位移(mm),荷载(kN)", "kN"),
    "japanese.csv": ("時間[s],変位[mm],荷重[N]", "N"),
    "russian.csv": ("Время, с;Перемещение, мм;Усилие, кН", "kN"),
    "french.csv": ("Temps (s);Déplacement (mm);Force (N)", "N"),
    "spanish.csv": ("Tiempo (s);Desplazamiento (mm);Fuerza (N)", "N"),
}
for file, (head, force) in NAMES_ELSEWHERE.items():
    between, point = (";", ",") if ";" in head else (",", ".")
    time, driven, output = head.split(between)
    LAYOUTS[file] = Layout(
        f"exports of test machines in {file.removesuffix('.csv').title()}",
        f"{head}\n{rows(T, U, Z, sep=between, decimal=point)}",
        time, driven, output, ("mm", force),
    )  # fmt: skip


@pytest.mark.parametrize("name", LAYOUTS)
def test_a_layout_is_opened_by_itself(tmp_path, name):
    case = LAYOUTS[name]
    path = tmp_path / name
    path.write_text(case.text, encoding="utf-8")
    said = []
    record = pj.Record.load(path, announce=said.append)
    channels = {role: channel.name for role, channel in record.channels.items()}
    assert channels == {
        "time": case.time or "sample", "input": case.input, "output": case.output
    }, said  # fmt: skip
    assert (record.input_unit, record.output_unit) == case.units
    np.testing.assert_allclose(record.input, U / 100 if "coupons" in case.source else U, rtol=1e-7)
    np.testing.assert_allclose(record.output, Z, rtol=1e-7)
    step = 1.0 if case.time is None else 0.01
    np.testing.assert_allclose(np.diff(record.time), step, rtol=1e-4)
    assert case.source


# --- tables, runs and clocks ----------------------------------------------------------------------


def test_runs_whose_time_begins_anew_and_sheets_are_records_of_their_own(tmp_path):
    path = tmp_path / "runs.csv"
    path.write_text("t_s,u_V,z_um\n" + rows(T, U, Z, sep=",") + rows(T, 0.5 * U, Z, sep=","))
    first, second = pj.Record.load_all(path)
    np.testing.assert_allclose(second.input, 0.5 * U, rtol=1e-9)
    assert (first.name, second.name) == ("runs.csv, table 1", "runs.csv, table 2")
    with pytest.raises(pj.InputError, match="runs backward"):
        pj.Record.load(path)  # by itself it is one table
    assert pj.Record.load(path, table=2).sha256 == second.sha256
    with pytest.raises(pj.InputError, match=r"table 3 is asked for, and there are 2"):
        pj.Record.load(path, table=3)
    back = T.copy()
    back[100:] -= 0.5  # a clock that jumps back once is no new run
    path.write_text("t_s,u_V,z_um\n" + rows(back, U, Z, sep=","))
    with pytest.raises(pj.InputError, match=r"row 102: time runs backward"):
        pj.Record.load_all(path)


def test_signals_with_clocks_of_their_own_are_brought_on_one(tmp_path):
    path = tmp_path / "clocks.csv"
    path.write_text("t1_s,u_V,t2_s,z_um\n" + rows(T, U, T + 0.004, Z, sep=","))
    said = []
    record = pj.Record.load(path, announce=said.append)
    assert any("t2_s begins 4 ms later than t1_s" in line for line in said)
    np.testing.assert_allclose(record.input, U[1:], rtol=1e-9)
    np.testing.assert_allclose(record.output, np.interp(T[1:], T + 0.004, Z), rtol=1e-9)
    # The same time twice, in another unit or from another day, is one clock.
    path.write_text("t_s,u_V,time_ms,z_um\n" + rows(T, U, 1000 * T, Z, sep=","))
    assert pj.Record.load(path).channels["time"].name == "t_s"


def test_a_unique_beginning_of_a_name_is_enough(tmp_path, capsys):
    path = tmp_path / "long.csv"
    path.write_text("Time [s],Actuator force A,Actuator force B,Gap\n" + rows(T, U, Z, Z, sep=","))
    record = pj.Record.load(path, input="Gap", output="Actuator force A")
    assert record.channels["output"].name == "Actuator force A"
    assert (
        pj.Record.load(path, input="Ga", output="Actuator force B").channels["input"].name == "Gap"
    )
    with pytest.raises(pj.InputError, match="begin with 'Act'; say which column with --output"):
        pj.Record.load(path, input="Gap", output="Act")


# --- odd input: what was made of it, or why not ---------------------------------------------------

CSV = rows(T, U, Z, sep=",")
ODD = {
    "two rows of names": ("Time,Voltage,Position\nt,U,z\n" + CSV, "row 2, names once more (t,U,z)"),
    "names, names, units": ("Time,Voltage,Position\nt,U,z\ns,V,um\n" + CSV, "names once more"),
    "units twice": ("Time [s],U [V],z [um]\n(s),(V),(um)\n" + CSV, "output z [um]"),
    "units that disagree": (
        "t [s],u [V],z [um]\n(ms),(V),(um)\n" + CSV, "says ms where a name says s",
    ),
    "empty columns": (
        "t,u,gap,z,more\n" + rows(T, U, "", Z, "", sep=","), "nothing stands in gap, more"
    ),
    "remarks below": ("t,u,z\n" + CSV + "End of data\n", "row 242 on (End of data)"),
    "decimal commas in quotes": (
        "t,u,z\n" + rows(T, U, Z, sep=",", decimal=",", quote='"'), "input u, output z",
    ),
}  # fmt: skip
ODD_REFUSED = {
    "decimal commas between commas": (
        "t,u,z\n" + rows(T, U, Z, sep=",", decimal=","), "complete or remove the row",
    ),
    "names twice": ("t,u,z,z\n" + rows(T, U, Z, Z, sep=","), "'z' stands 2 times"),
    "a hundred thousand columns": (
        ",".join(f"c{k}" for k in range(10**5)) + "\n" + "1," * 10**5, "there are 100,00",
    ),
    "settings only": ("Instrument: x\nRate: 5 Hz\nOperator: me\n", "holds settings only"),
    "one column": ("".join(f"{u:.5f}\n" for u in U), "an input and an output, each a column"),
}  # fmt: skip


@pytest.mark.parametrize("name", ODD)
def test_odd_input_is_opened_and_what_was_made_of_it_is_said(tmp_path, name):
    text, words = ODD[name]
    path, said = tmp_path / "odd.csv", []
    path.write_text(text)
    (record,) = pj.Record.load_all(path, announce=said.append)
    np.testing.assert_allclose([record.input, record.output], [U, Z], rtol=1e-7)
    assert any(words in line for line in said), said


@pytest.mark.parametrize("name", ODD_REFUSED)
def test_odd_input_is_refused_with_why(tmp_path, name):
    text, words = ODD_REFUSED[name]
    path = tmp_path / "odd.csv"
    path.write_text(text)
    with pytest.raises(pj.InputError) as caught:
        pj.Record.load_all(path)
    assert words in str(caught.value)


# --- whatever comes, one line ---------------------------------------------------------------------

NAMES = [
    "t", "Time [s]", "", "Force (kN)", "Force (kN)", "Weg [mm]", "x", "Status", "µ", "1", "B, mT"
]  # fmt: skip
CELLS = [
    "", "nan", "text", "1,5", "1e9", "-", "0", '"', "12 V", "#", "\ufeff", "2024-01-01 00:00:00"
]  # fmt: skip


@st.composite
def damaged(draw):
    """A table with odd names, separators, torn rows, cells that are none, and tables behind it."""
    width, sep = draw(st.integers(1, 6)), draw(st.sampled_from([",", ";", "\t", " ", "|"]))
    count = draw(st.integers(0, 70))
    signal = [np.arange(count) / 10, np.sin(np.arange(count) / 5), np.cos(np.arange(count) / 7)]
    table = [[f"{signal[k % 3][row]:.4g}" for k in range(width)] for row in range(count)]
    for row, column in draw(st.lists(st.tuples(st.integers(0, 69), st.integers(0, 5)), max_size=3)):
        if row < count and column < width:
            table[row][column] = draw(st.sampled_from(CELLS))
    lines = [sep.join(row) for row in table]
    for row in draw(st.lists(st.integers(0, 69), max_size=2)):
        if row < count:
            lines[row] = draw(
                st.sampled_from(["", lines[row][:-3], lines[row] + sep, "[Data]", "# x"])
            )
    head = [sep.join(draw(st.lists(st.sampled_from(NAMES), min_size=width, max_size=width)))]
    head *= draw(st.integers(0, 2))
    head += draw(st.sampled_from([[], [sep.join(["(s)"] * width)], ["Table 1", "Rate: 5 Hz"]]))
    text = "\n".join([*head, *lines, *draw(st.sampled_from([[], [""], ["", *head, *lines, ""]]))])
    return text.encode(
        draw(st.sampled_from(["utf-8", "utf-8-sig", "utf-16", "latin-1"])), "replace"
    )


@given(damaged())
def test_no_text_gives_a_traceback_and_what_is_opened_says_what_was_made_of_it(content):
    said, refusal = [], ""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "damaged.csv"
        path.write_bytes(content)
        refusal = opened_or_refused(path, said)
    assert "\n" not in refusal
    assert not refusal or path.name in refusal


def opened_or_refused(path, said):
    """Why a file is refused; empty if its records are sound and what was made of it is said."""
    try:
        for record in pj.Record.load_all(path, announce=said.append):
            assert np.isfinite(record.input).all()
            assert np.all(np.diff(record.time) > 0)
            assert any("guessed from" in line or "read as a file of" in line for line in said)
            assert record.has_clock or any("samples are counted" in line for line in said)
    except pj.InputError as refusal:
        return str(refusal)
    return ""
