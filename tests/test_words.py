"""One word a concept, in plain English: what was replaced does not come back."""

import re
from pathlib import Path

import pytest

from preisach_jax.effects.places import Place

ROOT = Path(__file__).parent.parent
TEXTS = [
    *sorted((ROOT / "preisach_jax").rglob("*.py")),
    *sorted((ROOT / "docs").rglob("*.md")),
    *sorted((ROOT / "docs").glob("*.py")),
    ROOT / "README.md",
    ROOT / "CONTRIBUTING.md",
]
GLOSSARY = ROOT / "docs/reference/glossary.md"

BANNED = {  # a pattern, and what stands for it
    r"\b(two|both|first|second|these) locks?\b|\blocks? (is|are|stays?|opens?|open)\b": "test",
    r"^ +Args:$": "Arguments:",
    r"so-manyth": "n-th",
    r"\bunited (parameter|values?)\b": "with a unit",
    r"no name is sure": "no effect can be named reliably",
    r"behind midnight": "past midnight",
    r"of one's own accord": "automatically",
    r"not of yours": "internal error",
    r"that nobody looks at": "discarded",
    r"makes? up for the grid": "compensates discretisation",
    r"cannot hinder": "prevent",
    r"cells without end": "an infinitely fine grid",
    r"noise nor (the )?grid|noise and (the )?grid\b": "discretisation",
    r"\blose (it|all|them) and\b|Lose all": "delete",
    r"of an independent make": "simulated by independent code",
    r"sealed truth|truth is opened": "hidden effect",
    r"[Ww]ith eyes and a mouse": "in the browser",
    r"every so-many": "every n-th",
    r"(measured|wanted) less (model|predicted|expected)": "minus",
    r"acts? on the (hysterons|added|sum)\b": "a place of the enumeration",
}


@pytest.mark.parametrize("pattern", BANNED)
def test_what_was_replaced_does_not_come_back(pattern):
    found = [
        f"{path.relative_to(ROOT)}:{number}: {line.strip()}"
        for path in TEXTS
        for number, line in enumerate(path.read_text(encoding="utf-8").splitlines(), start=1)
        if re.search(pattern, line)
    ]
    assert not found, f"say {BANNED[pattern]!r}"


@pytest.mark.parametrize(
    "line",
    ["only if both locks open", "    Args:", "every so-manyth row", "neither noise nor grid"],
)
def test_an_old_word_would_be_found(line):
    assert any(re.search(pattern, line) for pattern in BANNED)


def test_the_glossary_has_the_places():
    text = GLOSSARY.read_text(encoding="utf-8")
    assert all(f"`{place}`" in text for place in Place)


def test_the_glossary_says_each_word_once():
    terms = re.findall(r"^\| ([^|]+) \|", GLOSSARY.read_text(encoding="utf-8"), flags=re.M)
    words = [word.strip() for term in terms for word in term.split(",")]
    words = [word for word in words if word not in ("term", "---")]
    assert len(words) > 50
    assert len(words) == len(set(words))
