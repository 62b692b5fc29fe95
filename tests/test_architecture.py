"""The house: imports run one way, and importing the package costs and changes nothing."""

import ast
import importlib
import importlib.metadata
import os
import subprocess
import sys
from graphlib import TopologicalSorter
from pathlib import Path

import pytest

import preisach_jax

PACKAGE = Path(preisach_jax.__file__).parent

# From below: a file may import from those before its own layer, and within its layer.
LAYERS = [
    "errors",
    "escape",
    "quantity",
    "files",
    "cores",
    "devices",
    "work",
    "operator",
    "filter",
    "signals",
    "plant",
    "piezo",
    "frequency",
    "theory",
    "sweep",
    "record",
    "look",
    "effects",
    "mechanics",
    "chain",
    "model",
    "loss",
    "export",
    "compensation",
    "identify",
    "fit",
    "diagnosis",
    "present",
    "paper",
    "plot",
    "report",
    "app",
    "cli",
    "__main__",
]
# Methods that users expect on a result, and that load a higher room when they are called.
LATE = {
    "present": {"record", "model", "fit", "diagnosis"},
    "plot": {"look", "compensation", "fit"},
    "export": {"model"},
}

# The simulated world shares no code with the models that are to explain it.
WORLD = {
    "signals": {"errors"},
    "plant": {"errors", "signals"},
    "piezo": {"errors", "signals", "plant"},
    "frequency": {"errors", "signals"},
}

MAX_FUNCTION_LINES = 80


def name_of(path):
    """Dotted name of a module of the package, without the package's own."""
    parts = path.relative_to(PACKAGE).with_suffix("").parts
    return ".".join(parts[:-1] if parts[-1] == "__init__" else parts)


MODULES = {name_of(path): path for path in sorted(PACKAGE.rglob("*.py"))}
TREES = {name: ast.parse(path.read_text()) for name, path in MODULES.items()}


def is_for_types(node):
    return isinstance(node, ast.If) and "TYPE_CHECKING" in ast.unparse(node.test)


def imported(name, *, late=False):
    """Modules of the package that a module imports: as it is imported itself, or `late`, in a call.

    Imports for type annotations alone count as any other.
    """
    found = set()

    def visit(node, in_function):
        if isinstance(node, ast.ImportFrom) and in_function == late:
            assert node.level == 0, f"{name}: relative import"
            if (node.module or "").split(".")[0] == "preisach_jax":
                base = (node.module or "").removeprefix("preisach_jax").removeprefix(".")
                for alias in node.names:
                    full = f"{base}.{alias.name}".removeprefix(".")
                    found.add(full if full in MODULES else base)
        if isinstance(node, ast.Import) and in_function == late:
            found.update(
                alias.name.removeprefix("preisach_jax").removeprefix(".")
                for alias in node.names
                if alias.name.split(".")[0] == "preisach_jax"
            )
        inside = in_function or isinstance(node, ast.FunctionDef | ast.Lambda)
        for child in ast.iter_child_nodes(node):
            visit(child, inside)

    visit(TREES[name], False)
    return found - {name}


def layer_of(name):
    return name.split(".")[0]


def test_the_imports_of_a_module_are_seen():
    assert {"errors", "operator.hysteron"} <= imported("operator.plane")
    assert {"plot", "present.fit"} <= imported("fit.result", late=True)
    assert "diagnosis.result" in imported("present.diagnosis")  # for its types alone


def test_every_module_has_a_layer():
    missing = {layer_of(name) for name in MODULES if name} - set(LAYERS)
    assert not missing, f"give {missing} a place in LAYERS"


@pytest.mark.parametrize("name", [name for name in MODULES if name])
def test_imports_run_one_way(name):
    here = LAYERS.index(layer_of(name))
    for other in imported(name):
        assert other, f"{name} imports the package's own names; import from the module"
        assert LAYERS.index(layer_of(other)) <= here, f"{name} imports {other} from above"
    for other in imported(name, late=True):
        is_allowed = layer_of(name) in LATE.get(layer_of(other), ())
        assert is_allowed or LAYERS.index(layer_of(other)) <= here, f"{name} imports {other}"


def test_every_late_import_that_is_allowed_is_there():
    climbing = {
        (layer_of(other), layer_of(name))
        for name in MODULES
        if name
        for other in imported(name, late=True)
        if LAYERS.index(layer_of(other)) > LAYERS.index(layer_of(name))
    }
    assert climbing == {(above, below) for above, rooms in LATE.items() for below in rooms}


def test_no_two_modules_need_each_other():
    graph = {name: imported(name) - {""} for name in MODULES if name}
    # raises CycleError, which names the circle
    assert len(list(TopologicalSorter(graph).static_order())) >= len(graph)


