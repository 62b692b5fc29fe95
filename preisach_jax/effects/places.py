"""Where an effect acts in the signal chain: one enumeration for code, reports and documentation."""

from __future__ import annotations

from enum import StrEnum


class Place(StrEnum):
    """Where an effect acts, in the order in which a signal passes the chain.

    Effects of the sensor (`SensorEffect`) are effects of the output that act last of all.

    Example:
        >>> Place.WEIGHTS, Place("added").acts_on
        (<Place.WEIGHTS: 'weights'>, 'the sum, beside the hysteresis')
    """

    INPUT = "input"
    HYSTERESIS = "hysteresis"
    WEIGHTS = "weights"
    OUTPUT = "output"
    ADDED = "added"

    @property
    def acts_on(self) -> str:
        """What an effect of this place acts on, in words."""
        return _ACTS_ON[self]


_ACTS_ON = {
    Place.INPUT: "the input, before the hysteresis",
    Place.HYSTERESIS: "the thresholds of the hysterons",
    Place.WEIGHTS: "the weights of the hysterons",
    Place.OUTPUT: "the output of the hysteresis",
    Place.ADDED: "the sum, beside the hysteresis",
}
