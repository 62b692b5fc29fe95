"""Files in the layouts that people keep: opened with no option, asked once, or refused with why.

Those of `tests/files` hold simulated numbers in layouts met in public repositories of this field;
the others are typed here after the manuals and published samples that stand beside them.
"""

import json
import tempfile
from dataclasses import replace
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
from preisach_jax.look.examination import look_at_file
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
    "tabs_no_names_ms.csv": ("column 1 is the time", "--time 1 --input 2 --output 4 --unit time=s"),
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
    assert main(["look", str(FILES / name)]) == 0
    assert "--input" in capsys.readouterr().out
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


def test_what_several_tables_show_is_judged_of_all_together():
    path = FILES / "ferroelectric_three_tables.dat"  # one loop each, of 10 to 1 ms
    why = {each.effect: each.why for each in look_at_file(path).prospects}
    assert why["viscosity"] == "rates from 2 kV/s to 20 kV/s (1.0 decades)"
    assert why["drift"] == "no loop comes again"  # it begins anew in each
    alone = {each.effect: each.why for each in look_at_file(path, table=2).prospects}
    assert alone["viscosity"] == "one rate, 6 kV/s"


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
    middle = len(merged) // 2
    for values, clock, own in ((merged.output, 2, 0), (merged.input, 4, 3)):
        expected = np.interp(merged.time[middle], clocks[clock], clocks[own])
        assert values[middle] == pytest.approx(expected, rel=1e-3)


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
    with pytest.raises(pj.InputError, match=r"'creep' needs a clock"):
        pj.fit(record, ["creep"])
    with pytest.raises(pj.InputError, match=r"'creep' needs a clock"):
        pj.explore(record, levels=5).add("creep")
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
    rig = tmp_path / "rig.csv"
    np.savetxt(rig, np.stack([u, z], 1), "%.9g", ",", header="u_mm,z_kN", comments="")
    record = pj.Record.load(rig)
    assert not record.has_clock
    fitted = pj.fit(record, levels=9, effects=["ageing"])
    tau = fitted.model.parameters["ageing"]["tau_s"]
    assert tau.low < 60 < tau.high
    assert tau.high < 1.1 * tau.low
    assert tau.unit == "mm"
    labels = [record_axes(record)[axis].label for axis in ("time", "since", "rate")]
    assert [label.split()[-1] for label in labels] == ["sample", "(samples)", "(mm/sample)"]
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

# What columns hold, by a letter: times, an input and an output; and what is none of them.
TIMES = {"t": T, "m": 1000 * T, "e": 3.6e9 + T}
INPUTS = {"u": U, "%": U / 100}
HELD = {**TIMES, **INPUTS, "z": Z, "n": np.arange(1.0, K + 1), "c": T % 1, "f": np.floor(T),
        "s": 5 + 0 * T, "o": 0 * T, "i": np.gradient(Z), "v": U, "-": "", "0": "0", "1": "1",
        }  # fmt: skip


def rows(*columns, sep=",", decimal=".", quote=""):
    """Lines of the columns; texts stand in every row, arrays give a number a row."""
    cells = [
        [c] * K if isinstance(c, str) else [f"{v:.12g}".replace(".", decimal) for v in c]
        for c in columns
    ]
    return "".join(sep.join(quote + c + quote for c in row) + "\n" for row in zip(*cells))  # noqa: B905


def layout(names, held, units, above="", below="", taken=None, sep=",", **form):
    """Text of a file, what its columns hold, which of them are taken, and their units."""
    if taken is None:
        name_of = dict(zip(held, names.split(sep), strict=True))
        taken = [
            next((name.strip(' "') for letter, name in name_of.items() if letter in role), None)
            for role in (TIMES, INPUTS, "z")
        ]
    head = f"{names}\n" if names else ""
    text = f"{above}{head}{below}{rows(*[HELD[k] for k in held], sep=sep, **form)}"
    return text, held, taken, units.split(" ")


