r"""The LaTeX of docstrings as MathML, which browsers draw by themselves, without scripts or fonts.

Only what the docstrings use is known; anything else is an error, so that no formula is published
half translated.
"""

from __future__ import annotations

import re
from html import escape, unescape

SIGNS = {
    "alpha": "α", "beta": "β", "gamma": "γ", "delta": "δ", "Delta": "Δ", "ell": "ℓ", "eta": "η",
    "lambda": "λ", "mu": "μ", "omega": "ω", "phi": "φ", "varphi": "φ", "pi": "π", "rho": "ρ",
    "sigma": "σ", "tau": "τ", "theta": "θ", "zeta": "ζ", "partial": "∂", "top": "⊤",
    "infty": "∞",
}  # fmt: skip
OPERATORS = {
    "le": "≤", "ge": "≥", "gg": "≫", "ll": "≪", "in": "∈", "cdot": "·", "times": "×", "pm": "±",
    "to": "→", "leftarrow": "←", "|": "‖", "{": "{", "}": "}", "langle": "⟨", "rangle": "⟩",
    "lceil": "⌈", "rceil": "⌉",
}  # fmt: skip
NAMES = {"arsinh", "asinh", "cos", "exp", "ln", "log", "max", "min", "sin", "tanh"}
SPACES = {
    ",": "0.17em", ";": "0.28em", "quad": "1em", "qquad": "2em", "!": "-0.17em", " ": "0.25em",
}  # fmt: skip
ACCENTS = {"dot": "˙", "ddot": "¨", "bar": "¯", "hat": "^"}
SIZED = {"big", "bigl", "bigr", "Big", "Bigl", "Bigr", "left", "right"}

_TOKEN = re.compile(r"\\[A-Za-z]+|\\.|[A-Za-z]|\d+(?:\.\d+)?|\S")


class UnknownCommandError(ValueError):
    """A LaTeX command that this translation does not know."""


class _Reader:
    """Reads tokens from left to right and writes MathML."""

    def __init__(self, latex: str):
        self.tokens = _TOKEN.findall(latex)
        self.place = 0

    def _next(self) -> str:
        self.place += 1
        return self.tokens[self.place - 1]

    def _peek(self) -> str:
        return self.tokens[self.place] if self.place < len(self.tokens) else ""

    def row(self, end: str = "") -> str:
        """All up to a closing token, or to the end of the formula."""
        parts = []
        while self._peek() != end:
            parts.append(self.scripted())
        if end:
            self._next()
        return "<mrow>" + "".join(parts) + "</mrow>"

    def argument(self) -> str:
        """A group or a single sign, as TeX takes it: of a number its first digit."""
        token = self._peek()
        if token.isdigit() and len(token) > 1:
            self.tokens[self.place : self.place + 1] = list(token)
        return self.atom()

    def scripted(self) -> str:
        """An atom with what stands below and above it."""
        base = self.atom()
        below = above = ""
        while self._peek() in {"_", "^"}:
            if self._next() == "_":
                below = self.argument()
            else:
                above = self.argument()
        kind = "sub" * bool(below) + "sup" * bool(above)
        return f"<m{kind}>{base}{below}{above}</m{kind}>" if kind else base

    def atom(self) -> str:
        """One sign, group or command with its arguments."""
        token = self._next()
        if token == "{":
            return self.row("}")
        if token.startswith("\\"):
            return self._command(token[1:])
        if token.isalpha():
            return f"<mi>{token}</mi>"
        if token[0].isdigit():
            return f"<mn>{token}</mn>"
        stretchy = ' stretchy="false"' if token in "()[]|/" else ""
        return f"<mo{stretchy}>{escape('−' if token == '-' else token)}</mo>"

    def _command(self, name: str) -> str:
        if name in SIGNS:
            return f"<mi>{SIGNS[name]}</mi>"
        if name in OPERATORS:
            return f'<mo stretchy="false">{OPERATORS[name]}</mo>'
        if name in NAMES:
            return f"<mi>{name}</mi><mo>&#x2061;</mo>"
        if name in SPACES:
            return f'<mspace width="{SPACES[name]}"/>'
        if name in ACCENTS:
            accent = f'<mo stretchy="false">{ACCENTS[name]}</mo>'
            return f'<mover accent="true">{self.argument()}{accent}</mover>'
        if name in {"frac", "tfrac"}:
            return f"<mfrac>{self.argument()}{self.argument()}</mfrac>"
        if name == "sqrt":
            return f"<msqrt>{self.argument()}</msqrt>"
        if name in {"mathrm", "text"}:
            return re.sub(r"</?mrow>|</?mi>", "", self.atom()).join(("<mi>", "</mi>"))
        if name in {"sum", "oint"}:
            return f"<mo>{'∑' if name == 'sum' else '∮'}</mo>"
        if name in SIZED:
            return self.atom()
        raise UnknownCommandError(f"\\{name}")


def mathml(latex: str, block: bool = False) -> str:
    r"""A formula as MathML.

    Arguments:
        latex: the formula, without its delimiters.
        block: whether it stands on a line of its own.

    Returns:
        A `math` element.

    Raises:
        UnknownCommandError: if a command is not known.

    Example:
        >>> mathml(r"\tau \le 1")
        '<math><mrow><mi>τ</mi><mo stretchy="false">≤</mo><mn>1</mn></mrow></math>'
    """
    kind = ' display="block"' if block else ""
    return f"<math{kind}>{_Reader(latex).row()}</math>"


_INLINE = re.compile(r'<span class="arithmatex">\\\((.*?)\\\)</span>', re.DOTALL)
_BLOCK = re.compile(r'<div class="arithmatex">\s*\\\[(.*?)\\\]\s*</div>', re.DOTALL)


def in_page(html: str) -> str:
    """A page in which the formulas that arithmatex has marked are MathML."""
    html = _BLOCK.sub(lambda found: mathml(unescape(found[1]), block=True), html)
    return _INLINE.sub(lambda found: mathml(unescape(found[1])), html)
