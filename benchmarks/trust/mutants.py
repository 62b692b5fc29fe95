"""Change the package in small ways and see whether the tests notice: mutation testing.

    python benchmarks/trust/mutants.py named                     # changes that once survived
    python benchmarks/trust/mutants.py drawn --count 40          # changes drawn by chance
    python benchmarks/trust/mutants.py drawn --count 40 --modules diagnosis/evidence.py
    python benchmarks/trust/mutants.py drawn --count 40 --full   # survivors against campaigns too

A drawn change swaps a comparison, an operation, `min` and `max`, `and` and `or`, drops a `not`, or
moves a number; each is tried on a copy of the package, against the tests named beside the module in
`TESTS`, which are those of the suite (`make test`) without its campaigns.  A change that no test
notices is a survivor: some change nothing that counts, others are gaps.  With `--full`, survivors
are tried once more, against the tests of `CAMPAIGNS`, which the suite leaves out: what these notice
is what the suite lost by leaving them out.  The result goes to `benchmarks/results/trust/`.
"""

from __future__ import annotations

import argparse
import ast
import copy
import os
import random
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from conditions import write_results

import preisach_jax

ROOT = Path(__file__).resolve().parents[2]
PACKAGE = Path(preisach_jax.__file__).parent
MOST_SECONDS = 300.0

TESTS: dict[str, tuple[str, ...]] = {
    "operator/events.py": ("test_events.py",),
    "operator/learning.py": ("test_events.py",),
    "diagnosis/evidence.py": ("test_decisions.py", "test_evidence.py"),
    "diagnosis/budget.py": ("test_decisions.py", "test_budget.py", "test_evidence.py"),
    "diagnosis/noise.py": ("test_decisions.py", "test_budget.py", "test_evidence.py"),
    "diagnosis/judgement.py": ("test_decisions.py",),
    "diagnosis/trial.py": ("test_decisions.py", "test_trial.py"),
    "diagnosis/result.py": ("test_decisions.py", "test_report.py"),
    "diagnosis/step.py": ("test_decisions.py", "test_exploration.py"),
    "diagnosis/walk.py": ("test_decisions.py", "test_exploration.py", "test_rivals.py"),
    "diagnosis/conclusion.py": ("test_decisions.py", "test_exploration.py", "test_rivals.py"),
    "identify/point.py": ("test_decisions.py", "test_evidence.py", "test_confidence.py"),
    "effects/drift.py": ("test_decisions.py", "test_effects.py"),
    "effects/eddy_currents.py": ("test_effects.py", "test_eddy_currents.py"),
    "effects/gain.py": ("test_effects.py", "test_machines.py"),
    "effects/rate_dependence.py": ("test_effects.py", "test_hysteresis_effects.py"),
    "effects/viscosity.py": ("test_effects.py", "test_machines.py"),
}
"""Modules, and the quick tests that guard each; whole diagnoses (`test_diagnosis.py`) are left out,
so that a survivor here is one of the small tests."""


CAMPAIGNS: dict[str, tuple[str, ...]] = {
    "diagnosis/step.py": ("test_diagnosis.py", "-k", "outside_the_library"),
    "diagnosis/walk.py": ("test_diagnosis.py", "-k", "alike or like_size or input_lag"),
    "diagnosis/conclusion.py": ("test_diagnosis.py", "-k", "slow_waves or outside_the_library"),
    "effects/eddy_currents.py": ("test_eddy_currents.py",),
    "effects/gain.py": ("test_machines.py", "-k", "gain"),
    "effects/rate_dependence.py": ("test_hysteresis_effects.py",),
    "effects/viscosity.py": ("test_machines.py", "-k", "viscosity"),
}
"""Modules, and the campaigns' tests that look at each; of the other modules there are none."""


@dataclass(frozen=True)
class Mutant:
    """A changed module.

    Attributes:
        module: its path inside the package.
        line: number of the line that is changed.
        change: what is changed, in words.
        source: the text of the module afterwards.
    """

    module: str
    line: int
    change: str
    source: str