QD = "[Header]\nTITLE,\nBYAPP,{},1.0\nINFO,x,SAMPLE_MATERIAL\n[Data]\n"
# Those of instruments after their manuals; preisach_jax/record/layouts.py names most of these.
LAYOUTS = {
    "qd_mpms_xl.dat": layout(
        "Time,Comment,Field (Oe),Temperature (K),Long Moment (emu),Long Scan Std Dev,Long Reg Fit",
        "e-usz01", "Oe emu", above=QD.format("MPMS"),
    ),
    "qd_resistivity.dat": layout(
        "Comment,Time Stamp (sec),Status (code),Temperature (K),Magnetic Field (Oe),"
        "Bridge 1 Resistance (Ohms),Bridge 1 Excitation (uA)",
        "-e1suz0", "Oe Ohms", above=QD.format("Resistivity"),
    ),
    "lakeshore_8600.csv": layout(
        "Step,Iteration,Segment,Field [Oe],Moment (m) [emu],Time Stamp [s],Field Status,Moment "
        "Status", "1fcuzt0o", "Oe emu",
        above="##HEADER\n#INSTRUMENT,8600 VSM\n#SAMPLE,example\n##DATA TABLE\n",
    ),
    "lakeshore_7400.txt": layout(
        "Field(G)\tMoment(emu)", "uz", "G emu", sep="\t",
        above="Sample ID: example\nStart Time: 11:02:10 AM\nSample Mass = 12.1 mg\n\n",
    ),
    "microsense.VHD": layout(
        "", "tuz", "Oe emu", sep="   ",
        taken=["Time since start, Time [s]", "Applied Field, Applied Field [Oe]",
               "Signal parallel, Moment [emu]"],
        above="@Date: 1/2/2020\n@Column Contents:\nColumn 0: Time since start, Time [s]\n"
        "Column 1: Applied Field, Applied Field [Oe]\nColumn 2: Signal parallel, Moment [emu]\n"
        "@@END Columns\n@@End of Header.\n@@Data\nNew Section: Section 0:\n",
    ),
    "loop.hys.vftb": layout(  # as github.com/volkm/RockPy writes them
        " field / Oe\tmag / emu / g\ttemp / centigrade\ttime / s\tstd dev / %\tsuscep / emu / g / "
        "Oe", "uz1t0o", "Oe emu/g", sep="\t", above="name: example\tweight: 102 mg\n\nSet 1:\n",
    ),
    "aixacct_e.dat": layout(
        "Time [s]\tE [kV/cm]\tI1 [A]\tP [uC/cm2]", "tuiz", "kV/cm uC/cm2", sep="\t",
        above="DynamicHysteresis\nSampleName: x\nTable 1\nHysteresis Frequency [Hz]: 1\n",
    ),
    "radiant.txt": layout(
        "Point\tTime (ms)\tDrive Voltage\tMeasured Polarization", "nmuz", "V uC/cm2", sep="\t",
        above="Radiant Technologies Vision\nHysteresis: x\nSample Area (cm2): 1e-4\n\n",
    ),
    "instron_bluehill.csv": layout(
        '"Time","Extension","Load"', "tuz", "mm N", quote='"', below='"(s)","(mm)","(N)"\n',
        above='"Specimen label","1"\n"Rate 1","2.0","mm/min"\n\n',
    ),
    "mts_station.dat": layout(  # Series 793
        "Time\tAxial Displacement\tAxial Force", "tuz", "mm kN", sep="\t", below="Sec\tmm\tkN\n",
        above="MTS793|MPT|ENU|1|2|.|/|:|1|0|0|A\n\n"
        "Data Acquisition: Timed data\t\t\tTime:\t12.3\tSec\n",
    ),
    "mts_german.dat": layout(  # as their owners have published them
        "Zeit\tKolbenweg\tKraft", "tuz", "mm kN", sep="\t", decimal=",", below="Sek\tmm\tkN\n",
        above="MTS793|MPT|DEU|1|2|,|.|:|49|1|1|A\n\nDatenerfassung: Zeit\t\t\tZeit:\t10,0\tSek\n",
    ),
    "mts_testsuite.csv": layout("Crosshead ,Load ,Time ", "uzt", "mm N", below="mm,N,s\n"),
    "zwick.TRA": layout(  # testXpert III
        "Prüfzeit;Standardweg;Standardkraft", "tuz", "mm N", sep=";", decimal=",",
        below="s;mm;N\n",
    ),
    "shimadzu.csv": layout(  # Trapezium X
        "Time,Stroke,Force", "tuz", "mm N", above="Name,1 _ 1,,\n", below="sec,mm,N\n"
    ),
    "electroforce.csv": layout("Points,Elapsed Time (Sec),Disp (mm),Load (N)", "ntuz", "mm N"),
    "biologic.mpt": layout(
        "mode\tox/red\terror\tNs changes\ttime/s\tcontrol/V\tEwe/V\t<I>/mA\t(Q-Qo)/mA.h",
        "1n0otvziu", "mA.h V", sep="\t", decimal=",",
        above="EC-Lab ASCII FILE\nNb header lines : 4\n\n",
    ),
    "arbin.csv": layout(
        "Data_Point,Date_Time,Test_Time(s),Step_Time(s),Step_Index,Cycle_Index,Current(A),"
        "Voltage(V),Charge_Capacity(Ah),Discharge_Capacity(Ah)", "n-tc1fiz0u", "Ah V",
    ),
    "gamry.DTA": layout(
        "\tPt\tT\tVf\tIm\tSig", "-ntuz0", "V A", sep="\t", below="\t#\ts\tV vs. Ref.\tA\tV\n",
        above="EXPLAIN\nTAG\tCV\nTITLE\tLABEL\tCyclic\tTest\nCURVE1\tTABLE\t240\n",
    ),
    "chi_cv.csv": layout(
        "Potential/V, Current/A", "uz", "V A", sep=", ", below="\n",
        above="Jan. 2, 2020   11:00:00\nCyclic Voltammetry\nInit E (V) = 0\n\n",
    ),
    "keithley.csv": layout("Index,Time (s),Voltage (V),Current (A)", "ntuz", "V A"),
    "pi_gcs.dat": layout(
        "", "uz", " ", sep=" ",
        taken=["time", "Target Position of axis 1", "Current Position of axis 1"],
        above="# REM E-712\n# SEPARATOR = 32\n# DIM = 2\n# SAMPLE_TIME = 0.01\n# NDATA = 240\n"
        "# NAME0 = Target Position of axis 1\n# NAME1 = Current Position of axis 1\n# END_HEADER\n",
    ),
    "brockhaus.txt": layout(
        "H [A/m]\tJ [mT]", "uz", "A/m mT", sep="\t", above="Material: x\nFrequency: 50 Hz\n"
    ),
    "catman.asc": layout(
        "Time 1 [s]\tForce [kN]\tDisplacement [mm]", "tzu", "mm kN", sep="\t",
        above="HBM_CATMAN_DATAFILE_40\n",
    ),
    # Published tests of many kinds of specimens.
    "picoscope.csv": layout("Time,Channel A,Channel B", "muz", "V V", below="(ms),(V),(V)\n\n"),
    "waveforms.csv": layout(  # Digilent WaveForms
        "Time (s),Channel 1 (V),Channel 2 (V)", "tuz", "V V",
        above="#Digilent WaveForms Oscilloscope Acquisition\n#Sample rate: 100Hz\n\n",
    ),
    "moku.csv": layout(  # Liquid Instruments
        "% Time (s), Channel A (V), Channel B (V)", "tuz", "V V", above="% Oscilloscope\n",
        taken=["Time (s)", "Channel A (V)", "Channel B (V)"],
    ),
    "nova.txt": layout(  # Metrohm Autolab
        "Potential applied (V);Time (s);WE(1).Current (A);WE(1).Potential (V);Scan;Index", "utzu1n",
        "V A", sep=";", taken=["Time (s)", "Potential applied (V)", "WE(1).Current (A)"],
    ),
    "dewesoft.txt": layout(
        "Time (s)\tForce (kN)\tDisplacement (mm)", "tzu", "mm kN", sep="\t",
        above="Data info\nFile name: a.dxd\nNumber of channels: 2\n\n",
    ),
    "coupon.txt": layout("strain [mm/mm]\tstress [MPa]", "%z", "mm/mm MPa", sep="\t"),
    "wall.csv": layout("Horizontal load (kN),Top displacement (mm)", "zu", "mm kN"),
    "memory_wire.csv": layout("time [s],Temperature [°C],Strain [%]", "tuz", "°C %"),
    "soft_actuator.csv": layout("timestamp_ms,pressure_kPa,angle_deg", "muz", "kPa deg"),
    "stretch_sensor.csv": layout("Time (s),Strain (%),Resistance (Ohm)", "tuz", "% Ohm"),
    "damper.csv": layout("Time [s],Displacement [mm],Force [N],Current [A]", "tuzs", "mm N"),
    "torsion.csv": layout("angle [deg],torque [Nm]", "uz", "deg Nm"),
    # What programs and people write.
    "clock_never_set.csv": layout("time_s,u_V,z_um", "ouz", "V um"),
    "opensees.out": layout("", "tuz", " ", sep=" ", taken=["1", "2", "3"]),
    "misspelt.csv": layout("Tme [s],Displacment [mm],Forec [kN]", "tuz", "mm kN"),
    "pandas_split.json": (
        json.dumps({"columns": ["t_s", "u_V", "z_um"], "index": list(range(K)),
                    "data": np.column_stack([T, U, Z]).tolist()}),
        "tuz", ["t_s", "u_V", "z_um"], ["V", "um"],
    ),
    "chinese.csv": layout("时间(s),位移(mm),荷载(kN)", "tuz", "mm kN"),
    "japanese.csv": layout("時間(s),電圧(V),変位(mm)", "tuz", "V mm"),
    "russian.csv": layout(
        "Время, с;Перемещение, мм;Усилие, кН", "tuz", "mm kN", sep=";", decimal=","
    ),
}  # fmt: skip


