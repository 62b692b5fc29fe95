"""Fits to all rows of the models of a search, computed while the search goes on."""

from __future__ import annotations

from collections.abc import Mapping
from concurrent.futures import Future
from dataclasses import dataclass, replace
from types import TracebackType

from preisach_jax.cores import Background
from preisach_jax.diagnosis.budget import Floor
from preisach_jax.diagnosis.plausible import from_the_drive, out_of_law
from preisach_jax.fit import FINAL_ROWS, Fit, finished, moved_to
from preisach_jax.identify import Point, Problem
from preisach_jax.record import Record


@dataclass(frozen=True, eq=False)
class Final:
    """A model fitted to all rows.

    Attributes:
        fit: the fit, without its regressors, which are great.
        floor: what no other effect can take away from its error.
        from_the_drive: what says so of an effect, by its name, of those that the drive makes: a
            line may be another one where fewer rows were looked at.
        contradicted: names of those, and of the effects whose parameters are none of their law.
    """

    fit: Fit
    floor: Floor
    from_the_drive: Mapping[str, str]
    contradicted: frozenset[str]


class FinalFits:
    """The fits to all rows of models that were found on some of them, each computed once.

    A search is many small steps of Python; a final fit is a few products of large matrices, which
    another core computes meanwhile.  What comes out does not depend on when it was begun.
    """

    def __init__(self, record: Record):
        self.record = record
        self.problem = Problem.of(record, FINAL_ROWS)
        self._background = Background()
        self._begun: dict[Point, Future[Final]] = {}

    def __enter__(self) -> FinalFits:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self._background.close()

    def begin(self, search: Problem, point: Point) -> None:
        """Compute the fit of a model in the background, if that has not been begun."""
        if point in self._begun:
            return
        # The bases are taken here, where the search adds to them: what it shares is only read.
        bases = self.problem.reduced(search)

        def work() -> Final:
            whole = replace(self.problem, cache={})
            reduced = replace(bases, cache=dict(bases.cache))
            fit = finished(whole, moved_to(reduced, point), self.record)
            names = [effect.name for effect in fit.point.chain.effects]
            told = {name: from_the_drive(whole, fit.point, name) for name in names}
            drives = {name: text for name, text in told.items() if text}
            against = {name for name in names if out_of_law(whole, fit.point, name)}
            slim = replace(fit, point=fit.point.slim)
            return Final(slim, Floor.of(whole, fit), drives, frozenset(against | drives.keys()))

        self._begun[point] = self._background.begin(work)

    def of(self, search: Problem, point: Point) -> Final:
        """The fit of a model, which is waited for."""
        self.begin(search, point)
        return self._begun[point].result()
