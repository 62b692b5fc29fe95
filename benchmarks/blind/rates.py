"""The results of the benchmark, one JSON line a finished case, and the rates that they give."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from provenance import rows_of
from scipy import stats
from scipy.optimize import minimize

Result = dict[str, Any]

FILE = "results.jsonl"
EXCITATIONS = ("all", "rich", "fair", "periodic", "poor")
RIVALS = ("forward", "effective", "held_out", "correlation", "sparse")
"""Simpler ways to name an effect, which `rivals` explains."""

SEVERAL = ("pairs", "triples", "beside")
COMBINATIONS = ("single", *SEVERAL)
WAYS = ("diagnose", *RIVALS)

ACTING = ("load_N", "y_V")
"""Columns of the world that act."""

CLEAR = 1.0
"""Least size of the cases of the confusion matrix and of the rivals' hits: nominal."""

VISIBLE = 0.95
"""Share of the plain model's held-out mean square that the model with the true effects must not
leave for the effects to be visible in a record at all."""

ROUNDING = 1e-9
"""Relative difference of two steps that is the computer's rounding."""

PRESENT_SINCE = "2026-11-27T06:03"
"""When intervals were last made longer, by what records that were finished before had shown."""

SIZES = (0.1, 0.25, 0.5, 1.0, 2.0, 4.0)
"""Sizes about which cases are counted together."""

CRASHED: Result = {
    "verdict": "crashed", "effects": [], "families": [], "parameters": {}, "limits": [],
    "rivals": {}, "held_out": None,
}  # fmt: skip
"""What a case that ended in an error says: nothing, which is right nowhere."""

STEEPEST = 12.0
"""Greatest slope of a detection curve per natural logarithm of size, where the data set none."""


class Estimate(NamedTuple):
    """A parameter of a hidden effect that was named: the truth, and what was said of it."""

    parameter: str
    true: float
    value: float
    low: float
    high: float
    present: bool
    """Whether the interval is as long as they are made now."""


def read_results(folder: Path) -> list[Result]:
    """The finished cases in their order; a line that was torn by a sudden end is left out."""
    path = folder / FILE
    rows = rows_of(path) if path.exists() else ()
    return [CRASHED | row if row["error"] else row for row in rows]


def rate(hits: Iterable[bool]) -> dict[str, float]:
    """Share of hits with its 95 % interval (C. J. Clopper, E. S. Pearson, Biometrika 26 (1934))."""
    hits = list(hits)
    count, of = sum(hits), len(hits)
    if not of:
        return {"count": 0, "of": 0, "rate": np.nan, "low": 0.0, "high": 1.0}
    low = stats.beta.ppf(0.025, count, of - count + 1) if count else 0.0
    high = stats.beta.ppf(0.975, count + 1, of - count) if count < of else 1.0
    return {"count": count, "of": of, "rate": count / of, "low": float(low), "high": float(high)}


def detection_sizes(size: Sequence[float], found: Sequence[bool]) -> dict[str, float]:
    """Sizes at which an effect is found in 50 and in 90 of 100 cases.

    A logistic curve in the logarithm of size, of the greatest likelihood, no steeper than
    `STEEPEST` (where all small ones are missed and all large ones found, the data ask for a step).
    """
    x, y = np.log(np.asarray(size, float)), np.asarray(found, bool)
    if y.all() or not y.any():
        end = 0.0 if y.all() else np.inf
        return {"size_50": end, "size_90": end}

    def loss(line: np.ndarray) -> float:
        steepness, middle = line
        return float(np.sum(np.logaddexp(0.0, np.where(y, -1, 1) * steepness * (x - middle))))

    start = (3.0, float(np.mean(x)))
    bounds = [(0.01, STEEPEST), (x.min() - 5, x.max() + 5)]
    steepness, middle = minimize(loss, start, method="L-BFGS-B", bounds=bounds).x
    size_50, size_90 = np.exp(middle), np.exp(middle + np.log(9) / steepness)
    return {"size_50": float(size_50), "size_90": float(size_90)}


