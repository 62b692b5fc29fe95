"""The cases of the benchmark: what is hidden, how strongly, under which excitation, which seed.

A case's seed follows from what the case is, so that filters and longer lists leave it as it was.
Development seeds are for those who change the library, reporting seeds for figures that are told.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from zlib import crc32

import numpy as np

from blind.excitation import KINDS
from blind.hidden import MACHINES
from blind.world import EFFECTS, NOTHING, OUTSIDE

SIZES = (0.1, 0.25, 0.5, 1.0, 2.0, 4.0)
OUTSIDE_SIZES = (0.5, 1.0, 2.0)
REPEATS = {"single": 10, "pairs": 60, "triples": 30, "beside": 5, "none": 200, "outside": 10}
"""Cases for each excitation; in `single` and `outside` for each effect and size as well, and in
`beside` for each effect of machines and each of `PARTNERS`."""

PARTNERS = ("creep", "drift", "input_lag")

SEEDS = {"development": (0, 1000), "reporting": (12_000_000_000, 1_000_000_000)}
"""First seed, and how many; those from 1e6 to 12e9 were drawn for samples of November 2026."""

ALONE = ("input_quantisation", "output_quantisation", "accommodation", *MACHINES)
"""Effects that no pair or triple is drawn of: those of converters vanish beside others, and the
others are drawn as they were before the world knew accommodation and machines."""

COMBINED = tuple(name for name in EFFECTS if name not in ALONE)
"""Effects that are hidden together."""


@dataclass(frozen=True)
class Case:
    """One record to diagnose.

    Attributes:
        id: says all that tells it from the other cases.
        suite: a key of `REPEATS`.
        effects: sizes of the hidden effects by name.
        excitation: one of `KINDS`.
        seed: of the record.
        repeat: number among the cases that differ by the seed alone.
        nothing: circumstance that may be mistaken for an effect.
        seconds, rate_hz: length and sampling rate of the record.
    """

    id: str
    suite: str
    effects: Mapping[str, float]
    excitation: str
    seed: int
    repeat: int
    nothing: str = "plain"
    seconds: float = 20.0
    rate_hz: float = 1350.0


@dataclass(frozen=True)
class Choice:
    """Which cases to run; empty sequences stand for all.

    Attributes:
        suites, excitations: names.
        effects: names; only cases that hide at least one of them.
        sizes: of the hidden effects; 1 is nominal.
        seeds: a key of `SEEDS`.
        limit: at most so many cases, spread evenly over those chosen; None for all.
    """

    suites: Sequence[str] = ()
    effects: Sequence[str] = ()
    excitations: Sequence[str] = ()
    sizes: Sequence[float] = ()
    seeds: str = "development"
    limit: int | None = None

    def __post_init__(self):
        for asked, known in (
            (self.suites, REPEATS),
            (self.effects, (*EFFECTS, *OUTSIDE)),
            (self.excitations, KINDS),
            (self.sizes, SIZES),
            ((self.seeds,), SEEDS),
        ):
            if unknown := [name for name in asked if name not in known]:
                raise ValueError(f"unknown: {_listed(unknown)}; choose from {_listed(known)}")

    def holds(self, case: Case) -> bool:
        """Whether a case was asked for."""
        return (
            (not self.suites or case.suite in self.suites)
            and (not self.excitations or case.excitation in self.excitations)
            and (not self.effects or not set(self.effects).isdisjoint(case.effects))
            and (not self.sizes or set(case.effects.values()) <= set(self.sizes))
        )


def make_cases(choice: Choice) -> list[Case]:
    """The chosen cases, in an order in which any first part is an even sample of the whole."""
    cases = filter(choice.holds, _all_cases(choice.seeds))
    order = sorted(cases, key=lambda case: (case.repeat / REPEATS[case.suite], _number(case.id)))
    return order[: choice.limit]


def _all_cases(seeds: str) -> Iterator[Case]:
    first, count = SEEDS[seeds]
    for suite, repeats in REPEATS.items():
        for repeat in range(repeats):
            for effects, nothing in _contents(suite, repeat):
                for excitation in KINDS:
                    hidden = "+".join(f"{name}*{size:g}" for name, size in effects.items())
                    cell = f"{suite}/{hidden or nothing}/{excitation}"
                    seed = first + (_number(cell) + repeat) % count
                    yield Case(
                        f"{cell}/{repeat}/{seed}", suite, effects, excitation, seed, repeat, nothing
                    )


def _contents(suite: str, repeat: int) -> Iterator[tuple[dict[str, float], str]]:
    """What is hidden, and under which circumstance, in the cases of one repeat of a suite."""
    rng = np.random.default_rng([_number(suite), repeat])
    if suite == "none":
        yield {}, str(rng.choice(NOTHING))
    elif suite in ("pairs", "triples"):
        names = rng.choice(COMBINED, 2 if suite == "pairs" else 3, replace=False)
        yield {str(name): 1.0 for name in names}, "plain"
    elif suite == "beside":
        for name in MACHINES:
            for partner in PARTNERS:
                yield {name: 1.0, partner: 1.0}, "plain"
    else:
        inside = suite == "single"
        for name in EFFECTS if inside else OUTSIDE:
            for size in SIZES if inside else OUTSIDE_SIZES:
                yield {name: size}, "plain"


def _listed(things: Iterable[object]) -> str:
    return ", ".join(map(str, things))


def _number(text: str) -> int:
    return crc32(text.encode())
