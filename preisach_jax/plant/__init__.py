"""The simulated experiment: a piezo stage with hysteresis, chosen further effects and an encoder.

It is the judge of what the diagnosis says, so it shares nothing with the models: its hysteresis is
a bundle of generalised plays, integrated at a finer step than the record's, and each effect is
written down here from its physics. Arrays are NumPy in double precision.
"""

from preisach_jax.plant.draws import EFFECTS
from preisach_jax.plant.experiment import ENCODER_STEP_UM, StageRecord, simulate_stage
from preisach_jax.plant.stage import RANGE_V, Stage, make_stage

__all__ = [
    "EFFECTS",
    "ENCODER_STEP_UM",
    "RANGE_V",
    "Stage",
    "StageRecord",
    "make_stage",
    "simulate_stage",
]
