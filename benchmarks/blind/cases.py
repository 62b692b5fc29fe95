"""The records of the blind benchmark: what is hidden, how strongly, and under which drive.

All of it (combinations, sizes, circumstances, seeds) follows from the name of the draw. Development
draws are numbered; the draw that is reported bears the name of the commit that it judges, so that
nobody can have seen one of its records before the code was frozen.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from zlib import crc32

import numpy as np

from blind.excitation import KINDS
from blind.world import EFFECTS, NOTHING, ON_REQUEST, OUTSIDE

COUNTS = {"single": 12, "pairs": 60, "triples": 40, "none": 200, "outside": 8}
"""Records of each suite; of `single` and `outside` for each effect. Drives take turns."""

SPREAD = {"single": 0.6, "pairs": 0.3, "triples": 0.3, "outside": 0.3}
"""Sizes reach from 10 to the minus this to 10 to this, evenly in their logarithm."""

ALONE = ("input_quantisation", "output_quantisation", *ON_REQUEST)
"""Effects of no pair or triple: converters vanish beside others, and what is tried on request only
takes minutes each."""

CLASHES = ({"aux", "gain"}, {"resonance", "modes"})
"""Effects that would share a column or a name."""


@dataclass(frozen=True)
class Case:
    """One record to diagnose.

    Attributes:
        id: says all that tells it from the other records of its draw.
        suite: a key of `COUNTS`.
        effects: sizes of the hidden effects by name; 1 is nominal.
        excitation: one of `KINDS`.
        seed: of the record.
        place: where it stands in its suite, 0 to 1.
        nothing: circumstance that may be mistaken for an effect.
        asked: whether effects that are tried on request only are asked for.
        ends: whether it has ended the process before, and is not diagnosed again.
        seconds, rate_hz: length and sampling rate of the record.
    """

    id: str
    suite: str
    effects: Mapping[str, float]
    excitation: str
    seed: int
    place: float
    nothing: str = "plain"
    asked: bool = False
    ends: bool = False
    seconds: float = 20.0
    rate_hz: float = 1350.0


def make_cases(
    draw: str,
    suites: Sequence[str] = (),
    effects: Sequence[str] = (),
    excitations: Sequence[str] = (),
    limit: int | None = None,
) -> list[Case]:
    """The records of a draw, of which any first part is an even sample of the whole.

    Arguments:
        suites, effects, excitations: only such; an effect: records that hide it.
        limit: at most so many.
    """
    for asked, known in ((suites, COUNTS), (effects, (*EFFECTS, *OUTSIDE)), (excitations, KINDS)):
        if unknown := sorted(set(asked) - set(known)):
            raise ValueError(f"unknown: {', '.join(unknown)}; choose from {', '.join(known)}")
    chosen = [
        case
        for case in _all_cases(draw)
        if (not suites or case.suite in suites)
        and (not effects or not set(effects).isdisjoint(case.effects))
        and (not excitations or case.excitation in excitations)
    ]
    return sorted(chosen, key=lambda case: (case.place, crc32(case.id.encode())))[:limit]


def _all_cases(draw: str) -> Iterator[Case]:
    for suite, count in COUNTS.items():
        each = {"single": EFFECTS, "outside": OUTSIDE}.get(suite, ("",))
        for turn, name in enumerate(each):
            for k in range(count):
                text = f"{draw}/{suite}/{name}/{k}"
                rng = np.random.default_rng(list(text.encode()))
                effects = _effects(suite, name, rng)
                hidden = "+".join(f"{effect}*{size:.2f}" for effect, size in effects.items())
                nothing = "plain" if effects else NOTHING[k // len(KINDS) % len(NOTHING)]
                excitation, seed = KINDS[(k + turn) % len(KINDS)], int(rng.integers(2**40))
                yield Case(
                    id=f"{suite}/{hidden or nothing}/{excitation}/{seed}",
                    suite=suite,
                    effects=effects,
                    excitation=excitation,
                    seed=seed,
                    place=(k + 0.5) / count,
                    nothing=nothing,
                    asked=not ON_REQUEST.isdisjoint(effects) or (not effects and k % 5 == 4),
                )


def _effects(suite: str, name: str, rng: np.random.Generator) -> dict[str, float]:
    """What is hidden, with its sizes."""
    if suite == "none":
        return {}
    names = [name]
    while not name and (len(names) < 2 or any(clash <= set(names) for clash in CLASHES)):
        together = [effect for effect in EFFECTS if effect not in ALONE]
        names = list(map(str, rng.choice(together, 2 if suite == "pairs" else 3, replace=False)))
    reach = SPREAD[suite]
    return {effect: float(10 ** rng.uniform(-reach, reach)) for effect in names}
