"""What the shell offers when a word is completed; files it completes by itself."""

from __future__ import annotations

import re
from pathlib import Path


def effect_names() -> list[str]:
    """The built-in effects, one file each: to load them takes seconds, and a key is pressed."""
    files = (Path(__file__).parents[1] / "effects").glob("*.py")
    texts = {path.stem: path.read_text(encoding="utf-8") for path in files}
    named = r'^    name(: ClassVar\[str\])? = "{}"$'
    return sorted(n for n, text in texts.items() if re.search(named.format(n), text, re.M))


def complete_effect(incomplete: str) -> list[str]:
    """Names of effects that begin so."""
    return [name for name in effect_names() if name.startswith(incomplete)]


def complete_effects(incomplete: str) -> list[str]:
    """Lists of effects that go on so; each effect stands in a list once."""
    before, comma, last = incomplete.rpartition(",")
    taken = before.split(",")
    return [before + comma + name for name in complete_effect(last) if name not in taken]
