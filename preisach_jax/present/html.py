"""Headings, sentences and tables as HTML for notebooks; everything that is said is escaped.

Styles stand inline, take colours from the page around them, and so suit dark and light themes.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from html import escape

_LINE = "rgba(128,128,128,.45)"
_CELL = "padding:.15em 1.2em .15em 0;border:0;background:none;vertical-align:top"


def block(*parts: str) -> str:
    """Parts made by this module, one below the other."""
    style = f"margin:.3em 0;padding-left:.8em;border-left:3px solid {_LINE}"
    return f'<div style="{style}">{"".join(parts)}</div>'


def heading(text: str) -> str:
    """What the whole is, as a bold line."""
    return f'<p style="margin:.3em 0;font-weight:600">{escape(text)}</p>'


def sentence(text: str) -> str:
    """A paragraph, or nothing if there is no text."""
    return f'<p style="margin:.3em 0">{escape(text)}</p>' if text else ""


def table(headers: Sequence[str], rows: Iterable[Sequence[str]], numbers_from: int = 99) -> str:
    """A compact table."""
    rows = list(rows)
    if not rows:
        return ""

    def line(cells: Sequence[str], tag: str, more: str) -> str:
        sides = ["right" if place >= numbers_from else "left" for place in range(len(cells))]
        return "".join(
            f'<{tag} style="{_CELL};{more};text-align:{side}">{escape(cell)}</{tag}>'
            for cell, side in zip(cells, sides, strict=True)
        )

    ruled = f"font-weight:600;border-bottom:1px solid {_LINE}"
    head = f"<thead><tr>{line(headers, 'th', ruled)}</tr></thead>" if headers else ""
    body = "".join(f"<tr>{line(row, 'td', 'white-space:pre-wrap')}</tr>" for row in rows)
    # Tables do not take colour and size from the page where it states no standard.
    style = "border-collapse:collapse;margin:.4em 0;color:inherit;font-size:inherit"
    return f'<table style="{style}">{head}<tbody>{body}</tbody></table>'
