"""Settings and fixtures shared by all tests."""

import ctypes
import os
from importlib.metadata import version
from pathlib import Path

# Set before JAX or matplotlib is first imported. A run on an accelerator says so in JAX_PLATFORMS.
os.environ.setdefault("JAX_PLATFORMS", "cpu")
os.environ.setdefault("MPLBACKEND", "Agg")
# What one test has compiled need not be compiled by the others, by their subprocesses, or tomorrow.
os.environ.setdefault("JAX_COMPILATION_CACHE_DIR", str(Path(__file__).parents[1] / ".jax_cache"))
os.environ.setdefault("JAX_PERSISTENT_CACHE_MIN_COMPILE_TIME_SECS", "0")
os.environ.setdefault("JAX_PERSISTENT_CACHE_MIN_ENTRY_SIZE_BYTES", "-1")
# Most of the time of a first run is compilation: tests want code soon, not fast code. A program
# compiles in a third of the time if it is not optimised, nor split, and without fusion emitters.
if os.environ["JAX_PLATFORMS"] == "cpu":
    flags = (
        "--xla_backend_optimization_level=0 --xla_llvm_disable_expensive_passes=true "
        "--xla_cpu_parallel_codegen_split_count=1"
    )
    # XLA ends the process at a flag that it does not know; 0.11 has the emitters for good.
    if tuple(map(int, version("jaxlib").split(".")[:2])) < (0, 11):
        flags += " --xla_cpu_use_fusion_emitters=false"
    os.environ.setdefault("XLA_FLAGS", flags)
if "PYTEST_XDIST_WORKER" in os.environ:  # each worker has a core of its own
    os.environ.setdefault("OMP_NUM_THREADS", "1")

import jax
import numpy as np
import pytest
from durations import Durations
from hypothesis import settings
from matplotlib.figure import Figure

from preisach_jax import report
from preisach_jax.plot.style import png, svg
from preisach_jax.record import reading
from preisach_jax.record.apart import read_here

jax.config.update("jax_numpy_rank_promotion", "raise")

# The first example of a test often compiles, so a deadline an example would measure the compiler.
EXAMPLES = int(os.environ.get("PREISACH_EXAMPLES", "30"))  # a campaign asks for more
settings.register_profile("tests", deadline=None, derandomize=True, max_examples=EXAMPLES)
settings.load_profile("tests")

SHARED_DATA = Path(__file__).resolve().parents[2] / "shared" / "data"


def pytest_configure(config):
    config.pluginmanager.register(Durations())


def pytest_collection_modifyitems(items):
    """Files with slow tests come first: one begun last would keep a worker while others idle."""
    slow = {item.path for item in items if item.get_closest_marker("slow")}
    items.sort(key=lambda item: item.path not in slow)


@pytest.fixture(autouse=True, scope="session")
def files_are_read_in_this_process():
    """Hundreds of damaged files are read, and a child takes a second; tests of it ask for it."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(reading, "read_apart", read_here)
        yield


@pytest.fixture(autouse=True, scope="session")
def figures_of_reports_are_blank():
    """Dozens of reports are written, and drawing takes four seconds; tests of it ask for it."""
    text, picture = svg(Figure(figsize=(1, 1))), png(Figure(figsize=(1, 1)))
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(report, "svg", lambda figure: text)
        patch.setattr(report, "png", lambda figure: picture)
        yield


@pytest.fixture
def figures_are_drawn(monkeypatch):
    """The figures of the reports that this test writes are those of its results."""
    monkeypatch.setattr(report, "svg", svg)
    monkeypatch.setattr(report, "png", png)


MOST_MEMORY = 3 * 2**30
"""Bytes that a worker may hold before it lets go what it has compiled."""


@pytest.fixture(autouse=True, scope="module")
def compiled_code_is_let_go():
    """What one file has compiled serves the next, but not when gigabytes have piled up."""
    yield
    statm = Path("/proc/self/statm")
    held = int(statm.read_text().split()[1]) * os.sysconf("SC_PAGE_SIZE") if statm.exists() else 0
    if held > MOST_MEMORY or not statm.exists():
        jax.clear_caches()
        trim = getattr(ctypes.CDLL(None), "malloc_trim", None) if statm.exists() else None  # glibc
        if trim is not None:
            trim(0)


@pytest.fixture
def compilations():
    """A function that names the functions which JAX compiles while another one runs."""
    if not hasattr(jax.monitoring, "unregister_event_duration_listener"):
        pytest.skip("this JAX cannot be stopped from telling what it compiles")

    def names(run):
        seen = []

        def note(event: str, duration_secs: float, **keywords: str | int) -> None:
            if event == "/jax/core/compile/backend_compile_duration":
                seen.append(keywords.get("fun_name", event))

        jax.monitoring.register_event_duration_secs_listener(note)
        try:
            run()
        finally:
            jax.monitoring.unregister_event_duration_listener(note)
        return seen

    return names


@pytest.fixture(params=["float32", "float64"])
def precision(request):
    """The test runs once in each floating-point precision; the value is the dtype's name."""
    with jax.enable_x64(request.param == "float64"):
        yield request.param


@pytest.fixture
def tolerance(precision):
    """Relative rounding to allow in `precision`: a few hundred units in the last place."""
    return 500 * float(np.finfo(precision).eps)


@pytest.fixture
def x64():
    """The test runs in double precision."""
    with jax.enable_x64(True):
        yield


@pytest.fixture(scope="session")
def shared_data():
    """The folder of further measured records; the test is skipped where it is absent."""
    if not SHARED_DATA.is_dir():
        pytest.skip("the further measured records (../shared/data) are not here")
    return SHARED_DATA
