"""The diagnosis in words: the verdict, where the rest sits, what to record next."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from preisach_jax.diagnosis.evidence import LEAST_SCORE
from preisach_jax.diagnosis.memoryless import Memoryless
from preisach_jax.diagnosis.residuals import (
    cumulated_periodogram,
    in_sequence,
    input_rate,
    last_reversal,
    longest_lag,
    reversals,
)
from preisach_jax.diagnosis.result import Budget, Candidate, Diagnosis, Experiment, Finding
from preisach_jax.diagnosis.tolerance import stroke_of
from preisach_jax.effects import BUILT_IN
from preisach_jax.effects.base import Effect, OfColumn
from preisach_jax.fit import Fit
from preisach_jax.model import Model
from preisach_jax.quantity import number, quantity
from preisach_jax.record.blemishes import fault_lines
from preisach_jax.record.core import Record


def plain(name: str) -> str:
    """An effect's name in words that a mechanic understands; its name, if it has no others."""
    prefix, _, column = name.partition(":")
    for kind in BUILT_IN:
        if issubclass(kind, OfColumn) and column and kind.prefix == prefix:
            return kind.in_words.format(column)
        if kind.name == name:
            return kind.in_words
    return name


def sentence(
    verdict: str,
    findings: Sequence[Finding],
    budget: Budget,
    fits: Sequence[Fit],
    tolerance: float = 0.0,
    close: Sequence[str] = (),
    shows_none: bool = False,
) -> str:
    """The verdict in one sentence, and in a second one if it is close.

    Arguments:
        tolerance: RMS error, in output units, that does not matter.
        shows_none: whether the record can show none of the effects that were asked for.
    """
    said = _verdict(verdict, findings, budget, fits, tolerance, shows_none)
    return f"{said} The verdict is close: {'; '.join(close)}." if close else said


def _verdict(
    verdict: str,
    findings: Sequence[Finding],
    budget: Budget,
    fits: Sequence[Fit],
    tolerance: float,
    shows_none: bool,
) -> str:
    stroke = stroke_of(fits[0].record)
    first, last = (_error(fit, budget.unit, stroke) for fit in (fits[0], fits[-1]))
    unexplained = quantity(budget.unexplained, budget.unit, digits=3)
    rest = budget.in_words
    if not budget.is_met:
        allowed = quantity(tolerance, budget.unit, digits=3)
        rest += f", and {unexplained} within the tolerance of {allowed}"
    if verdict != "unexplained" and budget.is_of_the_plane(stroke):
        rest = (
            f"mostly what {fits[-1].model.chain.size_text} cannot follow "
            f"({quantity(budget.discretisation, budget.unit, digits=3)}, with a noise of "
            f"{quantity(budget.noise, budget.unit, digits=3)}): the plane is the limit, and "
            "whatever is smaller than that cannot be seen"
        )
    if verdict == "adequate" and budget.is_of_the_plane(stroke):
        return f"No effect can be seen: the plain hysteresis model leaves {last}, {rest}."
    if verdict == "adequate":
        return (
            f"Nothing is missing: the plain hysteresis model predicts the output to {last}, "
            f"which is {rest}."
        )
    if verdict == "unexplained":
        none = "none of the effects tried explains it"
        if shows_none:
            none = "this record can show none of the effects that were asked for"
        return (
            f"Something is missing, but {none}: of the error of {last}, {unexplained} are neither "
            "noise nor discretisation."
        )
    named = " and ".join(_with_family(finding) for finding in findings)
    rest = (
        f"what remains is {rest}"
        if verdict == "explained"
        else f"{unexplained} of it are still not explained"
    )
    added = "it" if len(findings) == 1 else "them"
    return (
        f"The plain hysteresis model lacks {named}: with {added}, the error falls from {first} to "
        f"{last}; {rest}."
    )


def _error(model: Fit | Memoryless, unit: str, stroke: float) -> str:
    share = number(100 * model.rms_validation / stroke, 2)
    return f"{quantity(model.rms_validation, unit, digits=3)} RMS ({share} % of the stroke)"


def of_hysteresis(found: Diagnosis) -> list[str]:
    """A sentence where a model without hysteresis does as well, or nearly."""
    stroke, unit = found.base.record.output_range, found.budget.unit
    enough = found.without_hysteresis
    if enough is not None:
        law = ""
        if enough.slope is not None and enough.offset is not None:
            law = f" ({number(enough.offset)} + {number(enough.slope)} times the input)"
        return [
            f"No hysteresis: a {enough.name}{law} does as well as the plain hysteresis model, "
            f"{_error(enough, unit, stroke)}."
        ]
    return [
        f"There is little hysteresis: a {model.name} alone leaves {_error(model, unit, stroke)}."
        for model in found.memoryless
        if model.does_nearly
    ][:1]


def _with_family(finding: Finding) -> str:
    name = plain(finding.effect)
    if len(finding.family) == 1:
        return name
    others = " or ".join(finding.family[1:])
    return f"{name} (or {others}, which this record cannot tell from it)"


LEAST_REVERSALS = 6
"""Turns of the input below which a record shows little of what hysteresis does."""


def evidence_in_words(candidate: Candidate) -> str:
    """What speaks for an effect that was tried, or against it, in a sentence or two."""
    if not np.isfinite(candidate.rms_validation):
        return candidate.why_not[:1].upper() + candidate.why_not[1:] + "."
    gain = 100 * candidate.gain
    does = "lowers" if gain >= 0 else "raises"
    text = f"It {does} the held-out mean square by {abs(gain):.1f} %"
    if candidate.why_not:
        return f"{text}. Against it: {candidate.why_not}."
    numbers = candidate.evidence
    return (
        f"{text}, consistently over {numbers['blocks']:.0f} stretches of the record (score "
        f"{numbers['score']:.1f}, where {LEAST_SCORE:.0f} is enough for a name)."
    )


