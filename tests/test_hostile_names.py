"""Names of columns, units and files never become code, control nothing, and lose no work."""

import json
import re
import subprocess
import xml.etree.ElementTree as ET
import zipfile

import numpy as np
import pytest
from exported import GCC, needs_compiler
from hypothesis import given
from hypothesis import strategies as st

from preisach_jax import escape
from preisach_jax.cli import main

CODE = "u*\\ __attribute__((constructor)) static void evil(void){{}} \\*"
FORMULA = r"$\frac{$"
NAMES = {
    "time": "t\x1b[2J_s",
    "input": f"{CODE} ??/ // /* {FORMULA} | <b>&\"'\u202e\x01",
    "output": "z]]><x>`*_# {{ 7*7 }} \x07\x9b31m",
    "load": "=cmd|'/c calc'!A1\x1b]0;owned\x07",
}
UNITS = {"input": FORMULA, "output": "um,\n<&>\x01\\", "load": "N*/ int x; /*"}
ACTING = re.compile("[\x00-\x08\x0b-\x1f\x7f-\x9f\u202a-\u202e\u2066-\u2069]")


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """A record with such names, and what the commands make of it."""
    out = tmp_path_factory.mktemp("hostile")
    t = np.arange(500) / 100
    u = 5 - 5 * np.cos(2 * t * (1 + t / 10))
    load = np.sin(3 * t)
    z = u**1.1 + 0.3 * load
    names = ['"' + name.replace('"', '""') + '"' for name in NAMES.values()]
    rows = [f"{a:.2f},{b:.6f},{c:.6f},{d:.6f}" for a, b, c, d in zip(t, u, z, load, strict=True)]
    text = "\n".join([",".join(names), *rows]) + "\n"
    (out / "data.csv").write_text(text, encoding="utf-8", newline="")
    return out


def run(capfdbinary, *words):
    code = main([str(word) for word in words])
    shown = b"\n".join(capfdbinary.readouterr()).decode()
    assert not ACTING.search(shown), shown
    assert "Traceback" not in shown
    assert code == 0, shown
    return shown


@pytest.mark.usefixtures("figures_are_drawn")
def test_such_names_go_through_every_command(folder, capfdbinary):
    columns = ["--time", "1", "--input", "2", "--output", "3", "--aux", "4"]
    units = [f"--unit={role}={unit}" for role, unit in UNITS.items() if role != "load"]
    data, report = folder / "data.csv", folder / "report"
    run(capfdbinary, "look", data, *columns, *units)
    del columns[-2:]  # the effect names the column
    aux = f"aux:{escape.printable(NAMES['load'])}"
    fixed = ["--effects", aux, "--levels", "5"]
    run(capfdbinary, "diagnose", data, *columns, *units, *fixed, "--report", report)
    model = report / "model.json"
    run(capfdbinary, "predict", model, data, "--out", folder / "prediction.csv")
    run(capfdbinary, "export", model, "--to", "c", "--out", folder / "c")
    if GCC:
        run(capfdbinary, "export", model, "--to", "fmu", "--out", folder / "fmu")
    page = (report / "report.html").read_text(encoding="utf-8")
    assert not ACTING.search(page)
    assert "<x>" not in page
    assert "<b>&" not in page
    assert not ACTING.search(json.dumps(json.loads(model.read_text()), ensure_ascii=False))


@needs_compiler
def test_generated_code_has_no_symbol_of_a_name(folder):
    if not (folder / "c").exists():
        pytest.skip("nothing was exported")
    code = folder / "c"
    built = subprocess.run(
        [GCC, "-std=c99", "-Wall", "-Wextra", "-Werror", "-pedantic", "-trigraphs", "-c",
         "preisach_model.c"], cwd=code, capture_output=True, text=True,
    )  # fmt: skip
    assert built.returncode == 0, built.stderr
    symbols = subprocess.run(["nm", "preisach_model.o"], cwd=code, capture_output=True, text=True)
    assert "evil" not in symbols.stdout
    readme = (code / "README.md").read_text(encoding="utf-8")
    assert not ACTING.search(readme)
    assert "<x>" not in readme
    (archive,) = (folder / "fmu").glob("*.fmu")
    with zipfile.ZipFile(archive) as packed:
        found = ET.fromstring(packed.read("modelDescription.xml"))
        ET.fromstring(packed.read("sources/buildDescription.xml"))
    assert any("attribute" in (each.get("name") or "") for each in found.iter("Float64"))


HOSTILE = st.text(
    st.one_of(st.characters(), st.sampled_from("*/\\?$<>&|`#\x1b\x07\x9b\u202e\r\n,\"'{}=@")),
    max_size=40,
)


@given(HOSTILE)
def test_each_destination_gets_what_it_cannot_take_for_its_own(text):
    shown = escape.printable(text)
    assert not ACTING.search(shown)
    assert "\n" not in shown
    shown.encode()
    comment = escape.c_comment(text)
    assert comment.isascii()
    assert not set("*\\?\"'\n") & set(comment)
    cell = escape.markdown(text)
    assert not re.search(r"(?<!\\)[|`]|[<>]", re.sub(r"\\\\", "", cell))
    assert not set(",\n$\\<>;") & set(escape.unit(text))
    ET.fromstring(f"<a>{shown.replace('&', '&amp;').replace('<', '&lt;')}</a>")
