"""The cost of each test: setup and call, CPU time, compilation. A run ends with the dearest ones.

PREISACH_DURATIONS=FILE also updates the rows of the files that were run in a table by file.
"""

import os
from collections import defaultdict
from pathlib import Path
from typing import Any

import jax
import pytest

SHOWN = 20
COLUMNS = ("file", "tests", "setup_s", "call_s", "cpu_s", "compile_s", "programs")
COMPILING = (
    "/jax/core/compile/jaxpr_trace_duration",
    "/jax/core/compile/jaxpr_to_mlir_module_duration",
    "/jax/core/compile/backend_compile_duration",
)
"""Seconds of tracing, lowering and compilation, or of reading from the cache what was compiled."""


class Durations:
    """A plugin of pytest, in each worker of a run and in the process that gathers what they say."""

    def __init__(self):
        self.compile_s, self.programs = 0.0, 0
        self.before = (0.0, 0.0, 0)
        self.tests = defaultdict(lambda: dict.fromkeys(COLUMNS[2:], 0.0))
        jax.monitoring.register_event_duration_secs_listener(self.compiled)

    def compiled(self, event: str, duration_secs: float, **_: str | int) -> None:
        if event in COMPILING:
            self.compile_s += duration_secs
            self.programs += event == COMPILING[-1]

    def spent(self):
        times = os.times()  # of children as well, once they have ended
        return sum(times[:4]), self.compile_s, self.programs

    @pytest.hookimpl(tryfirst=True)
    def pytest_runtest_logstart(self):
        self.before = self.spent()

    @pytest.hookimpl(wrapper=True)
    def pytest_runtest_makereport(self):
        report = yield
        now = self.spent()
        spent = [after - before for after, before in zip(now, self.before, strict=True)]
        report.user_properties = [("spent", spent)]
        self.before = now
        return report

    def pytest_runtest_logreport(self, report):
        spent = dict(report.user_properties).get("spent")
        if spent is not None:
            row = self.tests[report.nodeid]
            row["call_s" if report.when == "call" else "setup_s"] += report.duration
            for name, value in zip(COLUMNS[4:], spent, strict=True):
                row[name] += value

    def pytest_terminal_summary(self, terminalreporter):
        if os.environ.get("PREISACH_DURATIONS"):
            self.update(Path(os.environ["PREISACH_DURATIONS"]))
        dear = [each for each in self.tests.items() if each[1]["cpu_s"] >= 1.0]
        dear = sorted(dear, key=lambda each: -each[1]["cpu_s"])[:SHOWN]
        if not dear:
            return
        terminalreporter.section(f"the {len(dear)} tests of the most CPU time")
        for name, row in dear:
            line = "{cpu_s:6.1f} s, of it {compile_s:5.1f} s compiling {programs:3.0f} programs"
            terminalreporter.write_line(f"{line.format(**row)}: {name}")

    def update(self, path):
        import pandas as pd

        rows = pd.DataFrame(self.tests).T.astype({"programs": int})
        by_file: Any = rows.groupby([name.partition("::")[0] for name in rows.index])
        table: Any = by_file.sum().round(1)
        table.insert(0, "tests", by_file.size())
        if path.exists():
            before = pd.read_csv(path, index_col="file")
            table = pd.concat([before.drop(table.index, errors="ignore"), table]).sort_index()
        table[[Path(name).exists() for name in table.index]].to_csv(path, index_label="file")
