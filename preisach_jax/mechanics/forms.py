"""Bodies of a few numbers: what a search moves, and the body that it makes of them."""

from __future__ import annotations

from typing import Any, NamedTuple

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from preisach_jax.mechanics.initial import Guess
from preisach_jax.mechanics.laws import Law, OneState, Operator
from preisach_jax.mechanics.motion import Body, Force, State, motion
from preisach_jax.operator.plane import Plane

COMMON = ("stiffness", "omega", "zeta", "offset", "start_z", "start_speed")
"""Numbers that every form begins with; the first two as logarithms."""

WIDTHS = (0.0, 0.1, 0.25, 0.5, 1.0)
"""Widths α - β of loops at which the density has nodes, in ranges of the plane: closer where
loops are narrow, since hardly any density is even across widths."""

PLACES = 3
"""Nodes of the density along the middle (α + β)/2 of loops, for each width."""

RIDGE = 5e-4
"""Share of the spread of the output that a density as great as the stiffness adds to the residual:
the prior decides only what the record leaves open."""


class Parts(NamedTuple):
    """What a form makes of its numbers: the body, its start, and the output at rest."""

    body: Body[Any]
    start: State
    offset: Array


class BoucWenForm(NamedTuple):
    """Numbers of a body with a Bouc-Wen law: the common ones, share, beta, gamma, n and start y.

    Attributes:
        range_z: displacement in which the state of the law is measured.
    """

    range_z: float

    def parts(self, numbers: Array) -> Parts:
        """The body that the numbers make, and where it starts."""
        stiffness, omega, zeta = jnp.exp(numbers[0]), jnp.exp(numbers[1]), numbers[2]
        share, beta, gamma, exponent = numbers[6], numbers[7], numbers[8], numbers[9]
        law = OneState(stiffness * share, jnp.asarray(self.range_z), beta, gamma, exponent)
        body = _body(stiffness, omega, zeta, stiffness * (1 - share), law)
        return Parts(body, (numbers[4], numbers[5], numbers[10:11]), numbers[3])

    def named(self, numbers: Array) -> dict[str, Array]:
        """The parameters of the effect."""
        shape = zip(("share", "beta", "gamma", "n"), numbers[6:10], strict=True)
        return _named(numbers) | dict(shape)

    def starts(self, common: np.ndarray) -> list[np.ndarray]:
        """Where a search starts: laws around the linear body that yield, and that stiffen."""
        y = common[4] / self.range_z
        shapes = ((0.3, 0.3), (0.7, -0.7))
        return [np.append(common, [0.5, *shape, 1.0, y]) for shape in shapes]

    def bounds(self) -> tuple[np.ndarray, np.ndarray]:
        """Lowest and highest numbers."""
        low, high = np.full(11, -np.inf), np.full(11, np.inf)
        low[[2, 6, 7, 8, 9, 10]] = [0.0, 1e-3, -20.0, -20.0, 1.0, -5.0]
        high[[2, 6, 7, 8, 9, 10]] = [2.0, 1.5, 20.0, 20.0, 4.0, 5.0]
        return low, high

    def penalty(self, scale: float) -> np.ndarray:
        """(row, number) rows that should be zero times the numbers, in units of the output."""
        del scale
        return np.zeros((0, 11))