def notes_on(record: Record, model: Model) -> tuple[str, ...]:
    """What a reader must know of a record before believing a verdict on it."""
    notes: list[str] = []
    rows, cells = int(record.measured.sum()), model.plane.cells
    if rows < cells:
        notes.append(
            f"The record has {rows} measured rows for {cells} cells of the plane: "
            "large effects can be hidden in it. Record more, or ask for fewer levels."
        )
    if model.chain.signed:
        notes.append(
            "The density has weights of both signs, as butterfly loops need, where the output "
            "falls and rises along one branch. The held-out data require them: with one sign the "
            "error is much larger. Friction and damping do that too: record the velocity as a "
            "column, or try the other direction with --input and --output."
        )
    if not record.has_clock:
        notes.append(
            "The record has no clock: samples are counted, and only effects that need none were "
            "tried; drift and ageing go with the path of the input, in its unit."
        )
    notes += [f"{line}." for line in fault_lines(record)]
    turns = len(reversals(record.input, None, record.starts))
    if turns < LEAST_REVERSALS:
        notes.append(
            f"The input reverses only {turns} times, too few to show hysteresis and most effects. "
            "Record loops of several heights and at more than one rate."
        )
    return tuple(notes)


def located(record: Record, residual: np.ndarray) -> str:
    """Where a residual sits: the stretch of an axis that holds most of its power.

    Each axis is cut into ten parts of equal numbers of samples; the part with the greatest share
    of the squared residual is named, for the three axes that concentrate it most.  Then the
    direction of the input, if one has much more than its share, and the band of frequencies.
    """
    rows = np.flatnonzero(record.measured)
    power = residual[rows] ** 2
    rate = input_rate(record.time, record.input, record.starts)
    last = last_reversal(record.input, None, record.starts)
    unit_u, unit_z = record.input_unit, record.output_unit
    axes = {
        "time": (record.time, record.time_unit),
        "input": (record.input, unit_u),
        "output": (record.output, unit_z),
        "speed of the input": (np.abs(rate), record.rate_unit),
        "time since the last reversal": (record.time - record.time[last], record.time_unit),
        "input at the last reversal": (record.input[last], unit_u),
    }
    places: list[tuple[float, str]] = []
    for name, (values, unit) in axes.items():
        order = np.argsort(values[rows], kind="stable")
        tenths = np.array_split(order, 10)
        shares = np.array([power[tenth].sum() for tenth in tenths]) / power.sum()
        worst = int(np.argmax(shares))
        inside = values[rows][tenths[worst]]
        places.append(
            (
                shares[worst],
                f"{100 * shares[worst]:.0f} % of its power lie where the {name} is "
                f"{quantity(inside.min(), unit, 3)} to {quantity(inside.max(), unit, 3)}",
            )
        )
    places.sort(reverse=True)
    tenths = "; ".join(text for _, text in places[:3]) + " (each a tenth of the samples)"
    return "; ".join([tenths, *_one_sided(np.sign(rate[rows]), power), _band(record, residual)])


UNEVEN = 1.5
"""Share of the power over that of the samples from which a direction is named."""


LEAST_SHARE = 0.2
"""Share of the power below which no direction is named."""


def _one_sided(direction: np.ndarray, power: np.ndarray) -> list[str]:
    """The direction of the input that has much more of the power than of the samples."""
    texts: list[str] = []
    for sign, name in ((1, "rises"), (-1, "falls"), (0, "rests")):
        inside = direction == sign
        share, expected = power[inside].sum() / power.sum(), inside.mean()
        if share > max(UNEVEN * expected, LEAST_SHARE):
            texts.append(
                f"{100 * share:.0f} % while the input {name} ({100 * expected:.0f} % of the "
                "samples)"
            )
    return texts


def _band(record: Record, residual: np.ndarray) -> str:
    """The band of frequencies that holds the middle half of the power."""
    spectrum = cumulated_periodogram(
        in_sequence(record, residual, longest_lag(record)), record.step_s
    )
    ends = spectrum.frequency_hz[np.searchsorted(spectrum.value, (0.25, 0.75))]
    first, last = (quantity(float(end), record.frequency_unit, 2) for end in ends)
    return f"half of it between {first} and {last}"


UNIVERSAL = (
    "three exact repeats of one loop over the full range, the same loop at three rates over a "
    "decade and a half, and holds of increasing length after moves in both directions"
)
"""An excitation that shows every effect."""


def next_experiment(
    verdict: str, findings: Sequence[Finding], tried: Sequence[Effect], shows_little: bool = False
) -> Experiment | None:
    """What to record next: what splits the families, or brings out what is unexplained.

    Arguments:
        shows_little: whether the record cannot tell most of the effects that were tried.
    """
    families = tuple(finding.family for finding in findings if len(finding.family) > 1)
    if families:
        by_name = {effect.name: effect for effect in tried}
        texts = [by_name[family[0]].experiment for family in families]
        names = "; ".join(" and ".join(family) for family in families)
        return Experiment(
            text=" Also: ".join(texts),
            why=f"this record cannot tell apart: {names}",
            families=families,
        )
    if verdict in ("unexplained", "partly_explained"):
        return Experiment(
            text=UNIVERSAL,
            why=(
                "an error above noise and discretisation remains: repeats show what is noise, "
                "rates what is dynamic, holds what is slow"
            ),
            families=(),
        )
    if shows_little:
        return Experiment(
            text=UNIVERSAL,
            why="this record could not show most of the effects, whether they are there or not",
            families=(),
        )
    return None