def summary_of(results: Sequence[Result]) -> dict[str, Any]:
    """Everything that is told of some results, as JSON can hold it; `tables` shows it.

    What crashed counts in every share of right ones.
    """
    inside = [one for one in results if one["hidden"] and one["in_library"] == one["hidden"]]
    outside = [one for one in results if one["hidden"] and one["in_library"] != one["hidden"]]
    nothing = [one for one in results if not one["hidden"]]
    judged = [one for one in results if not one["error"]]
    single = [one for one in inside if one["suite"] == "single"]
    limited = [one for one in single if size_at_limit(one) is not None]
    estimates = estimates_of(inside)
    suites = {suite: [one for one in inside if one["suite"] == suite] for suite in COMBINATIONS}
    return {
        "cases": len(results),
        "failed": len(results) - len(judged),
        "confusion": confusion(results),
        **_by_suite(suites),
        "several": rate(is_exact(one) for one in inside if one["suite"] in SEVERAL),
        "false_alarms": {
            way: rate(bool(named(one, way)) for one in nothing if was_asked(one, way))
            for way in WAYS
        },
        "false_alarms_by_circumstance": _by(
            nothing, circumstance, lambda rows: rate(bool(one["effects"]) for one in rows)
        ),
        "adequate": rate(map(is_adequate, nothing)),
        "adequate_by_circumstance": _by(
            nothing, circumstance, lambda rows: rate(map(is_adequate, rows))
        ),
        "first_name_right": {
            way: rate(
                named(one, way) == one["hidden"][0]
                for one in single
                if is_clear(one) and was_asked(one, way)
            )
            for way in WAYS
        },
        "found": _found(inside),
        "outside_adequate": rate(map(is_adequate, outside)),
        "outside": _by(outside, lambda one: one["hidden"][0], _of_a_kind),
        "wrong_name_outside": rate(map(has_wrong_name, outside)),
        "not_even_kin_outside": rate(
            not {*one["effects"]} <= {*one["hidden"], *one.get("kin", ())} for one in outside
        ),
        "admitted_outside": rate(
            one["verdict"] in ("unexplained", "partly_explained") for one in outside
        ),
        "detection": _by(single, drawn, _detection),
        "limits": _by(limited, drawn, lambda rows: rate(map(limit_holds, rows))),
        "limits_hold": rate(map(limit_holds, limited)),
        "parameters": _by_parameter(estimates),
        "coverage": rate(covers(each) for each in estimates if each.present),
        "over_oracle": _quantiles(
            [
                one["held_out"]["final"] / one["held_out"]["oracle"]
                for one in inside
                if not one["error"]
            ],
            {"q25": 0.25, "median": 0.5, "q75": 0.75, "p95": 0.95},
        ),
        "seconds": _quantiles([one["seconds"] for one in judged], {"median": 0.5, "p90": 0.9}),
    }


def _by_suite(suites: Mapping[str, Sequence[Result]]) -> dict[str, dict[str, Any]]:
    """How many of each suite are right, by what counts as right, and how many got a wrong name."""
    visible = {suite: list(filter(is_visible, rows)) for suite, rows in suites.items()}
    asked = {
        "exact": (is_exact, suites),
        "in_family": (is_in_family, suites),
        "exact_where_visible": (is_exact, visible),
        "in_family_where_visible": (is_in_family, visible),
        "seen_and_named": (is_named_as_far_as_seen, suites),
        "wrong_name": (has_wrong_name, suites),
    }
    return {
        key: {suite: rate(map(test, rows)) for suite, rows in some.items()}
        for key, (test, some) in asked.items()
    }


def has_wrong_name(result: Result) -> bool:
    """Whether something was named that is not hidden."""
    return not set(result["effects"]) <= set(result["hidden"])


