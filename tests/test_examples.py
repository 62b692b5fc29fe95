"""The examples of everything that the reference or the package itself offers run as they are."""

import doctest
import re
from pathlib import Path
from pkgutil import resolve_name

import pytest

import preisach_jax as pj

REFERENCE = Path(__file__).parents[1] / "docs" / "reference"
DOCUMENTED = {
    name
    for page in REFERENCE.glob("*.md")
    for name in re.findall(r"^::: (\S+)", page.read_text(encoding="utf-8"), re.MULTILINE)
}
THINGS = {f"preisach_jax.{name}": getattr(pj, name) for name in pj.__all__}
THINGS |= {name: resolve_name(name) for name in DOCUMENTED}
THINGS |= {f"{kind.__module__}.{kind.__name__}": kind for kind in map(type, pj.effects().values())}
NAMES = {id(thing): name for name, thing in THINGS.items()}  # one of each thing
FLAGS = doctest.NORMALIZE_WHITESPACE | doctest.ELLIPSIS


@pytest.mark.parametrize("name", sorted(NAMES.values()))
def test_examples_run(name):
    told: list[str] = []
    runner = doctest.DocTestRunner(optionflags=FLAGS)
    for found in doctest.DocTestFinder().find(THINGS[name], name):
        runner.run(found, out=told.append)
    assert not runner.failures, "".join(told)
