"""From a model to a drive: its chain inverted, offline and sample by sample."""

from preisach_jax.compensation.drive import Compensation, compensate

__all__ = ["Compensation", "compensate"]
