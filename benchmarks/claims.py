"""Every quantitative claim of README and documentation: where it stands, and what it is read from.

    python benchmarks/claims.py                      # the table; which claims lack a source or fail
    python benchmarks/claims.py --run                # first make every result anew, then compare
    python benchmarks/claims.py --run --only sweep,paper

`claims.toml` gives a source to each number in running text: an expression of a committed result, of
a constant of the code, or why it is none (`given:`). `--run` keeps what it made in `--out` and goes
on there after an interruption; remove a file to have it made again. What the new results give is
held against the page with the tolerance of `tolerance_of`.
"""

from __future__ import annotations

import argparse
import importlib
import inspect
import json
import math
import os
import re
import subprocess
import sys
import tomllib
from collections.abc import Callable, Iterable, Iterator
from functools import cache
from pathlib import Path
from typing import Any, NamedTuple

import provenance
from provenance import ROOT

PROGRAMS = {
    "accelerator": "accelerator.py",
    "bands": "blind/bands.py --first 900 --records 3 --report"
    " --hidden nothing creep output_lag drift resonance",
    "blind/results": "blind/run.py --report --out {out}/blind",
    "broken_sensor": "broken_sensor.py",
    "bundled": "bundled.py",
    "controller": "controller.py",
    "drive": "drive.py --folder {out}/drive",
    "export": "export.py",
    "files": "files.py",
    "inverse": "inverse.py",
    "layouts": "files.py --layouts",
    "measured": "measured/run.py {records}",
    "page": "page.py",
    "paper": "paper.py",
    "peers": "peers.py",
    "relays": "relays.py",
    "streaming": "streaming.py",
    "sweep": "sweep.py",
    "whole_process": "whole_process.py",
}
"""What makes each result: a program of this folder, with its arguments."""

NOT_TEXT = re.compile(
    r"^ *```.*?^ *```$|^:::[^\n]*|^ +(?:options|members|heading\w*):[^\n]*|^#+ [^\n]*|^ *\d+\. "
    r"|`[^`]*`|\]\([^)]*\)|<[^>]*>|\\\[.*?\\\]|\\\(.*?\\\)|\[\d\]"
    r"|(?:Fig|sec|version|Python|FMI|MATLAB)[.s]* \d[\d.]*",
    re.MULTILINE | re.DOTALL,
)
"""What holds no claims: code, links, formulas, headings, numbers of lists and of references."""

NUMBER = re.compile(r"(?<![\w.])(?:(?<![\w)])[-−])?\d(?:[\d,]*\d)?(?:\.\d+)?(?:e[-−]?\d+)?(?![\w])")
UNIT = re.compile(
    r"\s(?:%|s|ms|µs|ns|min|h|[nµum]?m|V|[kM]?Hz|[kMG]i?B|times|orders|of \d|samples|rows|levels"
    r"|blocks|records|stages|curves|points|columns|weights|cores|numbers|values|periods|stretches)(?!\w)"
)
NAME = re.compile(r"\b[a-z_]+\b")
TIME = re.compile(r"\b\w*_(?:s|ms|us)\b|ns_a_sample|seconds")


class Claim(NamedTuple):
    """One number of a page: where it stands, what is said, and what its source gives."""

    file: str
    line: int
    text: str
    stated: str
    source: str
    value: float | None
    """None where the source is a reason."""
    holds: bool


class MissingError(Exception):
    """A result that is not there."""


class Result(dict[str, Any]):
    """An object of a result, whose keys are attributes."""

    __getattr__ = dict.__getitem__


@cache
def result(name: str, folder: Path) -> Any:
    """The committed result of a name; `blind` is the summary of all blind records."""
    if name == "blind":
        from blind.rates import read_results, summary_of

        rows = read_results(folder / "blind")
        if not rows:
            raise MissingError(name)
        summary = summary_of(rows) | {"versions": len({row["commit"] for row in rows})}
        text = json.dumps(summary)
    else:
        path = folder / f"{name}.json"
        if not path.exists():
            raise MissingError(name)
        text = path.read_text(encoding="utf-8")
    return json.loads(text, object_hook=Result)


class Names(dict[str, Any]):
    """What a source may name: the results, and `code("module:NAME")` for a constant."""

    def __init__(self, folder: Path):
        super().__init__(
            vars(math), code=code, default=default, most=most,
            left_open=left_open, min=min, max=max, abs=abs,
        )  # fmt: skip
        self.folder = folder

    def __missing__(self, name: str) -> Any:
        return result(name, self.folder)


def code(place: str) -> Any:
    """A constant of the package, as `diagnosis.evidence:THRESHOLD`."""
    module, _, name = place.partition(":")
    value = importlib.import_module(f"preisach_jax.{module}")
    for part in name.split("."):
        value = getattr(value, part)
    return value


def default(place: str, argument: str) -> Any:
    """The default of an argument of a function of the package."""
    return inspect.signature(code(place)).parameters[argument].default


