"""First-order lag between the hysteresis and the recorded output."""

from typing import ClassVar

from preisach_jax.effects.base import OutputEffect
from preisach_jax.effects.first_order import FirstOrderLag


class OutputLag(FirstOrderLag, OutputEffect):
    r"""First-order lag of the output: \(\tau \dot z = h - z\).

    Arguments:
        tau_low_s, tau_high_s: bounds of the search for the time constant, in s.
        of_samples: whether it is a filter of the samples, which is half a sample earlier.

    Example:
        >>> import jax.numpy as jnp
        >>> t = jnp.arange(5.0)
        >>> late = t - OutputLag(tau_s=0.125).apply(t, t)
        >>> late.round(3).tolist()
        [0.0, 0.125, 0.125, 0.125, 0.125]
    """

    name: ClassVar[str] = "output_lag"
    in_words: ClassVar[str] = (
        "a lag of the sensor (the reading follows the output late and smoothed)"
    )
    physics: ClassVar[str] = (
        "The material moves at once, but the reading follows late: the demodulator of a capacitive "
        "or inductive sensor, a strain gauge amplifier and an anti-aliasing filter average over a "
        "time constant, and so does a filter of the samples in a controller, half a sample "
        "earlier.  The turning points that the material remembers are those of the input."
    )
    source: ClassVar[str] = (
        "A. J. Fleming, Sens. Actuators A 190 (2013) 106-126 (bandwidth of position sensors)"
    )
    signature: ClassVar[str] = (
        "residual in proportion to the rate of the output, with a tail of the time constant after "
        "every stop"
    )
    confused_with: ClassVar[tuple[str, ...]] = ("delay", "input_lag", "resonance", "viscosity")
    experiment: ClassVar[str] = (
        "a multisine up to a tenth of the sampling rate: a lag attenuates what is fast and a delay "
        "does not, a resonance amplifies it first; and fast small loops on a slow large one: "
        "behind a lag of the input the material remembers other turning points"
    )
