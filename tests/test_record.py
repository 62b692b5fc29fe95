"""Records: what is read is what was written, in every format and dialect."""

import hashlib
import importlib.resources

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from preisach_jax.errors import InputError
from preisach_jax.record.channels import Channel
from preisach_jax.record.core import Record
from preisach_jax.record.units import is_known_unit, split_unit

K = 60


def signals(size=K):
    """Time, input and output of a plain record."""
    t = np.arange(size) / 100
    u = 3 * np.sin(7 * t) + 4
    return t, u, 0.2 * u**2


def write_csv(path, names=("t", "u", "z"), columns=None, delimiter=","):
    columns = signals() if columns is None else columns
    lines = [delimiter.join(names)]
    lines += [delimiter.join(map(repr, map(float, row))) for row in zip(*columns, strict=True)]
    path.write_text("\n".join(lines) + "\n")
    return path


# --- MicroMag reversal curves ---------------------------------------------------------------------

MICROMAG = """MicroMag 2900/3900 Data File (Series 0015)
First-order reversal curves
Configuration   :  AGM
Units of measure:  Hybrid SI
04/13/2016  13:20
""

Averaging time = +5.000000E-01
HCal           = +8.000000E-01
HSat           = +1.000000E+00
NCrv           = 2
PauseSat       = +2.000000E+00
Elapsed time   = +1.300000E+01
NData          = 5

+8.010000E-01,+9.000000E-07

+5.000000E-01,+6.000000E-07

+7.990000E-01,+8.900000E-07

+3.000000E-01,+4.000000E-07
+5.000000E-01,+5.500000E-07

MicroMag 2900/3900 Data File ends
"""
# By hand: weights 2, .5, .5, 2, .5, .5, .5 make 6.5 s, and 13 s elapsed: every weight twice.
MICROMAG_TIME = [4.0, 5.0, 6.0, 10.0, 11.0, 12.0, 13.0]
MICROMAG_FIELD = [1.0, 0.801, 0.5, 1.0, 0.799, 0.3, 0.5]
MICROMAG_MOMENT = [np.nan, 9e-7, 6e-7, np.nan, 8.9e-7, 4e-7, 5.5e-7]


def test_micromag_against_a_hand_made_record(tmp_path):
    path = tmp_path / "two.forc"
    path.write_text(MICROMAG)
    record = Record.load(path, need_output=False)
    np.testing.assert_allclose(record.time, MICROMAG_TIME, rtol=1e-14)
    np.testing.assert_array_equal(record.input, MICROMAG_FIELD)
    np.testing.assert_array_equal(record.output, MICROMAG_MOMENT)
    assert record.initial_memory == "high"
    assert record.channels == {
        "time": Channel("t", "s"), "input": Channel("field", "T"),
        "output": Channel("moment", "A·m²"),
    }  # fmt: skip


@pytest.mark.parametrize(
    ("old", "new", "expected"),
    [
        ("HSat           = +1.0", "HSat           = -1.0", {"initial_memory": "low"}),
        ("Hybrid SI", "cgs", {"input_unit": "Oe", "output_unit": "emu"}),
        ("Elapsed time   = +1.300000E+01", "", {"duration_s": 4.5}),
        ("PauseSat       = +2.0", "PauseSat       = +0.0", {"duration_s": 13 * 6 / 7}),
        ("HSat           = +", "HSat\t\t+", {"initial_memory": "high"}),
    ],
)
def test_micromag_headers(tmp_path, old, new, expected):
    path = tmp_path / "two.forc"
    assert old in MICROMAG
    path.write_text(MICROMAG.replace(old, new))
    record = Record.load(path, need_output=False)
    for name, value in expected.items():
        assert getattr(record, name) == (pytest.approx(value) if name == "duration_s" else value)


def test_bundled_measurement():
    bundled, said = importlib.resources.files("preisach_jax") / "bundled", []
    with importlib.resources.as_file(bundled / "conventional_example.forc") as path:
        record = Record.load(path, announce=said.append)
    assert len(record) == 8634
    assert int(np.sum(record.measured)) == 8514
    assert record.time[-1] == pytest.approx(1927.455, rel=1e-12)
    # the first rows of the file, and the rest at saturation before each pair of blocks
    np.testing.assert_array_equal(
        record.input[:6], [0.3, 0.2370455, 0.1182822, 0.3, 0.2370448, 0.1154643]
    )
    np.testing.assert_array_equal(record.output[1:3], [7.842043e-07, 6.053198e-07])
    # A rest takes 1 s and a point 0.1 s of the protocol's time: 9714 tenths fill 1927.455 s.
    np.testing.assert_allclose(np.diff(record.time[:4]), np.array([1, 1, 10]) * 1927.455 / 9714)
    assert record.initial_memory == "high"
    assert record.name == "conventional_example.forc"
    assert any("saturation" in note for note in said)
    assert not any("guessed from" in note for note in said)