CODE_PAGES = (("chinese.csv", "gbk"), ("japanese.csv", "cp932"), ("russian.csv", "cp1251"))


@pytest.mark.parametrize(("name", "encoding"), [*((n, "utf-8") for n in LAYOUTS), *CODE_PAGES])
def test_a_layout_is_opened_by_itself(tmp_path, name, encoding):
    text, held, (time, driven, output), units = LAYOUTS[name]
    path = tmp_path / name
    path.write_text(text, encoding=encoding)
    said = []
    record = pj.Record.load(path, announce=said.append)
    channels = {role: channel.name for role, channel in record.channels.items()}
    assert channels == {"time": time or "sample", "input": driven, "output": output}, said
    assert [record.input_unit, record.output_unit] == units
    np.testing.assert_allclose(record.input, U / 100 if "%" in held else U, rtol=1e-7)
    np.testing.assert_allclose(record.output, Z, rtol=1e-7)
    np.testing.assert_allclose(np.diff(record.time), 0.01 if time else 1.0, rtol=1e-4)


# --- tables, runs and clocks ----------------------------------------------------------------------


def test_runs_whose_time_begins_anew_and_sheets_are_records_of_their_own(tmp_path):
    path = tmp_path / "runs.csv"
    path.write_text("t_s,u_V,z_um\n" + rows(T, U, Z) + rows(T, 0.5 * U, Z))
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
    path.write_text("t_s,u_V,z_um\n" + rows(back, U, Z))
    with pytest.raises(pj.InputError, match=r"row 102: time runs backward"):
        pj.Record.load_all(path)


