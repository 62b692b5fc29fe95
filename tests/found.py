"""Records that tests/world.py makes and diagnoses of them, each made once in a process."""

from functools import cache
from typing import Any

import world

import preisach_jax as pj

ROWS, RATE_HZ, LEVELS = 3000, 500.0, 9  # of all records and planes, so that little is compiled
UNITS = {"input": "V", "output": "um"}
LIKELIEST = {
    None: ("drift", "creep"),
    "creep": ("drift",),
    "input_lag": ("delay",),
    "delay": ("input_lag",),
    "drift": ("creep",),
    "ageing": ("drift",),
    "aux": ("drift",),
    "output_lag": ("input_lag",),
    "hum": ("drift",),
    "stick_slip": ("drift",),  # is in no library
}
"""By what is hidden, what is taken for it most easily; the whole library is tried once beside."""


@cache
def made(effect=None, seed=201, size=2.0, noise_um=0.1, **options) -> tuple[dict, Any]:
    """What the world made, a third longer than what is diagnosed, and its name as an effect."""
    each = world.hidden_record(
        effect, seed, ROWS / RATE_HZ * 4 / 3, RATE_HZ, size=size, noise_um=noise_um, **options
    )
    return each, "aux:load_N" if effect == "aux" else effect


def whole(effect=None, seed=201, **options):
    """The record with the quarter that no diagnosis has seen."""
    each, _ = made(effect, seed, **options)
    return pj.Record.from_arrays(each["t"], each["x"], each["z"], aux=each["aux"], units=UNITS)


def record_of(effect=None, seed=201, **options):
    """The record that is diagnosed."""
    return whole(effect, seed, **options).part(0, ROWS)


@cache
def found(effect=None, seed=201, whole_library=False, **options):
    """The diagnosis of it, by the effect and its likeliest rival or by the whole library."""
    own = () if effect in (None, "stick_slip") else (made(effect, seed, **options)[1],)
    asked = None if whole_library else (*own, *LIKELIEST[effect])
    return pj.diagnose(record_of(effect, seed, **options), asked, levels=LEVELS)