def most(controller: Result, task: str, of: Callable[[Iterable[int]], int]) -> int:
    """The least or the greatest of what each model takes at its worst on a controller."""
    return of(
        max(course["most"] for course in row["instructions"][task].values())
        for row in controller["rows"]
    )


def left_open(share: Result) -> float:
    """What a count leaves open, one-sided at 95 % (C. J. Clopper, E. S. Pearson, 1934)."""
    from scipy.stats import beta

    return float(beta.ppf(0.95, share["count"] + 1, share["of"] - share["count"]))


def pages() -> list[Path]:
    """README and all pages of the documentation that are written by hand."""
    return [ROOT / "README.md", *sorted((ROOT / "docs").rglob("*.md"))]


@cache
def sources() -> dict[str, dict[str, str]]:
    """The source of each phrase with numbers, by page; `*` stands for any."""
    with Path(__file__).with_suffix(".toml").open("rb") as file:
        return tomllib.load(file)


def phrases_of(page: str, text: str) -> Iterator[tuple[str, str, re.Match[str]]]:
    """Phrase, source and place of all that a page says with numbers.

    Raises:
        LookupError: a phrase of this page that it does not have.
    """
    for phrase, source in sources().get(page, {}).items():
        place = place_of(phrase, text)
        if place is None:
            raise LookupError(f"{page} does not say {phrase!r}, of which claims.toml has a source")
        yield phrase, source, place
    for phrase, source in sources()["*"].items():
        for place in re.finditer(pattern_of(phrase), text):
            yield phrase, source, place


def pattern_of(phrase: str) -> str:
    """What finds a phrase however the lines of a page are broken."""
    return r"\s+".join(map(re.escape, phrase.split()))


def blank(text: str) -> str:
    """The text with spaces for what holds no claims, every character in its place."""
    return NOT_TEXT.sub(lambda found: re.sub(r"\S", " ", found.group()), text)


def place_of(phrase: str, text: str) -> re.Match[str] | None:
    """Where a phrase stands in a page, however its lines are broken."""
    return re.search(pattern_of(phrase), text)


def is_claim(number: re.Match[str], text: str) -> bool:
    """Whether a number says how much: one with a unit, a share, a decimal or a large one."""
    written, after = number.group(), text[number.end() :]
    if re.fullmatch(r"(19|20)\d\d", written):  # a year
        return False
    large = len(written.replace(",", "").lstrip("-−")) > 2
    return large or "." in written or "e" in written or bool(UNIT.match(after))


def sourceless(page: Path) -> list[tuple[int, str]]:
    """Line and words of each claim of a page that no phrase of `claims.toml` covers."""
    text, found = page.read_text(encoding="utf-8"), []
    prose = blank(text)
    name = page.relative_to(ROOT).as_posix()
    spans = [place.span() for _, _, place in phrases_of(name, text)]
    for number in NUMBER.finditer(prose):
        inside = any(begin <= number.start() < end for begin, end in spans)
        if not inside and is_claim(number, prose):
            line = prose.count("\n", 0, number.start()) + 1
            found.append((line, " ".join(text[number.start() - 30 : number.end() + 20].split())))
    return found


def claims_of(folder: Path = provenance.RESULTS, *, fresh: bool = False) -> Iterator[Claim]:
    """All claims, held against the results of a folder: fresh ones with a tolerance.

    Raises:
        LookupError: a phrase that its page does not have, or another count of sources.
    """
    names = Names(folder)
    for page in pages():
        name, text = page.relative_to(ROOT).as_posix(), page.read_text(encoding="utf-8")
        for phrase, source, place in phrases_of(name, text):
            line = text.count("\n", 0, place.start()) + 1
            numbers = [each.group() for each in NUMBER.finditer(blank(phrase))]
            given = source.startswith("given:")
            parts = [source] * len(numbers) if given else [one.strip() for one in source.split(";")]
            if len(parts) != len(numbers):
                raise LookupError(f"{name}: {numbers} of {phrase!r} have {len(parts)} sources")
            for number, part in zip(numbers, parts, strict=True):
                try:
                    value = None if given else valued(part, names)
                except MissingError:
                    continue  # the documentation leaves the sentence out
                holds = value is None or agrees(
                    number, value, part[0], tolerance_of(part) if fresh else 0.0
                )
                yield Claim(name, line, phrase, number, part, value, holds)


def valued(source: str, names: Names) -> float:
    """What a source gives."""
    return float(eval(source.lstrip("<> "), {}, names))


def agrees(written: str, value: float, relation: str, tolerance: float) -> bool:
    """Whether a number as it is written is the value, rounded; or a bound of it (`<` or `>`).

    Whole values that are constants or counts must be met exactly, measured ones to the digits that
    are written; zeros that end a whole number are no digits.
    """
    plain, value = written.replace(",", "").replace("−", "-"), float(value)
    stated = float(plain)
    digits, _, power = plain.partition("e")
    if "." in digits:
        step = 10.0 ** -len(digits.partition(".")[2])
    else:
        step = 1.0 if value.is_integer() else 10.0 ** (len(digits) - len(digits.rstrip("0")))
    slack = 0.501 * step * 10.0 ** float(power or 0) + tolerance * abs(stated)
    if relation == "<":
        return value <= stated + tolerance * abs(stated)
    if relation == ">":
        return value >= stated - tolerance * abs(stated)
    return abs(value - stated) <= slack


