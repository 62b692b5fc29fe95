"""Measure what each module of the tests costs: set-up, call, and of these tracing and compilation.

    PYTHONPATH=benchmarks python -m pytest -n 2 --dist worksteal -p durations

A plugin of pytest. Writes `benchmarks/results/durations.json`, in seconds, dearest first.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Generator

import jax
import pytest
from conditions import write_results

COMPILING = "/jax/core/compile/backend_compile_duration"
SPENT = {"compile": 0.0, "trace": 0.0}
MODULES: dict[str, dict[str, float]] = defaultdict(lambda: defaultdict(float))


def _note(event: str, duration_secs: float, **_: str | int) -> None:
    if event.startswith("/jax/core/compile/"):
        SPENT["compile" if event == COMPILING else "trace"] += duration_secs


jax.monitoring.register_event_duration_secs_listener(_note)


@pytest.hookimpl(wrapper=True)
def pytest_runtest_call(item: pytest.Item) -> Generator[None, None, None]:
    """Say with the report of a test what JAX took since the one before, fixtures included."""
    try:
        return (yield)
    finally:
        item.user_properties += [(name, SPENT[name]) for name in SPENT]
        SPENT.update(dict.fromkeys(SPENT, 0.0))


def pytest_runtest_logreport(report: pytest.TestReport) -> None:
    """Add up by module, in the process that all workers report to."""
    module = MODULES[report.nodeid.partition("::")[0]]
    module[report.when or "call"] += report.duration
    if report.when == "teardown":
        module["tests"] += 1
        for name, seconds in report.user_properties:
            module[name] += float(str(seconds))


def pytest_sessionfinish(session: pytest.Session) -> None:
    """Write the table, the dearest module first."""
    if hasattr(session.config, "workerinput"):
        return
    cost = {name: own["setup"] + own["call"] for name, own in MODULES.items()}
    rows = {
        name: {key: round(value, 1) for key, value in sorted(MODULES[name].items())}
        for name in sorted(MODULES, key=lambda name: -cost[name])
    }
    write_results("durations.json", {"modules": rows})