NAMED: tuple[tuple[str, str, str], ...] = (
    ("operator/events.py", "np.minimum(lowest[-1], since[0])", "lowest[-1].copy()"),
    ("diagnosis/evidence.py", "AR_ORDER = 20", "AR_ORDER = 19"),
    ("diagnosis/evidence.py", "AR_ORDER = 20", "AR_ORDER = 40"),
    ("diagnosis/evidence.py", "AR_ORDER = 20", "AR_ORDER = 1"),
    ("identify/point.py", "GRID_ORDER = 1.0", "GRID_ORDER = 2"),
    ("identify/point.py", "GRID_ORDER = 1.0", "GRID_ORDER = 0.5"),
    ("diagnosis/noise.py", "SETTLING = 50", "SETTLING = 0"),
    ("diagnosis/noise.py", "SETTLING = 50", "SETTLING = 49"),
    ("diagnosis/noise.py", "SETTLING = 50", "SETTLING = 60"),
    ("diagnosis/noise.py", "MOST_COLOURED = 5.0", "MOST_COLOURED = 50.0"),
    ("diagnosis/budget.py", "PATH_OVER_LINE = 2.5**0.5", "PATH_OVER_LINE = 1.0"),
    ("diagnosis/result.py", "min(self.memory, self.noise)", "self.memory"),
    ("diagnosis/judgement.py", "return BY_THE_PRIOR, plain", "pass"),
    ("diagnosis/judgement.py", "return BY_THE_PRIOR, plain", "return BY_THE_PRIOR, now"),
    ("diagnosis/judgement.py", "WEAK = 0.9", "WEAK = 0.8"),
    (
        "diagnosis/result.py",
        "self.unexplained <= self.allowed",
        "self.unexplained <= 1.2 * self.allowed",
    ),
    (
        "diagnosis/result.py",
        "self.unexplained <= self.allowed",
        "self.unexplained <= 0.8 * self.allowed",
    ),
    ("diagnosis/judgement.py", "LEAST_GAIN_WITHIN_BUDGET = 0.5", "LEAST_GAIN_WITHIN_BUDGET = 0.45"),
    ("diagnosis/judgement.py", "SECOND_OF_A_KIND = 0.5", "SECOND_OF_A_KIND = 0.45"),
    (
        "diagnosis/step.py",
        "return self.above_budget <= 2",
        "return self.above_budget <= 1.9",
    ),
    (
        "diagnosis/step.py",
        "return self.above_budget <= 2",
        "return self.above_budget <= 2.1",
    ),
    ("diagnosis/step.py", "REFINEMENT_PAYS = 0.1", "REFINEMENT_PAYS = 0.11"),
    (
        "diagnosis/walk.py",
        "if step.position:\n        least",
        "if step.position or step.is_within_budget:\n        least",
    ),
    (
        "diagnosis/conclusion.py",
        "LEAST_BESIDE_THE_UNEXPLAINED = 0.2",
        "LEAST_BESIDE_THE_UNEXPLAINED = 0.05",
    ),
    ("effects/drift.py", "WANDERS = 0.5", "WANDERS = 0.4"),
    ("effects/drift.py", "WANDERS = 0.5", "WANDERS = 0.6"),
    (
        "effects/drift.py",
        "wander, least = replace(settled, waves=waves), left",
        "wander = replace(settled, waves=waves)",
    ),
)
"""Changes that survived the tests of an earlier state, and their like: module, text, other text."""


def named() -> Iterator[Mutant]:
    """The changes that are listed above."""
    for module, old, new in NAMED:
        source = (PACKAGE / module).read_text(encoding="utf-8")
        if source.count(old) != 1:
            raise SystemExit(f"{module}: {old!r} is there {source.count(old)} times, not once")
        line = source[: source.index(old)].count("\n") + 1
        yield Mutant(module, line, f"{old}  ->  {new}", source.replace(old, new))