# --- delimiter-separated text ---------------------------------------------------------------------

finite = st.floats(min_value=-1e9, max_value=1e9, allow_nan=False, width=64)


@st.composite
def dialects(draw):
    """A delimited file's text, its encoding, its columns and their names."""
    delimiter = draw(st.sampled_from([",", ";", "\t", "|", " "]))
    decimal = draw(st.sampled_from(["."] if delimiter == "," else [".", ","]))
    names = draw(
        st.sampled_from([("t_s", "u_V", "z_um"), ("Zeit [s]", "Spannung [V]", "Weg (µm)")])
    )
    size = draw(st.integers(2, 12))
    time = np.cumsum(draw(st.lists(st.floats(1e-3, 10), min_size=size, max_size=size)))
    u = draw(st.lists(finite, min_size=size, max_size=size))
    # Between spaces there is no empty cell.
    cell = finite if delimiter == " " else st.one_of(finite, st.just(float("nan")))
    z = draw(st.lists(cell, min_size=size, max_size=size))
    pad = draw(st.sampled_from(["", " "])) if delimiter in ",;|" else ""
    lines = [(delimiter + pad).join(names)]
    for row in zip(time, u, z, strict=True):
        cells = ["" if np.isnan(value) else repr(float(value)) for value in row]
        lines.append((delimiter + pad).join(cells).replace(".", decimal))
    for extra in draw(
        st.lists(st.sampled_from(["", "  ", "# note; a, b|c 1.5", "% x"]), max_size=4)
    ):
        lines.insert(draw(st.integers(0, len(lines))), extra)
    end = draw(st.sampled_from(["\n", "\r\n", "\r"]))
    text = end.join(lines) + draw(st.sampled_from(["", end]))
    encoding = draw(st.sampled_from(["utf-8", "utf-8-sig", "cp1252", "utf-16", "utf-16-be"]))
    return text, encoding, (time, np.array(u), np.array(z)), names


@given(dialects())
@settings(max_examples=40, suppress_health_check=[HealthCheck.function_scoped_fixture])
def test_every_dialect_gives_back_the_values_to_the_last_bit(tmp_path, dialect):
    text, encoding, columns, names = dialect
    path = tmp_path / "dialect.csv"
    path.write_bytes(text.encode(encoding))
    told, said = dict(zip(("time", "input", "output"), names, strict=True)), []
    record = Record.load(path, **told, need_output=False, announce=said.append)
    for read, written in zip((record.time, record.input, record.output), columns, strict=True):
        np.testing.assert_array_equal(read, written)
    has_signs = not text.isascii()
    units = [each.unit for each in record.channels.values()]
    assert units == ["s", "V", "µm" if has_signs else "um"]
    assert {role: channel.name for role, channel in record.channels.items()} == told
    assert ("read as Windows-1252" in " ".join(said)) == (has_signs and encoding == "cp1252")


# --- units and time -------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("column", "name", "unit"),
    [
        ("z_um", "z", "um"), ("Weg [µm]", "Weg", "µm"), ("Weg/mm", "Weg", "mm"),
        ("H_A_per_m", "H", "A/m"), ("coil_current_A", "coil_current", "A"),
        ("u_1", "u_1", ""), ("load_cell", "load_cell", ""),
    ],
)  # fmt: skip
def test_units_in_names(column, name, unit):
    assert split_unit(column) == (name, unit)


@pytest.mark.parametrize(
    ("name", "unit", "seconds"),
    [("Zeit [µs]", "µs", 1e-6), ("time (μs)", "μs", 1e-6), ("t_h", "h", 3600)],
)
def test_time_is_in_seconds_and_kept_as_in_the_file(tmp_path, name, unit, seconds):
    _, u, z = signals()
    values = np.arange(K) * 7.0
    record = Record.load(write_csv(tmp_path / "r.csv", (name, "u", "z"), (values, u, z)))
    np.testing.assert_allclose(record.time, values * seconds, rtol=1e-15)
    np.testing.assert_array_equal(record.time_values, values)
    assert record.channels["time"] == Channel(name, unit)


def test_a_unit_that_nobody_knows_is_kept_and_told(tmp_path):
    path = write_csv(tmp_path / "r.csv", ("t", "u_V", "z"))
    said = []
    record = Record.load(path, units={"output": "parsec"}, announce=said.append)
    assert record.output_unit == "parsec"
    [note] = [note for note in said if "parsec" in note]
    assert "column z" in note
    assert "--unit output=UNIT" in note


@pytest.mark.parametrize("unit", ["µm/N", "A·m²", "kg*m/s2", "counts", "%", "Volts", ""])
def test_units_that_are_known(unit):
    assert is_known_unit(unit)
    assert not is_known_unit(f"foo{unit}")
    assert not is_known_unit(f"{unit or 'Vm'} foo")


