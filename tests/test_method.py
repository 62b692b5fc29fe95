"""A record is walked through the formulas of the method page, beside what the diagnosis says.

Everything here is NumPy and SciPy: hysterons one by one, folds, regularised least squares, score,
noise and verdict. From the package come the order of the cells and the matrix of the prior, which
test_regression has.
"""

import json

import numpy as np
import pytest
from oracles import slow_ramps
from scipy.optimize import lsq_linear

import preisach_jax as pj
from preisach_jax.effects.base import AddedEffect
from preisach_jax.effects.parameter import coefficient
from preisach_jax.identify.regression import smoothness

LEVELS, COUNT, FOLDS, BLOCKS, STRETCHES = 9, 3000, 4, 96, 24


class Slope(AddedEffect):
    """A straight drift."""

    name = "slope"
    physics = "The zero of the sensor moves."

    def coefficients(self):
        return (coefficient("per_record", "{z}", "change over the record"),)

    def columns(self, signals):
        return signals.time[:, None] / 30


def made(drift):
    t = np.arange(COUNT) / 100
    u = 5 - 5 * np.cos(t * (1 + t / 40))
    z = u**1.1 + drift * t / 30 + 0.01 * np.random.default_rng(0).normal(size=COUNT)
    return t, u, z


def hysterons(x):
    """(row, cell) ramps from the lower end on, over the range of the input."""
    return slow_ramps(pj.Plane(LEVELS, x.min(), x.max()), x)


def folds():
    """(row,) fold: blocks are held out after 3, 3, 3, 5, 5 and 5, the others take turns."""
    held = np.cumsum(np.resize([3, 3, 3, 5, 5, 5], BLOCKS)) - 1
    held = held[held < BLOCKS]
    block = np.full(BLOCKS, -1)
    block[held] = 3
    if block[-1] == 3:
        block[-2:] = block[-2:][::-1]
    rest = np.flatnonzero(block < 0)
    count = np.arange(len(rest))
    block[rest] = (count + count // 7) % 3
    return block[np.arange(COUNT) * BLOCKS // COUNT]


def solved(columns, y, penalty):
    """Coefficients of the regularised least squares; all but the last `penalty` has are weights."""
    gram = columns.T @ columns + len(y) * penalty
    root = np.linalg.cholesky(gram + 1e-10 * gram.max() * np.eye(len(gram))).T
    weights = LEVELS * (LEVELS + 1) // 2
    least = np.where(np.arange(len(gram)) < weights, 0.0, -np.inf)
    target = np.linalg.solve(root.T, columns.T @ y)
    return lsq_linear(root, target, (least, np.inf), method="bvls", max_iter=1000, tol=1e-14).x


def left_by(columns, y, fold, strength, among):
    """(row,) error of each fold among some as the others of them predict it."""
    penalty = np.zeros((columns.shape[1],) * 2)
    penalty[:45, :45] = strength * smoothness(LEVELS)
    error = np.full(len(y), np.nan)
    for k in among:
        others, own = np.isin(fold, [each for each in among if each != k]), fold == k
        error[own] = y[own] - columns[own] @ solved(columns[others], y[others], penalty)
    return error


def strength_of(columns, y, fold, start):
    """Downhill by decades from a start, the stronger side first, among the folds that identify."""
    known = {}

    def error(power):
        if power not in known:
            left = left_by(columns, y, fold, 10.0**power, (0, 1, 2))
            known[power] = np.mean([np.log(np.mean(left[fold == k] ** 2)) for k in range(3)])
        return known[power]

    best = start
    for way in (1, -1):
        while -8 <= best + way <= 0 and error(best + way) < error(best) + np.log(0.999):
            best += way
        if best != start:
            break
    return best


def score(simple, rich):
    """The page's s."""
    m, richer = (
        np.array([np.mean(part**2) for part in np.array_split(error, STRETCHES)])
        for error in (simple, rich)
    )
    r = 0.5 * np.log(m / richer)
    return r.mean() / np.sqrt(r.var(ddof=1) / STRETCHES + 0.03**2)


def second_differences(error):
    """Standard deviation of white noise, from the median of its second differences."""
    change = np.diff(error, 2)
    return np.median(np.abs(change - np.median(change))) / 0.6745 / np.sqrt(6)


@pytest.mark.parametrize("drift", [0.3, 0.0])
def test_a_decision_is_repeated_by_hand(drift):
    t, u, z = made(drift)
    record = pj.Record.from_arrays(t, u, z, initial_memory="low")
    found = pj.diagnose(record, [Slope()], levels=LEVELS)
    content = json.loads(json.dumps(found.to_json()))

    fold, y = folds(), (z - z.mean()) / np.ptp(z)
    simple = np.column_stack([hysterons(u), np.ones(COUNT)])
    rich = np.column_stack([simple, t / 30])
    first = strength_of(simple, y, fold, -4)
    second = strength_of(rich, y, fold, first)
    errors = [
        left_by(columns, y, fold, 10.0**power, range(FOLDS))
        for columns, power in ((simple, first), (rich, second))
    ]
    held_out = [np.sqrt(np.mean(error[fold == 3] ** 2)) * np.ptp(z) for error in errors]
    s, fall = score(*errors), 1 - (held_out[1] / held_out[0]) ** 2

    (tried,) = [row for row in content["candidates"] if row["effect"] == "slope"]
    assert tried["evidence"]["score"] == pytest.approx(s, rel=0.02, abs=0.1)
    assert tried["gain"] == pytest.approx(fall, rel=0.01, abs=0.01)
    named = bool(s >= 3 and fall > 0)
    assert named == (drift > 0)
    assert content["effects"] == ["slope"] * named
    rungs = [row["rms_validation"] for row in content["ladder"]]
    np.testing.assert_allclose(rungs, held_out[: 1 + named], rtol=0.02)

    shares = content["budget"]
    noise, grid, memory, rest = (
        shares[name] for name in ("noise", "discretisation", "memory", "unexplained")
    )
    last = errors[named][np.isfinite(errors[named])] * np.ptp(z)
    assert noise == pytest.approx(second_differences(last), rel=0.05)
    assert noise**2 + grid**2 + memory**2 + rest**2 == pytest.approx(rungs[-1] ** 2, rel=1e-6)
    met = rest**2 <= noise**2 + grid**2 + min(memory, noise) ** 2
    assert content["verdict"] == {
        (True, True): "explained", (True, False): "partly_explained",
        (False, True): "adequate", (False, False): "unexplained",
    }[named, bool(met)]  # fmt: skip
