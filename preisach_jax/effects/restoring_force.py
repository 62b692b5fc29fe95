"""Restoring force: the hysteresis is driven by the output, inside the mechanics."""

from __future__ import annotations

from dataclasses import replace

import equinox as eqx
import numpy as np

from preisach_jax.effects.base import RATES, HysteresisEffect, Survey
from preisach_jax.effects.parameter import parameter
from preisach_jax.errors import InputError

BOUC_WEN, PREISACH = "bouc_wen", "preisach"
"""Laws of the hysteretic force."""


class RestoringForce(HysteresisEffect):
    r"""A body on a hysteretic spring: \(m\ddot z + c\dot z + k z + H(z) = u\).

    The force H depends on the path of the output, by one of two laws.  `"bouc_wen"` has one state,
    \(H = k_h Z y\) with \(Z\,dy/dz = 1 - |y|^n (\beta\,\mathrm{sgn}(y\,dz) + \gamma)\); its minor
    loops need not close.  `"preisach"` is the operator of eq. (6) over displacements, with weights
    in units of force; its minor loops close.  With the stiffness \(K = k + k_h\), of which
    \(k_h\) is the share of the hysteresis (its secant over the plane), the natural frequency is
    \(\sqrt{K/m}/2\pi\) and the damping ratio \(c/(2\sqrt{K m})\).

    A record that is predicted begins at rest and demagnetised, unless its input closes as one
    period does: then it begins in the steady state of its repetition.

    Arguments:
        law: `"bouc_wen"` or `"preisach"`; by default whichever predicts what is held out better.
        range_z: Z, the displacement in which y is measured.
        start_z, start_speed, start_y: displacement from rest, speed and y at the first sample of
            the record that was fitted.
        f_low_hz, f_high_hz: bounds of the natural frequency.

    Example:
        >>> [parameter.name for parameter in RestoringForce(law="preisach").parameters()]
        ['f_hz', 'zeta', 'share', 'stiffness']
    """

    name = "restoring_force"
    rank = 24
    in_words = "mechanics around the hysteresis (it is a force that the output drives)"
    inside_mechanics = True
    # Its body is simulated, not solved for by least squares: only where a resonance is promising.
    on_request = True
    physics = (
        "A mass stands on a spring that yields: a structure on isolators of rubber or wire rope, a "
        "bolted joint, a pre-sliding contact. The force of the spring depends on the path of the "
        "displacement, and the mass makes of it a resonance whose frequency and damping change "
        "with the amplitude. Loops of displacement against the driving force are then those of "
        "the mass, not of the material."
    )
    source = (
        "R. Bouc, Proc. 4th Conf. on Nonlinear Oscillation, Prague 1967; Y. K. Wen, J. Eng. Mech. "
        "Div. ASCE 102 (1976) 249-263; J. P. Noel, M. Schoukens, Hysteretic benchmark with a "
        "dynamic nonlinearity, Workshop on Nonlinear System Identification Benchmarks, 2016"
    )
    signature = (
        "residual that rings as that of a resonance, at a frequency that falls or rises with the "
        "amplitude"
    )
    confused_with = ("resonance",)
    needs = (RATES,)
    experiment = (
        "slow sweeps through the resonance at three amplitudes: its frequency and its width change "
        "with the amplitude where the hysteresis is inside, and stay where the mode is behind it"
    )
    law: str = eqx.field(static=True, default="")
    range_z: float = 1.0
    start_z: float = 0.0
    start_speed: float = 0.0
    start_y: float = 0.0
    f_low_hz: float = 1e-6
    f_high_hz: float = 1e9
    f_hz: float = parameter(
        "Hz",
        lambda own: own.f_low_hz,
        lambda own: own.f_high_hz,
        log=True,
        start=(1.0,),
        meaning="natural frequency without damping, with the stiffness of both springs",
    )
    zeta: float = parameter("1", 0.0, 2.0, start=(0.02,), meaning="ratio of the viscous damping")
    share: float = parameter(
        "1", -2.0, 3.0, start=(0.5,), meaning="share of the stiffness that is the hysteresis'"
    )
    stiffness: float = parameter(
        "{u}/{z}",
        0.0,
        float("inf"),
        start=(1.0,),
        amount=False,
        meaning="stiffness of both springs",
    )
    beta: float = parameter(
        "1", -20.0, 20.0, start=(0.3,), amount=False,
        meaning="yielding with the direction of the motion", when=lambda own: own.law != PREISACH,
    )  # fmt: skip
    gamma: float = parameter(
        "1", -20.0, 20.0, start=(0.3,), amount=False, meaning="yielding whatever the direction",
        when=lambda own: own.law != PREISACH,
    )  # fmt: skip
    n: float = parameter(
        "1", 1.0, 4.0, start=(1.0,), amount=False, open_ended="both",
        meaning="sharpness of the yielding", when=lambda own: own.law != PREISACH,
    )  # fmt: skip

    def __check_init__(self) -> None:
        if self.law not in ("", BOUC_WEN, PREISACH):
            raise InputError(
                f"the law of restoring_force is {self.law!r:.40}: it must be {BOUC_WEN!r} or "
                f"{PREISACH!r}; leave it out for whichever predicts better"
            )

    @property
    def has_one_state(self) -> bool:
        """Whether its law is that of Bouc and Wen, without a plane of hysterons."""
        return self.law == BOUC_WEN

    def bound_to(self, survey: Survey) -> RestoringForce:
        if len(survey.time) < 2:
            return self
        return replace(
            self,
            range_z=float(np.ptp(survey.output)) / 2,
            f_low_hz=1 / survey.duration_s,
            f_high_hz=0.45 / survey.step_s,
        )