def test_a_rate_takes_the_place_of_time(tmp_path):
    t, u, z = signals()
    for names, columns in (("uz", (u, z)), ("tuz", (t, u, z))):
        record = Record.load(write_csv(tmp_path / "r.csv", names, columns), rate=200.0)
        np.testing.assert_array_equal(record.time, np.arange(K) / 200.0)


# --- guessing, and what may be absent -------------------------------------------------------------


@pytest.mark.parametrize(
    ("names", "roles"),
    [
        ("t x z u1 u2 y1", "t x z"),
        ("z_um u_V t_ms load_N", "t_ms u_V z_um"),
        ("Zeit Spannung Weg", "Zeit Spannung Weg"),
        ("clk_s chan1_V chan2_um", "clk_s chan1_V chan2_um"),
    ],
)
def test_columns_are_guessed_and_announced(tmp_path, names, roles):
    t, u, _ = signals()
    rng = np.random.default_rng(1)
    roles = roles.split()
    columns = [t if name == roles[0] else u + rng.standard_normal(K) for name in names.split()]
    said = []
    record = Record.load(
        write_csv(tmp_path / "r.csv", names.split(), columns), announce=said.append
    )
    assert [record.channels[role].name for role in ("time", "input", "output")] == roles
    (guess,) = [note for note in said if "guessed from" in note]
    assert all(column in guess for column in roles)


def test_only_what_is_not_told_is_guessed(tmp_path):
    t, u, z = signals()
    path = write_csv(tmp_path / "r.csv", ("t", "u", "x", "z"), (t, u, u + 1, z))
    said = []
    record = Record.load(
        path, input="x", aux=["u"], initial_memory="demagnetised", announce=said.append
    )
    assert record.initial_memory == "demagnetised"
    assert Record.load(path, input="x").initial_memory == "free"
    assert record.channels["input"].name == "x"
    (guess,) = [note for note in said if "guessed from" in note]
    assert guess.endswith("time t, output z")
    np.testing.assert_array_equal(record.aux["u"], u)


def test_without_need_of_an_output_it_may_be_absent_and_the_record_short_and_still(tmp_path):
    path = write_csv(tmp_path / "r.csv", ("t", "u"), ([0.0, 1.0], [2.0, 2.0]))
    record = Record.load(path, time="t", input="u", output="z", need_output=False)
    assert not record.measured.any()
    assert record.channels["output"] == Channel("output", "")
    assert np.isnan(record.output_range)
    write_csv(tmp_path / "with.csv")
    loaded = Record.load(tmp_path / "with.csv", output="z", need_output=False)
    np.testing.assert_array_equal(loaded.output, signals()[2])


# --- the record itself ----------------------------------------------------------------------------


def record_of(size=K, **options):
    return Record.from_arrays(*signals(size), **options)


def test_properties():
    t, u, z = signals()
    t = t + np.where(np.arange(K) >= 40, 0.5, 0.0)
    z[:5] = np.nan
    record = Record.from_arrays(t, u, z, units={"input": "V", "output": "um"})
    assert record.step_s == pytest.approx(0.01)
    assert record.duration_s == pytest.approx(1.09)
    ((row, seconds),) = record.gaps
    assert (row, seconds) == (40, pytest.approx(0.51))
    assert record.jitter == pytest.approx(0.0, abs=1e-9)
    u *= 2.0  # the record holds its own
    assert record.input_range == (np.max(u) - np.min(u)) / 2
    assert record.output_range == np.max(z[5:]) - np.min(z[5:])
    assert (record.input_unit, record.output_unit) == ("V", "um")


def test_the_digest_is_that_of_time_input_and_output():
    record = record_of()
    expected = hashlib.sha256(b"".join(v.astype("<f8").tobytes() for v in signals())).hexdigest()
    assert record.sha256 == expected
    rows = np.column_stack(signals()[:2])[:20].astype("<f8").tobytes()
    assert record.inputs_digest(20) == hashlib.sha256(rows).hexdigest()
    assert record.part(0, 30).inputs_digest(20) == record.inputs_digest(20)
    assert record.part(1, 30).inputs_digest(20) != record.inputs_digest(20)
    with pytest.raises(ValueError, match="n is 61"):
        record.inputs_digest(61)


def test_a_part_holds_its_rows_and_forgets_the_initial_memory():
    record = record_of(aux={"load": np.arange(K)}, initial_memory="high")
    assert not record.input.flags.writeable
    part = record.part(10, 20)
    np.testing.assert_array_equal(part.time_values, record.time_values[10:20])
    np.testing.assert_array_equal(part.aux["load"], np.arange(10, 20))
    assert part.initial_memory == "free"
    assert record.part(0, 20).initial_memory == "high"
    assert part.sha256 != record.sha256
    with pytest.raises(InputError, match=r"part\(5, 6\)"):
        record.part(5, 6)