def test_signals_with_clocks_of_their_own_are_brought_on_one(tmp_path):
    path = tmp_path / "clocks.csv"
    path.write_text("t1_s,u_V,t2_s,z_um\n" + rows(T, U, T + 0.004, Z))
    said = []
    record = pj.Record.load(path, announce=said.append)
    assert any("t2_s begins 4 ms later than t1_s" in line for line in said)
    np.testing.assert_allclose(record.input, U[1:], rtol=1e-9)
    np.testing.assert_allclose(record.output, np.interp(T[1:], T + 0.004, Z), rtol=1e-9)
    # The same time twice, in another unit or from another day, is one clock.
    path.write_text("t_s,u_V,time_ms,z_um\n" + rows(T, U, 1000 * T, Z))
    assert pj.Record.load(path).channels["time"].name == "t_s"


def test_a_unique_beginning_of_a_name_is_enough(tmp_path):
    path = tmp_path / "long.csv"
    path.write_text("Time [s],Actuator force A,Actuator force B,Gap\n" + rows(T, U, Z, Z))
    record = pj.Record.load(path, input="Ga", output="Actuator force A")
    assert record.channels["input"].name == "Gap"
    assert record.channels["output"].name == "Actuator force A"
    with pytest.raises(pj.InputError, match="begin with 'Act'; say which column with --output"):
        pj.Record.load(path, input="Gap", output="Act")