def named(result: Result, way: str) -> str | None:
    """The effect that the diagnosis, or a rival, names first; None where it names nothing."""
    if way == "diagnose":
        return next(iter(result["effects"]), None)
    return result["rivals"].get(way)


def was_asked(result: Result, way: str) -> bool:
    """Whether a way was there when the record was judged."""
    return way == "diagnose" or way in result["rivals"]


def is_clear(result: Result) -> bool:
    """Whether a single hidden effect has its nominal size or more."""
    return result["size"] >= CLEAR


def is_adequate(result: Result) -> bool:
    """Whether nothing was said to be missing."""
    return result["verdict"] == "adequate"


def circumstance(result: Result) -> str:
    """What may be mistaken for an effect where nothing is hidden."""
    return result["circumstances"]["nothing"]


def is_visible(result: Result) -> bool:
    """Whether the true effects, fitted, lower the held-out error of the plain model."""
    held_out = result["held_out"]
    return held_out is None or held_out["oracle"] ** 2 < VISIBLE * held_out["base"] ** 2


def is_exact(result: Result) -> bool:
    """Whether all that is hidden was named, and nothing else."""
    return set(result["effects"]) == set(result["hidden"])


def is_named_as_far_as_seen(result: Result) -> bool:
    """Whether nothing else was named than what is hidden, and all of that which can be seen.

    An effect that was not named cannot be seen beside the others where the library's own model with
    all that is hidden leaves no less of the rows held out than the diagnosis does without it.
    """
    held_out = result["held_out"]
    some = set(result["effects"]) < set(result["hidden"])
    hardly_less = (
        held_out is not None and held_out["oracle"] ** 2 >= VISIBLE * held_out["final"] ** 2
    )
    return is_exact(result) or (some and hardly_less)


def is_in_family(result: Result) -> bool:
    """Whether each hidden effect is in some family, and each family holds a hidden effect."""
    families = [set(family) for family in result["families"]]
    hidden = set(result["hidden"])
    return hidden <= set().union(*families) and all(hidden & family for family in families)


def short(name: str) -> str:
    """The name of a row or column: without the column if that acts, else marked as a decoy."""
    kind, colon, column = name.partition(":")
    return f"{kind} (decoy)" if colon and column not in ACTING else kind


def drawn(result: Result) -> str:
    """What a single case hides, by the name of what was drawn (two modes are a resonance)."""
    return result["drawn"][0]


def printed_limit(result: Result) -> Result | None:
    """The limit that was printed for the hidden effect of a case; None where there was none."""
    name = result["hidden"][0]
    return next((row for row in result["limits"] if row["effect"] == name), None)


def size_at_limit(result: Result) -> float | None:
    """Size that a hidden effect that was not named has at the limit that was printed for it.

    None where it was named, or where the record was said to tell nothing of it.
    """
    if result["hidden"][0] in result["effects"] or not result["change"]:
        return None
    limit = printed_limit(result)
    if limit is None or limit["rms"] is None:
        return None
    return result["size"] * limit["rms"] / (result["change"] * result["stroke_um"])


def limit_holds(result: Result) -> bool:
    """Whether the limit that was printed for a hidden effect is no less than the effect.

    The step of a converter is compared as a step, all else by the RMS of what it changes: two laws
    may count their amounts in different ways.
    """
    limit, truth = printed_limit(result), result["truth"][result["hidden"][0]]
    if limit is not None and limit.get("quantity") == "step" and "step" in truth:
        return bool(limit["value"] >= truth["step"] * (1 - ROUNDING))
    size = size_at_limit(result)
    return size is not None and size >= result["size"]


def confusion(results: Sequence[Result]) -> dict[str, dict[str, int]]:
    """How often each name was given first, by what is hidden.

    Single effects count from their nominal size on.  Where nothing is named, the verdict stands.
    """
    rows: dict[str, Counter[str]] = {}
    for one in results:
        if one["suite"] in SEVERAL or (one["suite"] == "single" and not is_clear(one)):
            continue
        hidden = "nothing" if not one["hidden"] else short(one["hidden"][0])
        if one["hidden"] != one["in_library"]:
            hidden += " (not in library)"
        said = named(one, "diagnose")
        rows.setdefault(hidden, Counter())[short(said) if said else one["verdict"]] += 1
    return {hidden: dict(counts) for hidden, counts in sorted(rows.items())}


