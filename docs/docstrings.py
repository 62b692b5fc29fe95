"""How docstrings are read: an `Example:` is a section of examples, and `::` opens a block."""

from __future__ import annotations

import re
from typing import Any

import griffe

TITLES = {"Example": "Examples", "Class attributes": "Attributes"}
_LITERAL = re.compile(r"::$", re.MULTILINE)
_TITLE = re.compile(rf"^({'|'.join(TITLES)}):$", re.MULTILINE)


class SectionTitles(griffe.Extension):
    """Gives sections the titles that griffe knows."""

    def on_object(self, *, obj: griffe.Object, **kwargs: Any) -> None:
        """Rewrite the docstring of an object that was just loaded."""
        del kwargs
        if obj.docstring:
            text = _TITLE.sub(lambda found: f"{TITLES[found[1]]}:", obj.docstring.value)
            obj.docstring.value = _LITERAL.sub(":", text)
