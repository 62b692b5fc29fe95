"""From a model to a drive: its chain inverted, offline and sample by sample."""

from preisach_jax.compensation.drive import Compensation, compensate
from preisach_jax.compensation.loop import Loop, simulate_loop
from preisach_jax.compensation.online import OnlineInverse

__all__ = ["Compensation", "Loop", "OnlineInverse", "compensate", "simulate_loop"]
