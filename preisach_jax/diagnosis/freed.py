r"""The terms of a library beside a model: freed from what it takes up, and pursued in a remainder.

The terms are freed from what the model can take up, as the remainder is by its fit: with the
regressors A of the model and the matrix G of its penalised normal equations, a term leaves

\[ \varphi - A\,G^{-1} A_i^\top \varphi_i, \]

where i are the rows that identify (M. C. Lovell, J. Am. Stat. Assoc. 58 (1963) 993-1010).
Orthogonal least squares (S. Chen, S. A. Billings, W. Luo, Int. J. Control 50 (1989) 1873-1896)
then takes the term that explains most of the remainder on these rows, one after the other.  The
numbers inside the terms taken (time constants, widths, exponents) are then looked for between those
of the library.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from preisach_jax.diagnosis.terms import Library, Listed
from preisach_jax.effects.base import SensorEffect
from preisach_jax.identify.problem import VALIDATION, Point, Problem, with_strength
from preisach_jax.identify.regression import slices_of
from preisach_jax.identify.signature import Projection

MOST_TERMS = 4

SHIFTED_PARTS = 12
"""Parts of the record that are shifted each by a lag of its own."""

AS_GOOD = 1.02
"""Times the least power that a simpler term may leave to be taken, or less than which another must
leave to take the place of one."""

ROUNDING = 1e-12

NUMBERS, ZOOMS, PASSES = 9, 4, 2
"""Numbers inside a term that are tried at once, how often closer ones are, and rounds of terms."""

LEAST_LEFT = 1e-4
"""Share of the power of a term that the model and the terms taken must leave of it."""


@dataclass(frozen=True, eq=False)
class FreedTerms:
    """The terms on the measured rows, freed from what a model can take up.

    Attributes:
        problem: the record.
        listed: the terms.
        projection: that of the model.
        whole: (row, term) values.
        left: (row, term) what the model leaves of them, of unit size on the rows that identify.
        size: (term,) by which they were divided.
        remainder: (row,) what the model leaves of the output, with weights of any sign.
        gram: (term, term) products on the rows that identify.
    """

    problem: Problem
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
            problem, listed, projection, whole[:, seen], left, size, remainder, inside.T @ inside
        )

    def pursued(
        self, remainder: np.ndarray, *, sharpened: bool = True
    ) -> Iterator[tuple[FreedTerms, list[int]]]:
        """The terms that explain most of a remainder, (row,): one, two, and so on.

        After each term that is added, each of those before it is exchanged where another one
        explains more beside the rest.

        Arguments:
            remainder: (row,) the remainder.
            sharpened: whether numbers inside the terms are looked for between those of the library.
        """
        terms, chosen = self, list[int]()
        rows = self.projection.rows
        power = float(remainder[rows] @ remainder[rows])
        moment = self.left[rows].T @ remainder[rows]
        while len(chosen) < MOST_TERMS:
            term = terms._next(moment, power, chosen)
            if term is None:
                break
            chosen = terms._exchanged(moment, power, [*chosen, term])
            if sharpened:
                terms, chosen = terms._sharpened(remainder, chosen)
                moment = np.append(moment, terms.left[rows, len(moment) :].T @ remainder[rows])
            yield terms, chosen

    def _sharpened(self, remainder: np.ndarray, chosen: list[int]) -> tuple[FreedTerms, list[int]]:
        """Some terms with the numbers inside them that leave least of a remainder."""
        terms, now = self, list(chosen)
        for _ in range(PASSES):
            before = list(now)
            for place in range(len(now)):
                terms, now[place] = terms._sharper(remainder, now, place)
            if now == before:
                break
        return terms, now

    def _sharper(
        self, remainder: np.ndarray, chosen: list[int], place: int
    ) -> tuple[FreedTerms, int]:
        """One of some terms with the best number inside it, if that leaves clearly less."""
        listed = self.listed[chosen[place]]
        shape, rows = listed.shape, self.projection.rows
        if shape is None:
            return self, chosen[place]
        others = chosen[:place] + chosen[place + 1 :]
        basis = np.linalg.qr(self.left[:, others][rows])[0]
        rest = remainder[rows] - basis @ (basis.T @ remainder[rows])

        def left_with(own: np.ndarray) -> np.ndarray:
            beside = own - basis @ (basis.T @ own)
            power = np.maximum(np.sum(beside**2, axis=0), ROUNDING)
            return rest @ rest - (rest @ beside) ** 2 / power

        best, ratio, then = shape.value, shape.ratio, np.inf
        for _ in range(ZOOMS):
            numbers = best * ratio ** np.linspace(-1, 1, NUMBERS)
            freed: np.ndarray = self.projection.left(shape.values(numbers)[self.problem.rows])
            powers = left_with(freed[rows] / np.linalg.norm(freed[rows], axis=0))
            best, then = float(numbers[np.argmin(powers)]), float(powers.min())
            ratio **= 2 / (NUMBERS - 1)
        now = float(left_with(self.left[rows, chosen[place]][:, None])[0])
        floor = ROUNDING * float(remainder[rows] @ remainder[rows])
        if max(then, floor) * AS_GOOD < now:
            return self._with(listed.shaped(shape, best)), len(self.listed)
        return self, chosen[place]

    def _with(self, listed: Listed) -> FreedTerms:
        """These and one term more."""
        rows = self.projection.rows
        whole = listed.values[self.problem.rows][:, None]
        left = self.projection.left(whole)
        size = np.linalg.norm(left[rows], axis=0)
        left = np.concatenate([self.left, left / size], axis=1)
        across = left[rows].T @ left[rows, -1:]
        gram = np.block([[self.gram, across[:-1]], [across.T]])
        return replace(
            self, listed=[*self.listed, listed], whole=np.concatenate([self.whole, whole], axis=1),
            left=left, size=np.concatenate([self.size, size]), gram=gram,
        )  # fmt: skip

    def numbers(self, chosen: Sequence[int]) -> int:
        """How many numbers some terms take from the record: coefficients, and those inside."""
        return sum(1 + self.listed[k].numbers for k in chosen)

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

    def by_chance(self, seed: int, draws: int, gain: float) -> float:
        """Greatest relative fall of the held-out mean square on shifted remainders."""
        generator = np.random.default_rng(seed)
        order = self.problem.in_time
        moved = [shifted(self.remainder, order, generator) for _ in range(draws)]
        refitted_remainders: np.ndarray = self.projection.left(np.stack(moved, axis=1))
        most = 0.0
        for draw in range(draws):
            remainder = refitted_remainders[:, draw]
            own = self._gain(remainder, sharpened=False)
            if own > gain / 2:
                own = max(own, self._gain(remainder, sharpened=True))
            most = max(most, own)
        return most

    def _gain(self, remainder: np.ndarray, *, sharpened: bool) -> float:
        """Greatest relative fall of the held-out mean square by any number of terms."""
        held_out = self.problem.fold == VALIDATION[0]
        before = float(np.mean(remainder[held_out] ** 2))
        if not before:
            return 0.0
        left = (
            terms.after(remainder, chosen)
            for terms, chosen in self.pursued(remainder, sharpened=sharpened)
        )
        return max((1 - float(np.mean(e[held_out] ** 2)) / before for e in left), default=0.0)


def shifted(
    remainder: np.ndarray, in_time: np.ndarray, generator: np.random.Generator
) -> np.ndarray:
    """A remainder that is shifted round parts of the record, each by a lag of its own.

    Arguments:
        remainder: (row,) the remainder.
        in_time: (row,) positions of the rows in the order of time.
    """
    moved = np.empty_like(remainder)
    for part in np.array_split(in_time, SHIFTED_PARTS):
        moved[part] = np.roll(remainder[part], int(generator.integers(len(part))))
    return moved


def refitted(
    problem: Problem, point: Point, terms: FreedTerms, chosen: Sequence[int]
) -> tuple[np.ndarray, np.ndarray]:
    """What a model leaves whose density is fitted with some terms.

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
