"""What a diagnosis says: verdict, findings, ladder, budget, candidates."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from preisach_jax.chain.description import model_name
from preisach_jax.diagnosis.form import SparseForm
from preisach_jax.diagnosis.limits import Limit
from preisach_jax.diagnosis.memoryless import LITTLE, Memoryless, sufficient
from preisach_jax.diagnosis.remainder import Relation
from preisach_jax.fit import Fit
from preisach_jax.hooks import HOOKS
from preisach_jax.model import Model, ParameterEstimate
from preisach_jax.quantity import quantity

MOST_RELATIONS = 4
"""Relations of the remainder that are told in words."""

NOTABLE = 0.1
"""Share of the power of an error from which on it is told; and share beyond chance from which on a
remainder goes with something."""

TIMES_THE_NOISE = 3.0
"""Discretisation over noise beyond which the plane is said to be the limit, unless it is little."""

VERDICTS = ("adequate", "explained", "partly_explained", "unexplained")


@dataclass(frozen=True)
class Rung:
    """One model of the ladder, with its errors in output units."""

    effects: tuple[str, ...]
    rms_identification: float
    rms_validation: float
    max_abs_validation: float
    fit_percent: float

    @property
    def name(self) -> str:
        """The model by its effects."""
        return model_name(self.effects)

    @staticmethod
    def of(fit: Fit) -> Rung:
        """The rung on which a fit stands."""
        return Rung(
            fit.effects,
            fit.rms_identification,
            fit.rms_validation,
            fit.max_abs_validation,
            fit.fit_percent,
        )


@dataclass(frozen=True)
class Finding:
    """An effect that was found missing.

    Attributes:
        effect: its name.
        family: names that this record cannot tell from it, itself included.
        parameters: its parameters with 95 % intervals.
        rms_before, rms_after: held-out error without and with it, in output units.
        evidence: gain, score and number of stretches, between the model before and that with it.
    """

    effect: str
    family: tuple[str, ...]
    parameters: Mapping[str, ParameterEstimate]
    rms_before: float
    rms_after: float
    evidence: Mapping[str, float]


@dataclass(frozen=True)
class Candidate:
    """An effect that was tried.

    Attributes:
        effect: its name.
        step: how many effects the model had when it was tried.
        gain: relative fall of the held-out mean square.
        rms_validation: held-out error with it, in output units.
        evidence: gain, score and number of stretches.
        accepted: whether it was added.
        why_not: why it was not; empty if it was.
    """

    effect: str
    step: int
    gain: float
    rms_validation: float
    evidence: Mapping[str, float]
    accepted: bool
    why_not: str


@dataclass(frozen=True)
class Budget:
    """Where the held-out error comes from, each as RMS in `unit`.

    Attributes:
        noise: what no model can predict, with the steps of the converters.
        input_quantisation: of it, what the steps do in which the input was recorded, at most.
        output_quantisation: of it, what the steps of the sensor do.
        discretisation: the grid of the plane.
        memory: what the rows that identify tell too little of: cells seldom visited.
        unexplained: the rest.
        unit: that of the output.
        jumps: what the heights of a sensor's jumps leave open.
    """

    noise: float
    input_quantisation: float
    output_quantisation: float
    discretisation: float
    memory: float
    unexplained: float
    unit: str
    jumps: float = 0.0

    def to_json(self) -> dict[str, Any]:
        """The shares by name; that of jumps only where there are some."""
        shares = asdict(self)
        return shares if self.jumps else {k: v for k, v in shares.items() if k != "jumps"}

    @property
    def whole(self) -> float:
        """The held-out error, of which the squares of the shares are the parts."""
        parts = (self.noise, self.discretisation, self.memory, self.jumps, self.unexplained)
        return float(np.linalg.norm(parts))

    @property
    def in_words(self) -> str:
        """What most of the error is."""
        parts = {
            "noise": self.noise,
            "discretisation": self.discretisation,
            "what cells that few rows visit leave open": self.memory,
            "what jumps of the sensor leave open": self.jumps,
        }
        least = NOTABLE**0.5 * self.whole
        main = [name for name, rms in parts.items() if rms > least] or ["noise"]
        if self.is_met and self.unexplained > least:
            left = quantity(self.unexplained, self.unit, digits=3)
            main.append(f"{left}, less than these, that nothing explains")
        *first, last = main
        return f"{', '.join(first)} and {last}" if first else last

    def is_of_the_plane(self, stroke: float) -> bool:
        """Whether the cells of the plane, not noise, set how well a model can predict.

        Arguments:
            stroke: range of the output, in its unit.
        """
        return self.discretisation > max(TIMES_THE_NOISE * self.noise, LITTLE * stroke)

    @property
    def allowed(self) -> float:
        """RMS that may stay unexplained: noise, discretisation, memory and jumps.

        Much of what a model lacks is booked as memory as well: it counts for no more than noise.
        """
        memory = min(self.memory, self.noise)
        return float(np.linalg.norm([self.noise, self.discretisation, memory, self.jumps]))

    @property
    def is_met(self) -> bool:
        """Whether what none of the shares explains is no more than what is allowed."""
        return self.unexplained <= self.allowed


@dataclass(frozen=True)
class Experiment:
    """What to record next, why, and which families it splits."""

    text: str
    why: str
    families: tuple[tuple[str, ...], ...]


@dataclass(frozen=True, eq=False)
class Diagnosis:
    """The outcome of a diagnosis.

    Attributes:
        verdict: `"adequate"`, `"explained"`, `"partly_explained"` or `"unexplained"`.
        sentence: the verdict in one sentence, and in a second one if it is close.
        close: what a little more or less data could turn; empty if the verdict is clear.
        findings: one an effect, in the order in which they were added.
        ladder: one rung a model, first the base.
        budget: what the last error is made of.
        candidates: all effects tried.
        limits: how great each effect that was not found could be without being seen.
        alternatives: for each other member of a family, the model in which it stands in place of
            the effect that was named.
        next_experiment: what to record next, or None.
        located: where what remains sits; empty if it is within the budget.
        remainder: what it goes with, strongest first; empty if it is within the budget.
        notes: what a reader must know of the record and of what was tried.
        steps: the fit of each rung.
        form: the sparse form of what remains that was asked for (`find_form`), or None.
        memoryless: what models without hysteresis do on the rows of the ladder.
    """

    verdict: str
    sentence: str
    close: tuple[str, ...]
    findings: tuple[Finding, ...]
    ladder: tuple[Rung, ...]
    budget: Budget
    candidates: tuple[Candidate, ...]
    limits: tuple[Limit, ...]
    alternatives: Mapping[str, Model]
    next_experiment: Experiment | None
    located: str
    remainder: tuple[Relation, ...]
    notes: tuple[str, ...]
    steps: tuple[Fit, ...]
    form: SparseForm | None = None
    memoryless: tuple[Memoryless, ...] = ()

    @property
    def leaves_a_part(self) -> bool:
        """Whether its effects, if any, leave a part of the error unexplained."""
        return self.verdict in ("partly_explained", "unexplained")

    def __repr__(self) -> str:
        first, last = (
            quantity(rung.rms_validation, self.budget.unit, 3)
            for rung in (self.ladder[0], self.ladder[-1])
        )
        errors = f"{first} -> {last}" if len(self.ladder) > 1 else last
        verdict = " by ".join(filter(None, (self.verdict, ", ".join(self.effects))))
        return f"<Diagnosis of {self.base.record.name}: {verdict}; held-out error {errors} RMS>"

    def _repr_html_(self) -> str:
        return HOOKS["Diagnosis._repr_html_"](self)

    @property
    def effects(self) -> tuple[str, ...]:
        """Names of the effects in the order in which they were added."""
        return tuple(finding.effect for finding in self.findings)

    @property
    def base(self) -> Fit:
        """The fit without effects."""
        return self.steps[0]

    @property
    def final(self) -> Fit:
        """The fit with all effects that were found."""
        return self.steps[-1]

    @property
    def model(self) -> Model:
        """The final model."""
        return self.final.model

    @property
    def without_hysteresis(self) -> Memoryless | None:
        """The simplest model without hysteresis that does as well; None if hysteresis is seen."""
        of_the_plane = self.budget.is_of_the_plane(self.base.record.output_range)
        return sufficient(self.memoryless, self.verdict == "adequate" and not of_the_plane)

    @property
    def rungs(self) -> tuple[Memoryless | Rung, ...]:
        """All models on the same held-out rows, from a straight line to the last effect."""
        return (*self.memoryless, *self.ladder)

    @property
    def remainder_in_words(self) -> list[str]:
        """What the remainder goes with most, a text each."""
        return [relation.text for relation in self.remainder[:MOST_RELATIONS]]

    def to_json(self) -> dict[str, Any]:
        """The content of `diagnosis.json`."""
        return {
            "verdict": self.verdict,
            "sentence": self.sentence,
            "close": list(self.close),
            "effects": list(self.effects),
            "findings": [asdict(finding) for finding in self.findings],
            "memoryless": [asdict(model) for model in self.memoryless],
            "ladder": [asdict(rung) for rung in self.ladder],
            "budget": self.budget.to_json(),
            "candidates": [asdict(candidate) for candidate in self.candidates],
            "limits": [
                asdict(limit) | {"text": limit.text(self.budget.unit)} for limit in self.limits
            ],
            "next_experiment": asdict(self.next_experiment) if self.next_experiment else None,
            "located": self.located,
            "remainder": [relation.to_json() for relation in self.remainder],
            "notes": list(self.notes),
            "loss": self.final.loss.to_json() if self.final.loss is not None else None,
            "form": self.form.to_json() if self.form else None,
        } | self._records()

    def _records(self) -> dict[str, Any]:
        """Of several records the rows and the errors of each; nothing for a single one."""
        each = [asdict(errors) for errors in self.final.by_record]
        return {"records": each} if each else {}

    def summary(self) -> str:
        """The verdict and the ladder as text."""
        return HOOKS["Diagnosis.summary"](self)
