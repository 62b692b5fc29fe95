"""How close a verdict is: whether a quarter more or less data could turn it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from preisach_jax.diagnosis.evidence import LEAST_DELTA_BIC, LEAST_GAIN, Evidence
from preisach_jax.diagnosis.result import Budget, Candidate, Finding

NUMBERS = ("gain", "z", "delta_bic")
"""What the two tests of an effect measure."""

A_LITTLE = 1.25
"""Factor on the number of rows that is a little more data."""


def close_calls(
    findings: Sequence[Finding], candidates: Sequence[Candidate], budget: Budget, met: bool
) -> tuple[str, ...]:
    r"""What a little more or less data could turn.

    With n rows, \(\Delta\mathrm{BIC}\) grows as n and z as \(\sqrt n\); the gain, and the part of
    the budget that is not explained, are as uncertain as z.

    Arguments:
        met: whether the error that is not explained was taken to be within the budget.

    Returns:
        A clause each; empty if the verdict is clear.
    """
    calls = [
        f"{finding.effect} passes the tests by a small margin"
        for finding in findings
        if _least_margin(finding.evidence) < 1
    ]
    refused = [
        candidate.effect
        for candidate in candidates
        if not candidate.accepted
        and candidate.step == len(findings)
        and set(NUMBERS) <= set(candidate.evidence)
        and _told(candidate.evidence).against
        and _least_margin(candidate.evidence, A_LITTLE) >= 1
    ]
    calls += [f"{name} fails them by a small margin" for name in dict.fromkeys(refused)]
    least, most = budget.allowed / A_LITTLE**0.5, budget.allowed * A_LITTLE**0.5
    if met == budget.is_met and least < budget.unexplained < most:
        side = "just within" if met else "just beyond"
        calls.append(f"what is not explained is {side} noise and discretisation")
    return tuple(calls)


def _told(numbers: Mapping[str, float]) -> Evidence:
    gain, z, delta_bic = (numbers[name] for name in NUMBERS)
    return Evidence(gain, z, int(numbers.get("blocks", 0)), delta_bic)


def _least_margin(evidence: Mapping[str, float], data: float = 1 / A_LITTLE) -> float:
    """The smallest statistic over its threshold, for a factor of the data; 0 without numbers."""
    if not set(NUMBERS) <= set(evidence):
        return 0.0 if data > 1 else float("inf")
    own = _told(evidence)
    return min(
        own.gain * data**0.5 / LEAST_GAIN,
        own.z * data**0.5 / own.least_z,
        own.delta_bic * data / LEAST_DELTA_BIC,
    )
