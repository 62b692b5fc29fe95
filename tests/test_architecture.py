"""The house: imports run one way, and importing the package costs and changes nothing."""

import ast
import os
import subprocess
import sys
from collections import defaultdict
from collections.abc import Sequence
from functools import cache
from graphlib import TopologicalSorter
from importlib import import_module
from pathlib import Path

import pytest

import preisach_jax

PACKAGE = Path(preisach_jax.__file__).parent

# From below: a file may import from those before its own layer, and within its layer.
LAYERS: Sequence[str] = (
    "errors escape quantity hooks files cores devices tree operator filter signals plant piezo "
    "frequency theory record look effects mechanics chain model loss export compensation "
    "identify fit diagnosis present paper plot report app cli __main__"
).split()
# The simulated world shares no code with the models that are to explain it.
WORLD = {
    "signals": {"errors"},
    "plant": {"errors", "signals"},
    "piezo": {"errors", "signals", "plant"},
    "frequency": {"errors", "signals"},
}


@cache
def imports():
    """By module, the modules that it imports: inside functions and for annotations as well."""
    paths = {
        ".".join(path.relative_to(PACKAGE.parent).with_suffix("").parts): path
        for path in PACKAGE.rglob("*.py")
    }
    modules = {name.removesuffix(".__init__"): path for name, path in paths.items()}
    assert modules.pop("preisach_jax")  # the top: it names what the modules define
    found = defaultdict[str, set[str]](set)
    for module, path in modules.items():
        for node in ast.walk(ast.parse(path.read_text())):
            if not isinstance(node, ast.Import | ast.ImportFrom):
                continue
            names = [alias.name for alias in node.names]
            if isinstance(node, ast.ImportFrom):
                assert node.level == 0, f"{path}: relative import"
                names = [f"{node.module}.{name}" for name in names]
            for name in names:
                own = name if name in modules else name.rpartition(".")[0]
                if own in modules and own != module:
                    found[module].add(own)
    return found


def test_imports_run_one_way():
    found = {
        (module.split(".")[1], other.split(".")[1])
        for module, others in imports().items()
        for other in others
    }
    assert ("operator", "errors") in found
    assert not {(a, b) for a, b in found if LAYERS.index(b) > LAYERS.index(a)}
    for room, allowed in WORLD.items():
        assert {other for here, other in found if here == room} - {room} <= allowed, room


def test_no_modules_import_each_other_in_a_circle():
    TopologicalSorter(imports()).prepare()  # raises CycleError, which names the modules


@pytest.mark.parametrize(("method", "place"), preisach_jax.SHOWN_BY.items())
def test_what_a_method_of_a_result_calls_is_there(method, place):
    module, _, name = place.rpartition(".")
    assert callable(getattr(import_module(f"preisach_jax.{module}"), name)), method


def run_python(code, **environment):
    """What `code` prints in a fresh interpreter."""
    done = subprocess.run(
        [sys.executable, "-W", "error", "-c", code],
        env=os.environ | {"PYTHONPATH": str(PACKAGE.parent)} | environment,
        capture_output=True, text=True, timeout=300, check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr[-2000:]
    return done.stdout.split()


def test_the_command_line_is_loaded_without_what_only_its_commands_need():
    code = "import preisach_jax.cli.application as a, sys; a.build(); print(*sys.modules)"
    assert not set(run_python(code)) & {"jax", "scipy", "pandas", "numpy", "rich"}


def test_importing_all_loads_no_heavy_package_configures_nothing_and_starts_no_device():
    # With a platform that does not exist, the first use of a device fails.
    code = """
import jax
before = dict(jax.config.values)
import preisach_jax.fit, preisach_jax.paper.sweep
from preisach_jax import *
assert dict(jax.config.values) == before
assert len(before) > 20
import preisach_jax as pj, sys
print(pj.fit.__name__, pj.sweep.__name__, pj.signals.__name__, *sys.modules)
try:
    jax.devices()
except RuntimeError:
    print("no device until asked for")
"""
    names, loaded = (out := run_python(code, JAX_PLATFORMS="no_such_platform"))[:3], set(out)
    assert names == ["fit", "sweep", "preisach_jax.signals"]  # functions come before modules
    assert out[-1] == "for"
    # SciPy loads its parts when they are used; these take longer than all of this package.
    assert not loaded & {
        "matplotlib", "pandas", "pyarrow", "pydantic", "distributed", "typer", "rich", "jinja2",
        "panel", "bokeh", "scipy.signal", "scipy.stats", "scipy.optimize", "scipy.ndimage",
    }  # fmt: skip
