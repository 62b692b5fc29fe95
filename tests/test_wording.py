"""Where a residual is said to sit, and what is said of a record."""

from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest

from preisach_jax.diagnosis.wording import located, notes_on
from preisach_jax.record import Record

TIME = np.arange(4000) / 200
INPUT = 5 - 5 * np.cos(2 * np.pi * TIME / 4)
UNITS = {"input": "V", "output": "um"}


def told(residual, path=INPUT):
    record = Record.from_arrays(TIME, path, path, units=UNITS)
    return located(record, residual)


def test_a_stretch_of_time_and_a_frequency_are_found():
    wave = np.sin(2 * np.pi * 7.0 * TIME)
    text = told(np.where((TIME >= 4) & (TIME < 6), wave, 1e-3 * wave))
    assert text.startswith("100 % of its power lie where the time is 4 s to 6 s")
    band = text.rsplit("half of it between ", 1)[1]
    assert band in ("6.9 Hz and 7.1 Hz", "7 Hz and 7 Hz", "6.8 Hz and 7.2 Hz")


@pytest.mark.parametrize(("sign", "name"), [(1, "rises"), (-1, "falls")])
def test_a_direction_is_named_if_it_has_more_than_its_share(sign, name):
    rng = np.random.default_rng(0)
    inside = sign * np.gradient(INPUT) > 0
    text = told(np.where(inside, 1.0, 0.1) * rng.normal(size=len(TIME)))
    assert f"99 % while the input {name} (50 % of the samples)" in text
    assert "while the input" not in told(rng.normal(size=len(TIME)))


def test_little_to_see_is_said():
    chain = SimpleNamespace(signed=False)
    model = cast(Any, SimpleNamespace(plane=SimpleNamespace(cells=325), chain=chain))
    assert notes_on(Record.from_arrays(TIME, INPUT, INPUT), model) == ()
    rng = np.random.default_rng(0)
    ramp = np.linspace(0, 10, 4000) + 0.01 * rng.normal(size=4000)
    (note,) = notes_on(Record.from_arrays(TIME, ramp, ramp), model)
    assert note.startswith("The input reverses only 0 times")
    short = slice(0, 300)
    few = notes_on(Record.from_arrays(TIME[short], INPUT[short], INPUT[short]), model)
    assert few[0].startswith("The record has 300 measured rows for 325 cells")
