"""Files that older versions wrote are read with equal numbers, or refused with what to do."""

import json
import re
from pathlib import Path

import jax
import numpy as np
import pytest

import preisach_jax as pj
from preisach_jax import chunks, model, online
from preisach_jax.cli import main
from preisach_jax.sweep import result

FROZEN = Path(__file__).parent / "frozen"
EXPECTED = json.loads((FROZEN / "expected.json").read_text(encoding="utf-8"))


def driven():
    """The record that the model predicts."""
    t = np.arange(160) / 50
    record = pj.Record.from_arrays(
        t, 5 - 4 * np.cos(3 * t), np.zeros(160), units={"input": "V", "output": "um"}
    )
    path = FROZEN / "model_3.json"
    return record, path


def test_a_model_predicts_the_frozen_numbers():
    record, path = driven()
    prediction = pj.Model.load(path).predict(record)
    for name, values in EXPECTED["prediction"].items():
        np.testing.assert_allclose(getattr(prediction, name), values, rtol=1e-9, atol=1e-9)


def test_a_model_that_is_saved_again_predicts_the_same(tmp_path):
    record, path = driven()
    loaded = pj.Model.load(path)
    loaded.save(tmp_path / "again.json")
    again = pj.Model.load(tmp_path / "again.json")
    np.testing.assert_array_equal(again.predict(record).output, loaded.predict(record).output)


@pytest.mark.parametrize("version", [1, 2])
def test_models_of_older_formats_are_refused_with_version_and_remedy(version, tmp_path, capsys):
    path = FROZEN / f"model_{version}.json"
    written_by = json.loads(path.read_text(encoding="utf-8"))["library_version"]
    said = rf"format version {version} .*preisach_jax {re.escape(written_by)}.*fit anew"
    with pytest.raises(pj.InputError, match=said):
        pj.Model.load(path)
    data = tmp_path / "next.csv"
    data.write_text("t_s,u_V\n0,1\n1,2\n2,1\n")
    assert main(["predict", str(path), str(data), "--out", str(tmp_path / "out.csv")]) == 2
    error = capsys.readouterr().err
    assert re.search(said, error)
    assert "Traceback" not in error
    assert not (tmp_path / "out.csv").exists()


@pytest.mark.parametrize("version", range(1, online.FORMAT + 1))
def test_a_filter_of_every_format_goes_on_as_if_it_had_never_stopped(version, x64):
    k = np.arange(160)
    x = 5 + 5 * np.sin(k / 9) * np.cos(k / 41)
    stopped = pj.OnlineFilter.load(FROZEN / f"online_{version}.npz")
    adaptive = pj.AdaptiveFilter(pj.Plane(levels=6, low=0.0, high=10.0), hysteron="ramp")
    running = pj.OnlineFilter(adaptive)
    for u in x[:120]:
        running(u, 3 * u)
    found = [stopped(u, 3 * u) for u in x[120:]]
    np.testing.assert_allclose(found, EXPECTED["online"], rtol=1e-9)
    np.testing.assert_allclose(found, [running(u, 3 * u) for u in x[120:]], rtol=1e-9)
    assert stopped.filter.step_size == 1.0


def test_a_sweep_holds_the_frozen_numbers():
    found = pj.Sweep.load(FROZEN / "sweep_1.npz")
    np.testing.assert_array_equal(found.events, EXPECTED["sweep"]["events"])
    for rows, expected in zip(found.weights, EXPECTED["sweep"]["weights"], strict=True):
        np.testing.assert_allclose(rows, expected, rtol=1e-9)
    np.testing.assert_array_equal(found.key, jax.random.key_data(jax.random.key(0)))


def test_there_is_a_file_of_each_format_that_is_written():
    """Whoever changes a format adds a file of it here."""
    assert (FROZEN / f"model_{model.FORMAT_VERSION}.json").exists()
    assert (FROZEN / f"sweep_{result.FORMAT}.npz").exists()
    assert (FROZEN / f"online_{online.FORMAT}.npz").exists()
    assert chunks.FORMAT == 2, "add a folder of the new format, and test that it is read or refused"
