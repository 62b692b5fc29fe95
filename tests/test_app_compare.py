"""The view "Compare" without a browser: what is compared, what is said, what can be taken away."""

import json
import re
import shlex

import numpy as np
import pytest
from test_app_drive import quiet, stage

import preisach_jax as pj
from preisach_jax.cli import main
from preisach_jax.report.content import several_rows

pytest.importorskip("panel")

from preisach_jax.app.compare import OWN_MODEL, CompareView, Dropped, compared


def record_file(name, gain=1.0):
    t, u, z = stage()
    table = np.column_stack([t, u, gain * z])
    lines = "".join(",".join(map(repr, row)) + "\n" for row in table.tolist())
    return Dropped(name, f"t_s,u_V,z_um\n{lines}".encode())


@pytest.fixture(scope="module")
def step(tmp_path_factory):
    path = tmp_path_factory.mktemp("own") / "own.csv"
    path.write_bytes(record_file("own.csv").content)
    return pj.explore(pj.Record.load(path), ["hum"], levels=9)


def model_file(step, name, factor):
    content = step.fit.model.to_json()
    content["weights"] = [factor * weight for weight in content["weights"]]
    return Dropped(name, json.dumps(content).encode())


def test_one_model_is_tried_on_each_record(step):
    others = [record_file("same.csv"), record_file("greater.csv", 1.2)]
    result = compared(step, others, quiet)
    assert list(result.found) == ["own.csv", "same.csv", "greater.csv"]
    own, same, greater = (result.found[name] for name in result.found)
    assert same.rms == pytest.approx(own.rms)
    # The model knows nothing of the gain: a fifth of the measured output is missed.
    missed = greater.record.output - own.prediction
    assert greater.rms == pytest.approx(np.sqrt(np.nanmean(missed**2)), rel=1e-6)
    assert set(result.files) == {"report.html", "comparison.json", OWN_MODEL}
    assert b"</svg>" in result.picture
    # Several models are tried on the record that is open.
    result = compared(step, [model_file(step, "other.json", 1.1)], quiet)
    assert list(result.found) == [OWN_MODEL, "other.json"]
    assert result.found["other.json"].rms > 2 * result.found[OWN_MODEL].rms
    assert all(each.record.name == "own.csv" for each in result.found.values())


def test_the_command_gives_the_same_table(step, tmp_path, monkeypatch, capsys):
    others = [record_file("a.csv"), record_file("<i>.csv", 0.9)]
    result = compared(step, others, quiet)
    view = CompareView(lambda: None, lambda error: None)
    view.show(result)
    assert "<i>" not in view._shown.object  # what a file is called stays text
    assert "&lt;i&gt;.csv" in view._shown.object
    folder = tmp_path / "by_hand"
    folder.mkdir()
    (folder / "own.csv").write_bytes(record_file("own.csv").content)
    for each in others:
        (folder / each.name).write_bytes(each.content)
    (folder / OWN_MODEL).write_bytes(result.files[OWN_MODEL])
    monkeypatch.chdir(folder)
    assert main(shlex.split(result.command)[1:]) == 0
    shown = capsys.readouterr().out
    for row in several_rows(result.found):
        # Digits of the last place hang on the text of the model file.
        assert re.search(rf"{row[0]} +{row[1]} +{re.escape(row[2])}", shown), shown


@pytest.mark.parametrize(
    ("others", "told"),
    [
        (["a.csv", "b.csv", "m.json"], "2 models and 2 records; take away all records but one"),
        (["own.csv"], "own.csv: what is open here is called the same"),
        (["broken.csv"], "broken.csv"),
    ],
)
def test_what_cannot_be_compared_is_refused_in_a_line(step, tmp_path, others, told):
    made = {
        "m.json": model_file(step, "m.json", 1.0),
        "broken.csv": Dropped("broken.csv", b'{"format": "preisach_jax model", "levels": '),
    }
    files = [made.get(name) or record_file(name) for name in others]
    with pytest.raises(pj.InputError) as caught:
        compared(step, files, quiet)
    assert told in str(caught.value)
    assert "\n" not in str(caught.value)
    assert str(tmp_path) not in str(caught.value)
