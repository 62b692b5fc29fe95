"""Compare a model with a measurement, and say which effect it lacks."""

from preisach_jax.diagnosis.form import SparseForm
from preisach_jax.diagnosis.pursuit import find_form
from preisach_jax.diagnosis.result import Budget, Candidate, Diagnosis, Experiment, Finding, Rung
from preisach_jax.diagnosis.selection import diagnose

__all__ = [
    "Budget",
    "Candidate",
    "Diagnosis",
    "Experiment",
    "Finding",
    "Rung",
    "SparseForm",
    "diagnose",
    "find_form",
]