def test_a_number_is_the_place_of_a_column_in_the_file(tmp_path):
    # Also where the instrument is known, whose layout says which column is the time.
    (tmp_path / "a.dat").write_text(LAYOUTS["qd_mpms_xl.dat"][0])
    record = pj.Record.load(tmp_path / "a.dat", time="1", input="3", output="5")
    assert [record.channels[role].name for role in ("time", "input", "output")] == [
        "Time", "Field (Oe)", "Long Moment (emu)"
    ]  # fmt: skip


# --- odd input: what was made of it, or why not ---------------------------------------------------

CSV = rows(T, U, Z)
ODD = {
    "two rows of names": ("Time,Voltage,Position\nt,U,z\n" + CSV, "row 2, names once more (t,U,z)"),
    "names, names, units": ("Time,Voltage,Position\nt,U,z\ns,V,um\n" + CSV, "names once more"),
    "numbers of channels above": (
        'Channel 1,Channel 2,Channel 3\nTime / s,H (A/m),B (T)\n"","",""\n' + CSV,
        "row 1, names once more (Channel 1,Channel 2,Channel 3)",
    ),
    "names behind a #, texts below": (
        "#t u z state\n" + CSV.replace(",", " ").replace("\n", " OK\n"), "input u, output z"
    ),
    "units twice": ("Time [s],U [V],z [um]\n(s),(V),(um)\n" + CSV, "output z [um]"),
    "units that disagree": (
        "t [s],u [V],z [um]\n(ms),(V),(um)\n" + CSV, "says ms where a name says s",
    ),
    "a name twice": (
        "t_s,u_V,z_um,z_um\n" + rows(T, U, Z, Z), "2 columns are called z_um; after the first"
    ),
    "a name twice, a number alone tells them apart": (
        "time_s,force_N,displacement_mm,force_N\n" + rows(T, Z, U, 2 * Z),
        "column force_N (2) is force_N once more and not used",
    ),
    "empty columns": (
        "t,u,gap,z,more\n" + rows(T, U, "", Z, ""), "nothing stands in gap, more"
    ),
    "remarks below": ("t,u,z\n" + CSV + "End of data\n", "row 242 on (End of data)"),
    "decimal commas in quotes": (
        "t,u,z\n" + rows(T, U, Z, decimal=",", quote='"'), "input u, output z",
    ),
}  # fmt: skip


@pytest.mark.parametrize("name", ODD)
def test_odd_input_is_opened_and_what_was_made_of_it_is_said(tmp_path, name):
    text, words = ODD[name]
    path, said = tmp_path / "odd.csv", []
    path.write_text(text)
    (record,) = pj.Record.load_all(path, announce=said.append)
    np.testing.assert_allclose([record.input, record.output], [U, Z], rtol=1e-7)
    assert any(words in line for line in said), said


PUT_IN = [
    "", "nan", "text", "1,5", "1e9", "-", "0", '"', "12 V", "#", "\ufeff", "Force (kN)", "(s)",
    "\t", ";", "\n", "[Data]\n", "Rate: 5 Hz\n", "2024-01-01 00:00:00",
]  # fmt: skip
DAMAGE = st.tuples(st.floats(0, 1), st.integers(0, 40), st.sampled_from(PUT_IN))


@given(st.sampled_from(sorted(LAYOUTS)), st.lists(DAMAGE, min_size=1, max_size=3), st.booleans())
def test_no_text_gives_a_traceback_and_what_is_opened_says_what_was_made_of_it(name, damage, twice):
    text = LAYOUTS[name][0]
    for place, left_out, put_in in damage:
        at = round(place**3 * len(text))  # often among the names and what stands above them
        text = text[:at] + put_in + text[at + left_out :]
    said = []
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "damaged.csv"
        path.write_text(text * (1 + twice), encoding="utf-8")
        try:
            records, refusal = pj.Record.load_all(path, announce=said.append), path.name
        except pj.InputError as error:
            records, refusal = [], str(error)
    assert path.name in refusal
    assert "\n" not in refusal
    for record in records:
        assert np.isfinite(record.input).all()
        assert np.all(np.diff(record.time) > 0)
        assert any("guessed from" in line or "read as a file of" in line for line in said)
        assert record.has_clock or any("samples are counted" in line for line in said)