class OperatorForm(NamedTuple):
    """Numbers of a body with a Preisach operator: the common ones, and a density at its nodes.

    The density is in units of the stiffness: a cell's weight is its value at the cell, times the
    stiffness and the range of the plane over the number of levels squared.

    Attributes:
        plane: the plane, over displacements.
        basis: (cells, node) linear interpolation from the nodes to the cells.
    """

    plane: Plane
    basis: np.ndarray

    @staticmethod
    def on(plane: Plane) -> OperatorForm:
        """The form whose density is linear between nodes, and has a part on the diagonal."""
        rows, columns = np.asarray(plane.alpha_index), np.asarray(plane.beta_index)
        most = plane.levels - 1.0
        width = _hats((rows - columns) / most, np.array(WIDTHS))
        place = _hats((rows + columns) / (2 * most), np.linspace(0.0, 1.0, PLACES))
        inside = (width[:, :, None] * place[:, None, :]).reshape(len(rows), -1)
        diagonal = np.where((rows == columns)[:, None], place, 0.0) * plane.levels
        basis = np.concatenate([inside, diagonal], axis=1)
        return OperatorForm(plane, basis[:, basis.any(axis=0)])

    @property
    def weight_scale(self) -> float:
        """Weight of a cell whose density is the stiffness."""
        return (self.plane.high - self.plane.low) / self.plane.levels**2

    def weights(self, numbers: Array) -> Array:
        """(cells,) weights, in units of force."""
        return jnp.exp(numbers[0]) * self.weight_scale * (self.basis @ numbers[len(COMMON) :])

    def parts(self, numbers: Array) -> Parts:
        """The body that the numbers make, and where it starts."""
        stiffness, omega, zeta = jnp.exp(numbers[0]), jnp.exp(numbers[1]), numbers[2]
        law = Operator(self.plane, self.weights(numbers))
        rest = stiffness - jnp.sum(law.weights) / (self.plane.high - self.plane.low)
        start = law.committed(law.demagnetised(numbers.dtype), numbers[4])
        body = _body(stiffness, omega, zeta, rest, law)
        return Parts(body, (numbers[4], numbers[5], start), numbers[3])

    def named(self, numbers: Array) -> dict[str, Array]:
        """The parameters of the effect."""
        share = jnp.sum(self.weights(numbers)) / (self.plane.high - self.plane.low)
        return _named(numbers) | {"share": share / jnp.exp(numbers[0])}

    def starts(self, common: np.ndarray) -> list[np.ndarray]:
        """Where a search starts: the linear body."""
        return [np.append(common, np.zeros(self.basis.shape[1]))]

    def bounds(self) -> tuple[np.ndarray, np.ndarray]:
        """Lowest and highest numbers."""
        count = len(COMMON) + self.basis.shape[1]
        low, high = np.full(count, -np.inf), np.full(count, np.inf)
        low[2], high[2] = 0.0, 2.0
        return low, high

    def penalty(self, scale: float) -> np.ndarray:
        """(row, number) rows that should be zero times the numbers, in units of the output."""
        nodes = self.basis.shape[1]
        return RIDGE * scale * np.eye(len(COMMON) + nodes)[len(COMMON) :] / np.sqrt(nodes)


Form = BoucWenForm | OperatorForm


def _named(numbers: Array) -> dict[str, Array]:
    return {
        "f_hz": jnp.exp(numbers[1]) / (2 * jnp.pi),
        "zeta": numbers[2],
        "stiffness": jnp.exp(numbers[0]),
    }


def _hats(values: np.ndarray, nodes: np.ndarray) -> np.ndarray:
    """(value, node) weights of linear interpolation between nodes."""
    return np.stack([np.interp(values, nodes, own) for own in np.eye(len(nodes))], axis=1)


def _body(stiffness: Array, omega: Array, zeta: Array, rest: Array, law: Law) -> Body[Any]:
    return Body(stiffness / omega**2, 2 * zeta * stiffness / omega, rest, law)


def simulated(form: Form, numbers: Array, force: Force, substeps: int) -> Array:
    """(time,) output of a form along a force."""
    parts = form.parts(numbers)
    return motion(parts.body, force, parts.start, substeps)[0] + parts.offset


def common_numbers(guess: Guess, z: np.ndarray) -> np.ndarray:
    """The common numbers of a linear guess."""
    stiffness, mass = guess.stiffness, guess.mass
    assert guess.is_body  # `fit` refuses others
    omega = np.sqrt(stiffness / mass)
    zeta = min(max(guess.damping / (2 * np.sqrt(stiffness * mass)), 0.005), 1.0)
    middle = float(z.mean())
    return np.array([np.log(stiffness), np.log(omega), zeta, middle, z[0] - middle, 0.0])