def estimates_of(results: Sequence[Result]) -> list[Estimate]:
    """All parameters of hidden effects that were named, alone or beside others."""
    found: list[Estimate] = []
    for one in results:
        present = one["finished"] >= PRESENT_SINCE
        for effect, truth in one["truth"].items():
            said = one["parameters"].get(effect, {})
            for name in sorted(set(truth) & set(said)):
                true, row = truth[name], said[name]
                if true and np.isfinite(true):
                    bounds = row["value"], row["low"], row["high"]
                    found.append(Estimate(f"{short(effect)}.{name}", true, *bounds, present))
    return found


def covers(estimate: Estimate) -> bool:
    """Whether the stated interval has the truth."""
    return estimate.low <= estimate.true <= estimate.high


def _by_parameter(estimates: Sequence[Estimate]) -> dict[str, dict[str, Any]]:
    """Errors of each parameter, and coverage of those whose intervals are the present ones."""

    def of(rows: Sequence[Estimate]) -> dict[str, Any]:
        errors = [abs(each.value - each.true) / abs(each.true) for each in rows]
        held = rate(covers(each) for each in rows if each.present)
        return {"median_relative_error": float(np.median(errors)), "coverage": held}

    return _by(estimates, lambda each: each.parameter, of)


def _found(results: Sequence[Result]) -> dict[str, dict[str, float]]:
    """How often each hidden effect was named, alone or beside others."""
    hits: dict[str, list[bool]] = {}
    for one in results:
        for name in one["hidden"]:
            hits.setdefault(short(name), []).append(name in one["effects"])
    return {name: rate(hits[name]) for name in sorted(hits)}


def _of_a_kind(rows: Sequence[Result]) -> dict[str, Any]:
    """What was said of one kind of physics outside, and the most that an *adequate* leaves."""
    left = [one["held_out"]["final"] / one["noise_um"] for one in rows if is_adequate(one)]
    return {
        "adequate": rate(map(is_adequate, rows)),
        "named": rate(map(has_wrong_name, rows)),
        "most_left": max(left, default=None),
    }


def _detection(rows: Sequence[Result]) -> dict[str, Any]:
    size = [one["size"] for one in rows]
    class_of = [min(SIZES, key=lambda level: abs(np.log(level / each))) for each in size]
    found = [one["hidden"][0] in one["effects"] for one in rows]
    by_size = {
        f"{level:g}": rate(hit for s, hit in zip(class_of, found, strict=True) if s == level)
        for level in sorted(set(class_of))
    }
    limits = [limit for one in rows if (limit := size_at_limit(one)) is not None]
    limit = {"limit": float(np.median(limits)) if limits else np.nan}
    return detection_sizes(size, found) | limit | {"by_size": by_size}


def _by(results, key, value) -> dict[str, Any]:
    groups: dict[str, list[Any]] = {}
    for one in results:
        groups.setdefault(key(one), []).append(one)
    return {name: value(groups[name]) for name in sorted(groups)}


def _quantiles(values: Sequence[float], wanted: dict[str, float]) -> dict[str, float]:
    found = {
        name: float(np.quantile(values, p)) if values else np.nan for name, p in wanted.items()
    }
    return {"cases": len(values)} | found


def content_of(results: Sequence[Result]) -> dict[str, Any]:
    """`summary_of` all results, and those of each excitation that there are."""
    parts = {"all": list(results)} | {
        kind: [one for one in results if one["excitation"] == kind] for kind in EXCITATIONS[1:]
    }
    return {kind: summary_of(rows) for kind, rows in parts.items() if rows}