_COMPARISONS = {
    ast.Lt: ast.LtE, ast.LtE: ast.Lt, ast.Gt: ast.GtE, ast.GtE: ast.Gt, ast.Eq: ast.NotEq,
    ast.NotEq: ast.Eq, ast.Is: ast.IsNot, ast.IsNot: ast.Is, ast.In: ast.NotIn, ast.NotIn: ast.In,
}  # fmt: skip
_OPERATIONS = {ast.Add: ast.Sub, ast.Sub: ast.Add, ast.Mult: ast.Div, ast.Div: ast.Mult}
_OTHER = {"min": "max", "max": "min", "minimum": "maximum", "maximum": "minimum"}
_OTHER |= {"any": "all", "all": "any", "argmin": "argmax", "argmax": "argmin"}


def _changed(node: ast.AST) -> ast.AST | None:
    """A node in the place of another one; None where there is nothing to change."""
    node = copy.deepcopy(node)
    if isinstance(node, ast.Compare) and type(node.ops[0]) in _COMPARISONS:
        node.ops[0] = _COMPARISONS[type(node.ops[0])]()
    elif isinstance(node, ast.BinOp) and type(node.op) in _OPERATIONS:
        node.op = _OPERATIONS[type(node.op)]()
    elif isinstance(node, ast.BoolOp):
        node.op = ast.Or() if isinstance(node.op, ast.And) else ast.And()
    elif isinstance(node, ast.UnaryOp) and isinstance(node.op, ast.Not | ast.USub):
        return node.operand
    elif isinstance(node, ast.Constant) and type(node.value) in (int, float):
        node.value = node.value + 1 if isinstance(node.value, int) else 1.3 * node.value
    elif isinstance(node, ast.Attribute) and node.attr in _OTHER:
        node.attr = _OTHER[node.attr]
    elif isinstance(node, ast.Name) and node.id in _OTHER:
        node.id = _OTHER[node.id]
    else:
        return None
    return node


_SKIPPED = (ast.Raise, ast.Assert, ast.JoinedStr, ast.Import, ast.ImportFrom)


def _places(node: ast.AST) -> Iterator[ast.AST]:
    """All nodes outside of messages, annotations and decorators."""
    for field, value in ast.iter_fields(node):
        if field in ("annotation", "returns", "decorator_list"):
            continue
        for child in value if isinstance(value, list) else [value]:
            if isinstance(child, ast.AST) and not isinstance(child, _SKIPPED):
                yield child
                yield from _places(child)


def drawn(module: str) -> list[Mutant]:
    """All changes of one node of a module; the text around it stays as it is."""
    source = (PACKAGE / module).read_text(encoding="utf-8")
    # Positions of nodes count bytes.
    lines = source.encode().splitlines(keepends=True)
    begins = [0]
    for line in lines:
        begins.append(begins[-1] + len(line))
    found: list[Mutant] = []
    for node in _places(ast.parse(source)):
        other = _changed(node)
        if other is None or not isinstance(node, ast.expr) or node.end_lineno is None:
            continue
        begin = begins[node.lineno - 1] + node.col_offset
        end = begins[node.end_lineno - 1] + (node.end_col_offset or 0)
        old, new = ast.unparse(node), ast.unparse(other)
        text = source.encode()
        text = text[:begin] + b"(" + new.encode() + b")" + text[end:]
        found.append(Mutant(module, node.lineno, f"{old}  ->  {new}", text.decode()))
    return found


