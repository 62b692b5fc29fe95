"""The world of the blind benchmark hides what it says, with no code of the package."""

import ast
from pathlib import Path

import blind
import numpy as np
from blind import world

FOLDER = Path(blind.__file__).parent
JAX_FREE = ("world", "stage", "hidden", "excitation")


def short(effects, seed=21):
    return world.make_measurement(effects, seed, "rich", 1.0, 1350.0, "plain")


def test_the_world_shares_no_code_with_the_package():
    for module in JAX_FREE:
        tree = ast.parse((FOLDER / f"{module}.py").read_text())
        names = set()
        for node in ast.walk(tree):
            if isinstance(node, ast.Import):
                names |= {alias.name for alias in node.names}
            if isinstance(node, ast.ImportFrom):
                names |= {f"{node.module}.{alias.name}" for alias in node.names}
        own = {name.split(".")[1] for name in names if name.startswith("blind.")}
        other = {name.split(".")[0] for name in names if not name.startswith("blind.")}
        assert own <= set(JAX_FREE)
        assert other <= {"__future__", "collections", "dataclasses", "typing", "zlib"} | {
            "numpy",
            "scipy",
        }


def test_an_effect_of_size_zero_changes_nothing_and_a_nominal_one_does():
    effects = ("creep", "resonance", "backlash")
    bare, none = short({}), short(dict.fromkeys(effects, 0.0))
    np.testing.assert_array_equal(none.output, bare.output)
    assert none.change == 0
    for effect in effects:
        some = short({effect: 2.0})
        np.testing.assert_array_equal(some.input, bare.input)
        assert some.change > 1e-4
    assert not np.array_equal(short({}, 22).output, bare.output)
