"""Energy that closed cycles lose: measured, and as a model has it."""

from preisach_jax.loss.account import Cycle, Loss, loss_per_cycle
from preisach_jax.loss.magnetic import Magnet, magnet_of

__all__ = ["Cycle", "Loss", "Magnet", "loss_per_cycle", "magnet_of"]
