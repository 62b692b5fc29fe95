"""Texts that end within a row, as a file does that a logger is still writing."""

import numpy as np
import pytest
from drivable import model_of

from preisach_jax.cli import main
from preisach_jax.errors import InputError
from preisach_jax.record.blemishes import holes
from preisach_jax.record.core import Record

ROWS = 60
TIME = np.arange(ROWS) / 10
INPUT = np.round(5 * np.sin(TIME), 4)
OUTPUT = np.round(37 * np.cos(TIME), 4)
TOLD = f"row {ROWS + 1} was left out: the file ends within it"


def text(form="{:.4f}", between=",", end="\n"):
    lines = [between.join(["t_s", "u_V", "z_um"])]
    rows = zip(TIME, INPUT, OUTPUT, strict=True)
    lines += [between.join(form.format(cell) for cell in row) for row in rows]
    return "".join(line + end for line in lines)


def with_last(row):
    """The text with another last line."""
    return text()[: text().rstrip("\n").rfind("\n") + 1] + row


def loaded(path, content, encoding="utf-8", **how):
    path.write_bytes(content.encode(encoding))
    return Record.load(path, **how)


@pytest.mark.parametrize(
    ("content", "encoding"),
    [
        (text(), "utf-8"),
        (text("{:.6e}"), "utf-8"),
        (text(between=";").replace(".", ","), "utf-8"),
        (text("{:9.4f}", between=" "), "utf-8"),
        (text('"{:.4f}"', end=",\r\n"), "utf-16"),
    ],
    ids=["comma", "exponents", "decimal comma", "blanks", "quoted, ends, dos, utf-16"],
)
def test_whatever_is_cut_from_the_last_row_all_others_are_read(tmp_path, content, encoding):
    path = tmp_path / "log.csv"
    last = content.rstrip().rfind("\n") + 1
    kept = []
    for stop in range(last, len(content) + 1):
        record = loaded(path, content[:stop], encoding)
        is_blank = not content[last:stop].strip()
        assert len(record) == ROWS - (is_blank or record.torn_row is not None)
        assert record.torn_row in (None, ROWS + 1)
        assert (TOLD in holes(record)) == (record.torn_row is not None)
        np.testing.assert_array_equal(record.time[: ROWS - 1], TIME[: ROWS - 1])
        np.testing.assert_array_equal(record.input, INPUT[: len(record)])
        np.testing.assert_array_equal(record.output[: ROWS - 1], OUTPUT[: ROWS - 1])
        kept += [stop] if len(record) == ROWS else []
    assert record.output[-1] == OUTPUT[-1]
    # What stays is what could be a whole row: the input is complete, a third field has begun.
    assert kept
    assert kept[0] - last > len(content[last:]) / 2


@pytest.mark.parametrize(
    "row", ["5", "5.9,", '"5.9', "5.9;2.5;3", "5.9,2.5,-.", "5.9,2.5,4.5E-", '5.9,2.5,"4']
)
@pytest.mark.parametrize("has_names", [True, False])
def test_a_last_line_that_ends_within_its_row_or_number_is_left_out(tmp_path, row, has_names):
    content, columns = with_last(row), {}
    if not has_names:
        content = content[content.index("\n") + 1 :]
        columns = {"time": "1", "input": "2", "output": "3"}
    record = loaded(tmp_path / "log.csv", content, **columns)
    assert record.torn_row == ROWS + has_names
    np.testing.assert_array_equal(record.output, OUTPUT[:-1])


@pytest.mark.parametrize("end", ["\r\n", "\n# stopped"])
def test_a_short_row_that_has_its_line_end_is_refused(tmp_path, end):
    with pytest.raises(InputError, match=rf"row {ROWS + 1}: 2 field\(s\) where the names are 3"):
        loaded(tmp_path / "log.csv", with_last("5.9,2.5" + end))


def test_the_command_line_tells_it(tmp_path, capsys):
    data, out, model = (tmp_path / name for name in ("next.csv", "out.csv", "model.json"))
    model_of().save(model)
    data.write_text("t_s,u_V\n0,1\n1,2\n2")
    words = ["predict", str(model), str(data), "--out", str(out)]
    assert main(words) == 0
    told = f"{data}: row 4 was left out: the file ends within it"
    assert told in capsys.readouterr().out.splitlines()
    assert len(out.read_text().splitlines()) == 3
    assert main([*words, "--json"]) == 0
    assert told in capsys.readouterr().err.splitlines()
