r"""The terms of a library beside a model: freed from what it takes up, and pursued in a remainder.

The terms are freed from what the model can take up, as the remainder is by its fit: with the
regressors A of the model and the matrix G of its penalised normal equations, a term leaves

\[ \varphi - A\,G^{-1} A_i^\top \varphi_i, \]

where i are the rows that identify (M. C. Lovell, J. Am. Stat. Assoc. 58 (1963) 993-1010).
Orthogonal least squares (S. Chen, S. A. Billings, W. Luo, Int. J. Control 50 (1989) 1873-1896)
then takes the term that explains most of the remainder on these rows, one after the other.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from preisach_jax.diagnosis.terms import Library, Listed
from preisach_jax.effects.base import SensorEffect
from preisach_jax.identify import VALIDATION, Point, Problem, with_strength
from preisach_jax.identify.regression import slices_of
from preisach_jax.identify.signature import Projection

MOST_TERMS = 4

SHIFTED_PARTS = 12
"""Parts of the record that are shifted each by a lag of its own."""

AS_GOOD = 1.02
"""Times the least power that a simpler term may leave to be taken, or less than which another must
leave to take the place of one."""

ROUNDING = 1e-12

LEAST_LEFT = 1e-4
"""Share of the power of a term that the model and the terms taken must leave of it."""


@dataclass(frozen=True, eq=False)
class FreedTerms:
    """The terms on the measured rows, freed from what a model can take up.

    Attributes:
        listed: the terms.
        projection: that of the model.
        whole: (row, term) values.
        left: (row, term) what the model leaves of them, of unit size on the rows that identify.
        size: (term,) by which they were divided.
        remainder: (row,) what the model leaves of the output, with weights of any sign.
        gram: (term, term) products on the rows that identify.
    """

    listed: Sequence[Listed]
    projection: Projection
    whole: np.ndarray
    left: np.ndarray
    size: np.ndarray
    remainder: np.ndarray
    gram: np.ndarray

    @staticmethod
    def of(problem: Problem, point: Point, library: Library) -> FreedTerms:
        """The terms of a library beside a model, without those that it takes up."""
        # What a model lacks presses weights against zero, and they are free with the right terms.
        projection = Projection(problem, point, any_sign=True)
        goal = point.residual if point.chain.at(SensorEffect) else point.target
        whole = np.stack([term.values[problem.rows] for term in library.terms], axis=1)
        left = projection.left(whole)
        rows = projection.rows
        powers = np.sum(left[rows] ** 2, axis=0)
        own = np.sum((whole[rows] - whole[rows].mean(axis=0)) ** 2, axis=0)
        seen = powers > LEAST_LEFT * own
        size = np.sqrt(powers[seen])
        left = left[:, seen] / size
        listed = [term for term, there in zip(library.terms, seen, strict=True) if there]
        inside = left[rows]
        remainder: np.ndarray = projection.left(goal)
        return FreedTerms(
            listed, projection, whole[:, seen], left, size, remainder, inside.T @ inside
        )

    def pursued(self, remainder: np.ndarray) -> list[list[int]]:
        """Places of the terms that explain most of a remainder, (row,): of one, of two, and so on.

        After each term that is added, each of those before it is exchanged where another one
        explains more beside the rest.
        """
        rows = self.projection.rows
        power = float(remainder[rows] @ remainder[rows])
        moment = self.left[rows].T @ remainder[rows]
        found, chosen = list[list[int]](), list[int]()
        while len(chosen) < MOST_TERMS:
            term = self._next(moment, power, chosen)
            if term is None:
                break
            chosen = self._exchanged(moment, power, [*chosen, term])
            found.append(chosen)
        return found

    def _next(self, moment: np.ndarray, power: float, chosen: list[int]) -> int | None:
        """The simplest of the terms that leave hardly more beside others than the best one."""
        inner, across = self.gram[np.ix_(chosen, chosen)], self.gram[chosen]
        beside: np.ndarray = np.linalg.solve(inner, across)
        own: np.ndarray = np.diag(self.gram) - np.sum(across * beside, axis=0)
        seen = own > LEAST_LEFT
        seen[chosen] = False
        if not seen.any():
            return None
        score: np.ndarray = (moment - moment[chosen] @ beside) ** 2 / np.maximum(own, LEAST_LEFT)
        score = np.where(seen, score, -1.0)
        # What rounding leaves of nothing tells no terms apart.
        left = np.maximum(power - self._explained(moment, chosen) - score, ROUNDING * power)
        good = np.flatnonzero(seen & (left <= AS_GOOD * left.min()))
        orders = np.array([self.listed[k].order for k in good.tolist()])
        good = good[orders == orders.min()]
        return int(good[np.argmax(score[good])])

    def _explained(self, moment: np.ndarray, chosen: list[int]) -> float:
        inner = self.gram[np.ix_(chosen, chosen)]
        return float(moment[chosen] @ np.linalg.solve(inner, moment[chosen]))

    def _exchanged(self, moment: np.ndarray, power: float, chosen: list[int]) -> list[int]:
        """Some terms, each exchanged as long as clearly less is left."""
        left = power - self._explained(moment, chosen)
        for _ in range(MOST_TERMS):
            before = chosen
            for term in before[:-1]:
                others = [other for other in chosen if other != term]
                other = self._next(moment, power, others)
                trial = chosen if other is None else [*others, other]
                now = power - self._explained(moment, trial)
                if now * AS_GOOD < left:
                    chosen, left = trial, now
            if chosen == before:
                break
        return chosen

    def after(self, remainder: np.ndarray, chosen: Sequence[int]) -> np.ndarray:
        """(row,) what some terms, as large as suits them best, leave of a remainder."""
        rows, own = self.projection.rows, self.left[:, list(chosen)]
        inner = self.gram[np.ix_(chosen, chosen)]
        return remainder - own @ np.linalg.solve(inner, own[rows].T @ remainder[rows])

    def by_chance(self, problem: Problem, seed: int, draws: int) -> float:
        """Greatest relative fall of the held-out mean square on shifted remainders."""
        generator = np.random.default_rng(seed)
        order, held_out = problem.in_time, problem.fold == VALIDATION[0]
        shifted = np.empty((len(order), draws))
        parts = np.array_split(order, SHIFTED_PARTS)
        for draw in range(draws):
            for part in parts:
                lag = int(generator.integers(len(part)))
                shifted[part, draw] = np.roll(self.remainder[part], lag)
        gains: list[float] = []
        refitted_remainders: np.ndarray = self.projection.left(shifted)
        for draw in range(draws):
            remainder = refitted_remainders[:, draw]
            before = float(np.mean(remainder[held_out] ** 2))
            left = [self.after(remainder, chosen) for chosen in self.pursued(remainder)]
            gains += [1 - float(np.mean(e[held_out] ** 2)) / before for e in left if before]
        return max(gains, default=0.0)


def refitted(
    problem: Problem, point: Point, terms: FreedTerms, chosen: Sequence[int]
) -> tuple[np.ndarray, np.ndarray]:
    """What a model leaves whose density is fitted with some terms.

    Arguments:
        problem: the record.
        point: the model.
        terms: the terms beside it.
        chosen: places of some of them.

    Returns:
        (row,) residual and (term,) coefficients, both in output ranges.
    """
    if point.chain.at(SensorEffect):  # what the sensor does is linear only to first order
        own = terms.left[:, list(chosen)]
        inner = terms.gram[np.ix_(chosen, chosen)]
        rows = terms.projection.rows
        found = np.linalg.solve(inner, own[rows].T @ terms.remainder[rows])
        return point.residual - own @ found, found / terms.size[list(chosen)]
    columns = terms.whole[:, list(chosen)]
    scale = np.sqrt(np.mean(columns**2, axis=0))
    columns = columns / scale
    parts = slices_of(problem.fold)
    other = np.stack([point.matrix[rows].T @ columns[rows] for rows in parts])
    inner = np.stack([columns[rows].T @ columns[rows] for rows in parts])
    moment = np.stack([columns[rows].T @ point.target[rows] for rows in parts])
    matrix = np.concatenate([point.matrix, columns], axis=1)
    guess = np.concatenate([point.solution, np.zeros(len(chosen))])
    equations = point.equations.extended(other, inner, moment)
    wider = with_strength(
        problem, replace(point, matrix=matrix, equations=equations, solution=guess)
    )
    found = wider.solution[-len(chosen) :]
    return wider.residual, found / scale
