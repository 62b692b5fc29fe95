"""Fig. 1 to 3: the hysteron, the adaptive filter and the experiment."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import jax
import numpy as np

from preisach_jax.operator.plane import Plane
from preisach_jax.operator.states import hysteron_states
from preisach_jax.paper.numbers import FigureData, Progress, report
from preisach_jax.piezo import NOTCH_NUMERATOR, RATE_HZ, resonances
from preisach_jax.plant import ENCODER_STEP_UM, RANGE_V


@dataclass(frozen=True, eq=False)
class HysteronLoops(FigureData):
    """Fig. 1: a relay and its ramp over one loop of the input.

    Attributes:
        input: (points,) input x of the rising branch, ascending; the falling one has it reversed.
        relay_up: (points,) relay y = ±1 while the input rises.
        relay_down: (points,) the same while it falls, in the order of `input`.
        ramp_up: (points,) ramp while the input rises.
        ramp_down: (points,) ramp while it falls, in the order of `input`.
        alpha: threshold α, at which it switches on.
        beta: threshold β, at which it switches off.
        delta_x: δx, the width of the ramp.
    """

    input: np.ndarray
    relay_up: np.ndarray
    relay_down: np.ndarray
    ramp_up: np.ndarray
    ramp_down: np.ndarray
    alpha: float
    beta: float
    delta_x: float

    @property
    def caption(self) -> str:
        return (
            "Hysteron: the relay of (1)-(4) switches on at the threshold α and off at β, and keeps "
            "its state between; the ramp (dashed) replaces the jump by a line of the width δx of a "
            "cell. The sum (6) takes the states as 0 and 1."
        )


def hysteron_loops(points: int = 241, progress: Progress | None = None) -> HysteronLoops:
    """Follow one relay and one ramp through a loop of the input, Fig. 1."""
    report(progress, "hysteron", 0.0)
    plane = Plane(levels=6, low=0.0, high=6.0)
    cell = int(np.flatnonzero((plane.alpha == 4.5) & (plane.beta == 1.5))[0])
    rising = np.linspace(plane.low, plane.high, points)
    path = np.concatenate([rising, rising[::-1]])
    with jax.enable_x64(True):
        branches: list[np.ndarray] = []
        for hysteron in ("relay", "ramp"):
            state = 2.0 * np.asarray(hysteron_states(plane, path, "low", hysteron)[:, cell]) - 1.0
            branches += [state[:points], state[points:][::-1]]
    return HysteronLoops(rising, *branches, alpha=4.5, beta=1.5, delta_x=plane.delta_x)


class Block(NamedTuple):
    """A block of a diagram.

    Attributes:
        name: by which signals name it.
        text: what it does, in lines.
        equation: its equations in the paper; empty if it has none.
    """

    name: str
    text: str
    equation: str


class Signal(NamedTuple):
    """An arrow of a diagram.

    Attributes:
        source: name of the block that it leaves; empty if it comes from outside.
        target: name of the block that it enters; empty if it goes outside.
        symbol: what it carries.
    """

    source: str
    target: str
    symbol: str


@dataclass(frozen=True, eq=False)
class Diagram(FigureData):
    """Fig. 2 and 3: blocks and the signals between them.

    Attributes:
        blocks: the blocks.
        signals: the arrows.
        text: the caption.
    """

    blocks: tuple[Block, ...]
    signals: tuple[Signal, ...]
    text: str

    @property
    def caption(self) -> str:
        return self.text


def filter_diagram(progress: Progress | None = None) -> Diagram:
    """The data flow of the adaptive hysteresis filter, Fig. 2."""
    report(progress, "adaptive filter", 0.0)
    blocks = (
        Block("plant", "unknown\nhysteresis", "(5)"),
        Block("noise", "+", "(13)"),
        Block("delay_z", "$d^{-1}$", ""),
        Block("difference_z", "−", ""),
        Block("hysterons", "hysterons\nin parallel", "(1)-(4)"),
        Block("sum", "weighted\nsum", "(6)"),
        Block("delay_model", "$d^{-1}$", ""),
        Block("difference_model", "−", ""),
        Block("error", "−", "(7)"),
        Block("switching", "switching\ncells", "(10), (11)"),
        Block("rate", "update\nrate", "(8)"),
        Block("update", "weights\nat k + 0.5", "(12)"),
    )
    signals = (
        Signal("", "plant", "x(k)"),
        Signal("", "hysterons", "x(k)"),
        Signal("", "noise", "n(k)"),
        Signal("plant", "noise", ""),
        Signal("noise", "difference_z", "z(k)"),
        Signal("noise", "delay_z", "z(k)"),
        Signal("delay_z", "difference_z", "z(k-1)"),
        Signal("hysterons", "sum", "y(k)"),
        Signal("sum", "difference_model", "ẑ(k)"),
        Signal("sum", "delay_model", "ẑ(k)"),
        Signal("delay_model", "difference_model", "ẑ(k-1)"),
        Signal("difference_z", "error", "Δz"),
        Signal("difference_model", "error", "Δẑ"),
        Signal("error", "rate", "e(k)"),
        Signal("hysterons", "switching", "y(k)"),
        Signal("switching", "rate", "A(k)"),
        Signal("switching", "update", "s(k)"),
        Signal("rate", "update", "r(k)"),
        Signal("update", "sum", "R̂"),
    )
    text = (
        "Adaptive hysteresis filter. Plant and filter see the same input x(k); the error e(k) "
        "compares how far their outputs have moved since the last sample at which hysterons "
        "switched (d⁻¹ is the delay to it), both of the filter's outputs with the present weights. "
        "Only then, at k + 0.5, the cells that switched share the error. In brackets: equations."
    )
    return Diagram(blocks, signals, text)


def experiment_diagram(progress: Progress | None = None) -> Diagram:
    """The principal structure of the experiment, Fig. 3."""
    report(progress, "experiment", 0.0)
    low, high = resonances(NOTCH_NUMERATOR).frequency_hz
    step_nm = 1e3 * ENCODER_STEP_UM
    blocks = (
        Block("command", f"Bernoulli\ncommand\n{RATE_HZ / 1e3:g} kHz", ""),
        Block("notch", "notch filter\n$F(d)$", "(26)"),
        Block("amplifier", f"amplifier\n0 to {RANGE_V:g} V", ""),
        Block("hysteresis", "piezo ceramics:\nhysteresis", ""),
        Block("resonances", f"frame: resonances\n{low:.1f} Hz, {high:.1f} Hz", ""),
        Block("encoder", f"linear encoder\n{step_nm:.2f} nm", ""),
    )
    signals = (
        Signal("command", "notch", "u(k)"),
        Signal("notch", "amplifier", "x(k)"),
        Signal("amplifier", "hysteresis", "v"),
        Signal("hysteresis", "resonances", "h"),
        Signal("resonances", "encoder", "stroke"),
        Signal("encoder", "", "z(k)"),
    )
    text = (
        f"Principal structure of the experiment at {RATE_HZ / 1e3:g} kHz. The identification "
        "takes the drive x(k) behind the notch filter as its input, so that the filter's delay is "
        "no part of what it identifies."
    )
    return Diagram(blocks, signals, text)
