"""The view "Drive" without a browser: courses, the drive, what is said of it, and its place."""

import re
import shlex

import numpy as np
import pytest
from oracles import play

import preisach_jax as pj
from preisach_jax.cli import main
from preisach_jax.quantity import quantity

pytest.importorskip("panel")

from preisach_jax.app import drive
from preisach_jax.app.drive import DriveView, Shape, driven, outcome, shaped, unreached

RATE = 100.0


def quiet(text, done):
    """Discarded progress."""


def stage(rows=3000):
    """Input and output of a loop with hysteresis, made by a play of one width and its half."""
    t = np.arange(rows) / RATE
    u = 5 - 5 * np.cos(1.3 * t) * (1 - t / 40)
    return t, u, play(u, 0.5, 0.0) + play(u, 1.0, 0.0)


@pytest.fixture(scope="module")
def step(tmp_path_factory):
    t, u, z = stage()
    z = z + 0.01 * t + 0.005 * np.random.default_rng(5).normal(size=t.size)
    record = pj.Record.from_arrays(t, u, z, units={"input": "V", "output": "um"}, name="<b>")
    return pj.explore(record, ["drift", "hum"], levels=9).add("drift")


@pytest.fixture
def view(step):
    return DriveView(step, lambda: None, lambda: None)


class TestCourse:
    shape = Shape("Triangle", 10.0, 6.0, 2.0, 3.0)

    @pytest.mark.parametrize("kind", drive.SHAPES)
    def test_a_shape_has_its_swing_its_periods_and_its_form(self, kind):
        time, output = shaped(Shape(kind, 10.0, 6.0, 2.0, 3.0), 4.0, 1e-3)
        assert time[-1] == pytest.approx(0.25 + 1.5)
        np.testing.assert_allclose(np.diff(time), 1e-3, rtol=1e-9)
        behind, wave = time[250:] - time[250], output[250:]
        assert (wave.min(), wave.max()) == pytest.approx((7.0, 13.0))
        np.testing.assert_allclose(wave[500:], wave[:-500], atol=1e-9)
        phase = 2 * np.pi * 2.0 * behind
        forms = {
            "Triangle": 10 + 6 / np.pi * np.arcsin(np.sin(phase - np.pi / 2)),
            "Sine": 10 - 3 * np.cos(phase),
        }
        if kind in forms:
            np.testing.assert_allclose(wave, forms[kind], atol=1e-9)
        elif kind == "Staircase":
            levels, counts = np.unique(wave.round(9), return_counts=True)
            held = levels[counts > 20]
            np.testing.assert_allclose(held, np.linspace(7, 13, drive.STEPS + 1))
        else:
            assert np.mean(wave[:-1] == wave.max()) == pytest.approx(0.15, abs=0.005)
            assert np.mean(wave[:-1] == wave.min()) == pytest.approx(0.15, abs=0.005)

    @pytest.mark.parametrize(
        ("change", "said"),
        [
            ({"swing": 0.0}, "swing is 0"),
            ({"periods": np.nan}, "periods is nan"),
            ({"frequency": 400.0}, "2.5 rows of 1 ms; give at most 125 Hz"),
            ({"periods": 1e6}, "500,000,000 rows"),
        ],
    )
    def test_numbers_that_make_no_course_are_named_with_the_remedy(self, change, said):
        with pytest.raises(pj.InputError, match=re.escape(said)):
            shaped(Shape(**(vars(self.shape) | change)), 4.0, 1e-3)


class TestDrive:
    def test_it_is_what_the_command_shown_writes(self, tmp_path, monkeypatch):
        t, u, z = stage()
        load = np.where(t % 4 < 2, 1.0, 3.0)
        rows = np.stack([1e3 * t, u, z + 0.5 * load, load], axis=1).tolist()
        lines = ["t_ms,u_V,z_um,load_N", *(",".join(map(repr, row)) for row in rows)]
        (tmp_path / "stage.csv").write_text("\n".join(lines))
        units = {"output": "nm"}  # though the name of its column says um
        record = pj.Record.load(tmp_path / "stage.csv", aux=("load_N",), units=units)
        step = pj.explore(record, ["aux:load_N"], levels=5).add("aux:load_N")
        view = DriveView(step, lambda: None, lambda: None)
        view._limits["low"].value, view._limits["slew"].value = 0.5, 40.0
        order = view.order()
        assert order is not None
        result = driven(step, order, quiet)
        assert set(result.files) == {"drive.csv", "wanted.csv", "model.json"}
        assert "load_N is assumed to stay at" in " ".join(result.notes)
        there = tmp_path / "there"
        there.mkdir()
        for name in ("wanted.csv", "model.json"):
            (there / name).write_bytes(result.files[name])
        monkeypatch.chdir(there)
        assert main(shlex.split(result.command)[1:]) == 0
        assert (there / "drive.csv").read_bytes() == result.files["drive.csv"]

    def test_what_cannot_be_reached_is_shaded_and_told(self, step, view):
        view._shape["middle"].value = float(step.record.output.max())
        view._limits["high"].value = 9.0
        result = driven(step, view.order(), quiet)
        lost = ~result.found.reachable
        assert 0 < lost.sum() < len(lost)
        assert "--limits=0" in result.command
        view.show(result)
        shaded = np.zeros(len(lost), dtype=bool)
        for begin, end in zip(*unreached(result), strict=True):
            shaded |= (result.wanted.time >= begin) & (result.wanted.time < end)
        shaded[-1] = lost[-1]
        np.testing.assert_array_equal(shaded, lost)
        text = outcome(result, step.record)
        assert f"{lost.sum():,} of {len(lost):,} rows cannot be reached" in text
        assert "outcome unmet" in text
        errors, stroke = result.errors, step.record.output_range
        for value in (errors.compensated, errors.straight):
            assert quantity(value, "um", 3) in text
            assert f"{100 * value / stroke:.2g}\N{NO-BREAK SPACE}%" in text
        data = view.figures.rows.data
        np.testing.assert_allclose(data["drive"], result.found.drive)
        np.testing.assert_allclose(data["low"], result.found.low)


class TestView:
    def test_a_course_that_cannot_be_read_is_refused_as_by_the_command(
        self, view, step, tmp_path, capsys
    ):
        content = b"time,output\n0,1\n0.01,\n0.02,3\n"
        view._kind.value = drive.FROM_FILE
        assert view.order() is None
        assert "drop its file" in view._told.object
        piece = {"name": "course.csv", "size": len(content), "number": 1, "data": content}
        view._dropper._handle_msg(piece)
        [text] = re.findall(r'<div class="error" role="alert">(.*)</div>', view._told.object)
        assert "wanted output must be" in text
        (tmp_path / "course.csv").write_bytes(content)
        step.fit.save(tmp_path / "model.json")
        words = [str(tmp_path / name) for name in ("model.json", "course.csv")]
        assert main(["compensate", *words, "--out", str(tmp_path / "drive.csv")]) == 2
        plain = capsys.readouterr().err.replace(f"{tmp_path}/", "")
        assert " ".join(text.replace("&#39;", "'").split()) in " ".join(plain.split())