def tried(mutant: Mutant, package: Path, full: bool = False) -> dict[str, str | int | float]:
    """Whether the tests notice a change; `package` is the folder of the copy.

    A survivor is tried against the tests of campaigns as well, if `full`.
    """
    path = package / "preisach_jax" / mutant.module
    original = path.read_text(encoding="utf-8")
    path.write_text(mutant.source, encoding="utf-8")
    begin = time.perf_counter()
    outcome, by = "survived", ""
    try:
        for name in TESTS[mutant.module]:
            outcome, by = _outcome(package, (name,))
            if outcome != "survived":
                break
        if full and outcome == "survived" and mutant.module in CAMPAIGNS:
            outcome, by = _outcome(package, (*CAMPAIGNS[mutant.module], "-m", "campaign"))
            outcome = "noticed by a campaign alone" if outcome == "noticed" else outcome
    finally:
        path.write_text(original, encoding="utf-8")
    seconds = round(time.perf_counter() - begin, 1)
    return {
        "module": mutant.module, "line": mutant.line, "change": mutant.change,
        "outcome": outcome, "by": by, "seconds": seconds,
    }  # fmt: skip


def _outcome(package: Path, asked: tuple[str, ...]) -> tuple[str, str]:
    """What a file of tests, with options, says of the copy, and the test that notices a change."""
    words = ["-q", "-x", "-p", "no:cacheprovider", "--no-header", "--tb=line"]
    environment = os.environ | {"PYTHONPATH": str(package), "PYTHONDONTWRITEBYTECODE": "1"}
    environment.setdefault("JAX_COMPILATION_CACHE_DIR", str(ROOT / ".jax_cache"))
    try:
        done = subprocess.run(
            [sys.executable, "-m", "pytest", *words, str(package / "tests" / asked[0]), *asked[1:]],
            cwd=package, env=environment, capture_output=True, text=True, check=False,
            timeout=MOST_SECONDS,
        )  # fmt: skip
    except subprocess.TimeoutExpired:
        return "not ended", ""
    failed = [line for line in done.stdout.splitlines() if line.startswith(("FAILED", "ERROR"))]
    by = failed[0].split(" ", 2)[1].removeprefix("tests/") if failed else ""
    return {0: "survived", 1: "noticed", 2: "noticed"}.get(done.returncode, "not run"), by


def copied(folder: Path) -> Path:
    """A copy of the package and its tests."""
    for source in (PACKAGE, ROOT / "tests", ROOT / "benchmarks"):
        ignored = shutil.ignore_patterns("__pycache__", "results")
        shutil.copytree(source, folder / source.name, ignore=ignored)
    shutil.copy(ROOT / "pyproject.toml", folder)
    return folder


def main() -> None:
    """Try the changes and write what came of each."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("kind", choices=("named", "drawn"))
    parser.add_argument("--modules", nargs="+", choices=list(TESTS), default=list(TESTS))
    parser.add_argument("--count", type=int, default=40, help="changes that are drawn")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--full", action="store_true", help="survivors against campaigns as well")
    parser.add_argument("--keep", action="store_true", help="write no result")
    asked = parser.parse_args()
    if asked.kind == "named":
        mutants = [each for each in named() if each.module in asked.modules]
    else:
        rng = random.Random(asked.seed)
        every = [mutant for module in asked.modules for mutant in drawn(module)]
        mutants = rng.sample(every, min(asked.count, len(every)))
    rows: list[dict[str, str | int | float]] = []
    with tempfile.TemporaryDirectory() as folder:
        package = copied(Path(folder))
        for mutant in mutants:
            rows.append(tried(mutant, package, asked.full))
            row = rows[-1]
            told = f"{row['outcome']:9s} {row['module']}:{row['line']} {row['change']}  {row['by']}"
            print(told, flush=True)
    rows.sort(key=lambda row: row["outcome"] == "noticed")
    noticed = sum(row["outcome"] == "noticed" for row in rows)
    print(f"{noticed} of {len(rows)} were noticed")
    if not asked.keep:
        write_results(
            f"trust/mutants_{asked.kind}.json",
            {"noticed": noticed, "tried": len(rows), "mutants": rows},
        )


if __name__ == "__main__":
    main()