@pytest.mark.parametrize("name", [name for name in MODULES if layer_of(name) in WORLD])
def test_the_simulated_world_shares_no_code_with_the_models(name):
    layers = {layer_of(other) for late in (False, True) for other in imported(name, late=late)}
    assert layers <= WORLD[layer_of(name)] | {layer_of(name)}


def test_the_simulated_world_is_there():
    assert set(WORLD) <= {layer_of(name) for name in MODULES}


def running(node):
    """Every node below `node` that runs, so none that stands there for type annotations alone."""
    for child in ast.iter_child_nodes(node):
        if not is_for_types(child):
            yield child
            yield from running(child)


def test_only_plot_draws():
    drawing = set()
    for name, tree in TREES.items():
        for node in running(tree):
            if isinstance(node, ast.Import | ast.ImportFrom) and "matplotlib" in ast.unparse(node):
                drawing.add(layer_of(name))
    assert drawing <= {"plot"}


def test_functions_are_short():
    too_long = [
        f"{name}.{node.name} has {(node.end_lineno or 0) - node.lineno + 1} lines"
        for name, tree in TREES.items()
        for node in ast.walk(tree)
        if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef)
        and (node.end_lineno or 0) - node.lineno + 1 > MAX_FUNCTION_LINES
    ]
    assert not too_long


def run_python(code, **environment):
    """Run `code` in a fresh interpreter; its output, or a failure with what it said."""
    done = subprocess.run(
        [sys.executable, "-W", "error", "-c", code],
        env=os.environ | {"PYTHONPATH": str(PACKAGE.parent)} | environment,
        capture_output=True,
        text=True,
        timeout=100,
        check=False,
    )
    assert done.returncode == 0, done.stderr[-2000:]
    return done.stdout


def test_the_public_names_are_those_that_type_checkers_see():
    (block,) = [node for node in TREES[""].body if is_for_types(node)]
    seen = {
        alias.asname or alias.name: (node.module, alias.name)
        for node in ast.walk(block)
        if isinstance(node, ast.ImportFrom)
        for alias in node.names
    }
    assert sorted(seen) == sorted(preisach_jax.__all__)
    for name, (module, there) in seen.items():
        assert getattr(preisach_jax, name) is getattr(importlib.import_module(module or ""), there)
        assert name in dir(preisach_jax)
    assert preisach_jax.__version__ == importlib.metadata.version("preisach_jax")


def test_functions_come_before_modules_of_the_same_name_and_other_modules_are_found():
    code = (
        "import preisach_jax.fit, preisach_jax.sweep, preisach_jax.effects.creep\n"
        "import preisach_jax as pj\n"
        "print(pj.fit.__name__, pj.sweep.__name__, pj.effects.__name__, pj.signals.__name__)\n"
        "print(hasattr(pj, 'no_such'))"
    )
    assert run_python(code).split() == [
        "fit", "sweep", "library", "preisach_jax.signals", "False",
    ]  # fmt: skip


def test_the_command_line_is_loaded_without_what_only_its_commands_need():
    code = "import preisach_jax.cli.application as a, sys; a.build(); print(*sys.modules)"
    assert not set(run_python(code).split()) & {"jax", "scipy", "pandas", "numpy", "rich"}


def test_importing_loads_no_heavy_package():
    assert not set(run_python("import preisach_jax, sys; print(*sys.modules)").split()) & {
        "jax", "scipy", "numpy",
    }  # fmt: skip
    code = "from preisach_jax import *; import sys; print(*sorted(sys.modules))"
    loaded = set(run_python(code).split())
    assert {"jax", "scipy"} <= loaded
    assert not loaded & {
        "matplotlib", "pandas", "pyarrow", "pydantic", "zarr", "typer", "rich", "jinja2",
    }  # fmt: skip
    # SciPy loads its parts when they are used; these take longer than all of this package.
    assert not loaded & {"scipy.signal", "scipy.stats", "scipy.optimize", "scipy.ndimage"}


def test_importing_leaves_the_configuration_of_jax_alone():
    code = (
        "import jax\n"
        "before = dict(jax.config.values)\n"
        "from preisach_jax import *\n"
        "after = dict(jax.config.values)\n"
        "assert len(before) > 20\n"
        "print({k for k in before if before[k] != after.get(k)} or 'unchanged')"
    )
    assert run_python(code).strip() == "unchanged"


def test_importing_starts_no_device():
    # With a platform that does not exist, the first use of a device fails.
    code = (
        "import jax\n"
        "from preisach_jax import *\n"
        "try:\n"
        "    jax.devices()\n"
        "except RuntimeError:\n"
        "    print('no device until asked for')"
    )
    out = run_python(code, JAX_PLATFORMS="no_such_platform")
    assert out.strip() == "no device until asked for"