def tolerance_of(source: str) -> float:
    """By what part a new result may differ from what is said; times are another machine's."""
    return 0.5 if TIME.search(source) else 0.05


def without_missing(page: str, text: str, folder: Path = provenance.RESULTS) -> str:
    """A page without the sentences (or rows) whose result is not there."""
    names = Names(folder)
    for phrase, source in sources().get(page, {}).items():
        if source.startswith("given:"):
            continue
        try:
            for part in source.split(";"):
                valued(part, names)
        except MissingError:
            place = place_of(phrase, text)
            if place:
                begin, end = _sentence(text, *place.span())
                text = text[:begin] + text[end:]
    return text


def _sentence(text: str, begin: int, end: int) -> tuple[int, int]:
    """The span of the sentence, or the row of a table, around a span."""
    row = text.rfind("\n", 0, begin) + 1
    if text[row:begin].lstrip().startswith("|"):
        return row, text.find("\n", end) + 1
    ends = [each.end() for each in re.finditer(r"[.:]\)?\s+(?=[A-Z*(])|\n\n|\n(?=\s*[-*] )", text)]
    return (
        max([each for each in ends if each <= begin], default=0),
        min([each for each in ends if each >= end], default=len(text)),
    )


def run(only: list[str], out: Path, records: Path) -> None:
    """Make the results that are not in `out` yet, each by its program in a process of its own."""
    out.mkdir(parents=True, exist_ok=True)
    environment = os.environ | {"PREISACH_RESULTS": str(out.resolve())}
    for name in only or PROGRAMS:
        if (out / f"{name}.json").exists():
            print(f"{name}: there already")
            continue
        words = PROGRAMS[name].format(out=out, records=records).split()
        command = [sys.executable, str(Path(__file__).with_name(words[0])), *words[1:]]
        print(f"{name}: {PROGRAMS[name]}", flush=True)
        if subprocess.run(command, env=environment, cwd=ROOT, check=False).returncode:
            print(f"{name}: the program failed; its claims are not compared")


def shown(claims: list[Claim], folder: Path) -> str:
    """The table of claims: file, line, stated, source, value, commit."""
    commits = {
        path.stem: ",".join(sorted(each[:7] for each in provenance.commits_of(path)))
        for path in folder.glob("*.json")
    }
    lines = []
    for claim in claims:
        names = NAME.findall(claim.source)
        at = next((commits[name] for name in names if name in commits), "")
        at = "blind" if "blind" in names else at
        value = "" if claim.value is None else f"{claim.value:.6g}"
        verdict = "" if claim.holds else "  DOES NOT HOLD"
        lines.append(
            f"{claim.file}:{claim.line}\t{claim.stated}\t{value}\t{claim.source}\t{at}{verdict}"
        )
    return "\n".join(lines)


def main() -> None:
    """Print the table, after making results anew where that is asked for."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("--run", action="store_true", help="make the results anew first")
    parser.add_argument("--only", default="", help=f"of {','.join(PROGRAMS)}")
    parser.add_argument("--out", type=Path, default=ROOT / "build" / "claims")
    parser.add_argument("--records", type=Path, default=ROOT / "shared" / "data")
    asked = parser.parse_args()
    only = [name for name in asked.only.split(",") if name]
    if unknown := set(only) - set(PROGRAMS):
        sys.exit(
            f"no program makes {', '.join(sorted(unknown))}: choose from {', '.join(PROGRAMS)}"
        )
    folder, fresh = provenance.RESULTS, asked.run
    if fresh:
        folder = asked.out
        run(only, folder, asked.records)
    claims = list(claims_of(folder, fresh=fresh))
    if fresh:  # what was made, not what it is made of
        made = {path.stem for path in folder.glob("*.json")}
        if (folder / "blind").exists():
            made.add("blind")
        claims = [claim for claim in claims if made & set(NAME.findall(claim.source))]
    print(shown(claims, folder))
    bad = [claim for claim in claims if not claim.holds]
    nowhere = [(page, *each) for page in pages() for each in sourceless(page)]
    for page, line, words in nowhere:
        print(f"{page.relative_to(ROOT)}:{line}\tNO SOURCE\t{words}")
    print(f"{len(claims)} claims; {len(bad)} do not hold, {len(nowhere)} have no source")
    for claim in bad:
        print(f"{claim.file}:{claim.line} says {claim.stated}; {claim.source} is {claim.value:.6g}"
              f" (tolerance {100 * tolerance_of(claim.source) * fresh:.0f} %)")  # fmt: skip
    for name, commits in (provenance.outdated() or {}).items():
        print(f"{name} is of another version ({', '.join(each[:7] for each in commits)})")
    sys.exit(bool(bad or nowhere))


if __name__ == "__main__":
    main()
