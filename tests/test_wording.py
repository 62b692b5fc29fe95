"""Where a residual is said to sit."""

import numpy as np
import pytest

from preisach_jax.diagnosis.wording import located
from preisach_jax.record.core import Record

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
