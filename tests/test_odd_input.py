"""Paths, sizes and types that nobody meant: refused in one line, or computed with."""

import copy
import io
import json
import zipfile
from contextlib import contextmanager

import numpy as np
import pytest
from drivable import model_of
from hypothesis import example, given, settings
from hypothesis import strategies as st

import preisach_jax as pj
from preisach_jax.app.steps import Click, packed, unpacked

ENDS = ["", ".csv", ".json", ".xlsx", ".npz", ".mat", "/", "#1", "/../"]
VALUES = st.one_of(
    st.none(), st.booleans(), st.integers(-(10**40), 10**40), st.floats(), st.text(max_size=3),
    st.lists(st.floats(), max_size=3), st.just({}),
)  # fmt: skip
MODEL = model_of().to_json()
TIME = np.arange(20) / 1000
DRIVE = pj.Record.from_arrays(TIME, np.linspace(0, 10, 20), np.zeros(20))


CHOICE = {"time": "t", "input": "u", "output": "z", "aux": (), "rate": None, "units": {}}
CSV = b"t,u,z\n0,0,0\n"
PROJECT = packed("a.csv", CSV, CHOICE, (Click("fit", 9),), None)  # pyright: ignore
with zipfile.ZipFile(io.BytesIO(PROJECT)) as _archive:
    TOLD = json.loads(_archive.read("project.json"))


def places(value, at=()):
    """The way to each key, and to the first item of each list."""
    inner = value.items() if isinstance(value, dict) else enumerate(value[:1])
    for key, each in inner:
        yield (*at, key)
        if isinstance(each, dict | list):
            yield from places(each, (*at, key))


def changed(content, place, value):
    inside = content = copy.deepcopy(content)
    for key in place[:-1]:
        inside = inside[key]
    inside[place[-1]] = value
    return content


@contextmanager
def refused_in_one_line_at_most():
    told = ""
    try:
        yield
    except pj.InputError as error:
        told = str(error)
    assert "\n" not in told


@given(name=st.text(st.characters(max_codepoint=0x2FF), max_size=12), end=st.sampled_from(ENDS))
@example(name="\0", end="/../")
@example(name=".", end="#1")
def test_odd_paths_are_refused(name, end):
    for load in (pj.Record.load, pj.Model.load, pj.OnlineFilter.load):
        with pytest.raises(pj.InputError):
            load(f"no such folder/{name}{end}")


@given(levels=VALUES, low=st.floats(), high=st.floats())
def test_planes_of_odd_sizes_are_refused_or_have_their_cells(levels, low, high):
    with refused_in_one_line_at_most():
        plane = pj.Plane(levels=levels, low=low, high=high)
        assert plane.cells == levels * (levels + 1) // 2
        assert np.all(np.diff(plane.thresholds) > 0)


@settings(max_examples=100)
@given(place=st.sampled_from(list(places(MODEL))), value=VALUES)
def test_a_model_with_an_odd_value_is_refused_or_predicts_what_is_finite(place, value):
    with refused_in_one_line_at_most():
        model = pj.Model.from_json(changed(MODEL, place, value))
        assert np.isfinite(model.predict(DRIVE).output).all()


@settings(max_examples=100)
@given(place=st.sampled_from(list(places(TOLD))), value=VALUES)
def test_a_project_with_an_odd_value_is_refused_or_opened(place, value):
    file = io.BytesIO()
    with zipfile.ZipFile(file, "w") as archive:
        archive.writestr("project.json", json.dumps(changed(TOLD, place, value)))
        archive.writestr("record/a.csv", CSV)
    with refused_in_one_line_at_most():
        unpacked("x.preisach", file.getvalue())
