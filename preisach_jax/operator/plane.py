"""The Preisach half-plane and its hysterons: thresholds, cells, and one step of their states.

Hysterons are the paper's relay, eq. (1)-(4), and its ramp, from one closed form.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any, cast

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax.core import Tracer
from jax.typing import ArrayLike

from preisach_jax.errors import InputError, shown, whole_number
from preisach_jax.operator.inputs import as_float, require_hysteron
from preisach_jax.tree import Tree

FINE = 32
"""Bins of the input for each threshold, when thresholds are placed where the output moves."""

MOST_LEVELS = 10_000
"""Of a plane: it has 50 million hysterons, each with a weight."""


def _levels(value: int) -> int:
    return whole_number("levels is", value, least=2, most=MOST_LEVELS)


def _limit(value: float) -> float:
    try:
        return float(value)
    except (TypeError, ValueError, OverflowError) as error:
        raise InputError(f"a limit of the plane is {shown(value)}: give a number") from error


def _require_memory(kind: str) -> None:
    if kind not in ("low", "high", "demagnetised"):
        raise InputError(
            f"the initial memory is {kind!r}: it must be 'low', 'high' or 'demagnetised'"
        )


class Plane(Tree):
    """Discretised Preisach half-plane α ≥ β with N levels per axis and L = N(N+1)/2 cells.

    δx = (high - low)/N, and the thresholds lie at the centres low + (i + 1/2)δx of the N cells of
    an axis, so that all hysterons are off at x = low and on at x = high. The diagonal α = β belongs
    to the plane. Cells are in flat order: α index i outer (0 ... N-1), β index j = 0 ... i inner,
    flat index i(i+1)/2 + j.

    Thresholds of one's own need not be equally spaced: H on any thresholds is H on equal ones
    behind the map of the input that is i + 1/2 at threshold i and linear between. The last ones may
    be infinite: no input reaches them, and planes of several sizes so have one shape (`padded`).

    Arguments:
        levels: N ≥ 2, the levels of each axis.
        low: lower limit of the input, in its unit.
        high: upper limit of the input, in its unit; above `low`.
        thresholds: (levels,) ascending thresholds between them, in the unit of the input; without
            them, those of equal cells. May be traced, which is not checked.

    Raises:
        InputError: `levels` is below 2, the limits are not finite and ascending, or the thresholds
            are not ascending between them.

    Example:
        >>> plane = Plane(levels=37, low=0.0, high=75.0)
        >>> plane.cells
        703
        >>> Plane(levels=3, low=0.0, high=4.0, thresholds=[1.0, 1.5, 3.0]).alpha.tolist()
        [1.0, 1.5, 1.5, 3.0, 3.0, 3.0]
    """

    levels: int = eqx.field(static=True)
    low: float = eqx.field(static=True)
    high: float = eqx.field(static=True)
    own_thresholds: Any

    def __init__(
        self,
        levels: int,
        low: float,
        high: float,
        thresholds: ArrayLike | Sequence[float] | None = None,
    ) -> None:
        self.levels, self.low, self.high = _levels(levels), _limit(low), _limit(high)
        for name, limit in (("low", self.low), ("high", self.high)):
            if not math.isfinite(limit):
                raise InputError(f"{name} is {limit}: the limits of the plane must be finite")
        if not self.low < self.high:
            raise InputError(f"low is {self.low} and high is {self.high}: low must be below high")
        self.own_thresholds = None if thresholds is None else self._checked(thresholds)

    def __hash__(self) -> int:
        return hash((self.levels, self.low, self.high))  # arrays have none

    def _checked(self, thresholds: Any) -> Any:
        """Thresholds of one's own, in double precision if they are known."""
        if np.shape(thresholds) != (self.levels,):
            raise InputError(
                f"thresholds has the shape {np.shape(thresholds)}: give ({self.levels},), one each"
            )
        if isinstance(thresholds, Tracer):
            return cast(Any, thresholds)
        try:
            values = np.asarray(thresholds, float)
        except (TypeError, ValueError) as error:
            raise InputError(f"thresholds holds {shown(thresholds)}: give numbers") from error
        used = values[: int(np.isfinite(values).sum())]
        if not used.size or not np.all(values[used.size :] == np.inf):
            raise InputError(
                f"thresholds holds {shown(values)}: give numbers, and infinity only after the last"
            )
        steps = np.diff(used, prepend=self.low, append=self.high)
        if not np.all(steps > 0):
            k = int(np.argmax(steps <= 0))
            raise InputError(
                f"thresholds[{min(k, used.size - 1)}] is {used[min(k, used.size - 1)]}: give "
                f"ascending thresholds between low, {self.low}, and high, {self.high}"
            )
        return thresholds if isinstance(thresholds, jax.Array) else values

    @classmethod
    def of(cls, record: Any, levels: int, limits: tuple[float, float] | None = None) -> Plane:
        """Place the thresholds where the output of a record moves.

        They are quantiles of the input: equal parts of 0.9 of how much the output moves, in the
        mean, while the input passes, and of 0.1 of the input's own range.

        Arguments:
            record: has an `input` and an `output`, (time,) each; rows with NaN are left out.
            levels: N, the levels of each axis.
            limits: lower and upper limit of the plane, in the unit of the input; by default the
                range of the input.

        Returns:
            The plane.

        Raises:
            InputError: the input does not move, or `levels` is below 2.

        Example:
            >>> from types import SimpleNamespace
            >>> x = np.abs(np.mod(np.linspace(0.0, 9.0, 900), 2.0) - 1.0)
            >>> steep = SimpleNamespace(input=x, output=np.tanh(20.0 * (x - 0.5)))
            >>> Plane.of(steep, levels=5).thresholds.round(2).tolist()
            [0.43, 0.47, 0.5, 0.52, 0.56]
        """
        levels = _levels(levels)
        x: np.ndarray = np.asarray(record.input, float)
        z: np.ndarray = np.asarray(record.output, float)
        there = np.isfinite(x) & np.isfinite(z)
        x, z = x[there], z[there]
        low, high = (float(side(x)) if len(x) else np.nan for side in (np.min, np.max))
        low, high = limits or (low, high)
        if not low < high:
            raise InputError(
                f"the plane goes from {low} to {high}: give a record whose input moves, or "
                "ascending limits"
            )
        bins = FINE * levels
        edges = np.linspace(low, high, bins + 1)
        place = np.clip(np.searchsorted(edges, x, side="right") - 1, 0, bins - 1)
        # From one visit of a bin to that of another: noise counts once a visit, not once a sample.
        enters = np.append(True, np.diff(place) != 0)
        place, z = place[enters], z[enters]
        begin, end = np.minimum(place[:-1], place[1:]), np.maximum(place[:-1], place[1:])
        rise = np.abs(np.diff(z)) / np.maximum(end - begin, 1)
        passes, moved = np.zeros(bins + 1), np.zeros(bins + 1)
        for total, each in ((passes, 1.0), (moved, rise)):
            np.add.at(total, begin, each)
            np.add.at(total, end, -each)
        passes, moved = np.cumsum(passes)[:-1], np.cumsum(moved)[:-1]
        density = np.where(passes > 0.5, moved / np.maximum(passes, 1.0), 0.0)
        share = 0.9 * density / max(density.sum(), np.finfo(float).tiny) + 0.1 / bins
        course = np.append(0.0, np.cumsum(share))
        quantiles = (np.arange(levels) + 0.5) / levels * course[-1]
        placed: np.ndarray = cast(Any, np).interp(quantiles, course, edges)
        return cls(levels, low, high, placed)

    @property
    def cells(self) -> int:
        """L = N(N+1)/2, the number of hysterons."""
        return self.levels * (self.levels + 1) // 2

    @property
    def delta_x(self) -> float:
        """δx = (high - low)/N, the (mean) width of a cell in the unit of the input."""
        return (self.high - self.low) / self.levels

    @property
    def thresholds(self) -> Any:
        """(levels,) thresholds, ascending, in the unit of the input; JAX's if they are traced."""
        if self.own_thresholds is not None:
            return self.own_thresholds
        return self.low + (np.arange(self.levels) + 0.5) * self.delta_x

    @property
    def alpha_index(self) -> np.ndarray:
        """(cells,) index of each cell's α in `thresholds`."""
        return np.tril_indices(self.levels)[0]

    @property
    def beta_index(self) -> np.ndarray:
        """(cells,) index of each cell's β in `thresholds`."""
        return np.tril_indices(self.levels)[1]

    @property
    def alpha(self) -> Any:
        """(cells,) upper threshold α of each hysteron, in the unit of the input."""
        return self.thresholds[self.alpha_index]

    @property
    def beta(self) -> Any:
        """(cells,) lower threshold β of each hysteron, in the unit of the input."""
        return self.thresholds[self.beta_index]

    @property
    def edges(self) -> np.ndarray:
        """(levels + 1,) borders of the cells of an axis, midway between thresholds in position."""
        return np.asarray(input_at(self, np.arange(self.levels + 1.0)))

    @property
    def areas(self) -> np.ndarray:
        """(cells,) area of each cell: a density is a weight over it."""
        widths = np.diff(self.edges)
        return widths[self.alpha_index] * widths[self.beta_index]

    def scaled(self, high: float = 1.0) -> Plane:
        """Give the same plane from 0 to another upper limit.

        Arguments:
            high: the upper limit, above 0.

        Returns:
            The plane, with its thresholds where they lie.

        Example:
            >>> Plane(levels=2, low=0.0, high=4.0, thresholds=[1.0, 2.0]).scaled().thresholds
            array([0.25, 0.5 ])
        """
        own = self.own_thresholds
        own = None if own is None else (own - self.low) / (self.high - self.low) * high
        return Plane(self.levels, 0.0, high, own)

    def with_levels(self, levels: int) -> Plane:
        """Give a plane of other levels, whose thresholds lie as densely.

        Arguments:
            levels: how many levels it is to have.

        Returns:
            The plane, over the same range.

        Raises:
            InputError: `levels` is below 2.

        Example:
            >>> Plane(levels=2, low=0.0, high=4.0, thresholds=[1.0, 2.0]).with_levels(4).thresholds
            array([0.5 , 1.25, 1.75, 3.  ])
        """
        if self.own_thresholds is None or levels == self.levels:
            return self if levels == self.levels else Plane(levels, self.low, self.high)
        centres = (np.arange(_levels(levels)) + 0.5) / levels * self.levels
        return Plane(levels, self.low, self.high, input_at(self, centres))

    def padded(self, levels: int) -> Plane:
        """Give the plane more levels that no input reaches.

        Its weights are then the first of those of the larger plane, and planes of several sizes,
        padded to one, can be batched (`jax.tree.map(lambda *each: jnp.stack(each), *planes)`).

        Arguments:
            levels: how many levels it is to have, at least as many as it has.

        Returns:
            The larger plane.

        Raises:
            InputError: it has more levels than that.

        Example:
            >>> Plane(levels=2, low=0.0, high=4.0).padded(3).thresholds.tolist()
            [1.0, 3.0, inf]
        """
        more = levels - self.levels
        if more < 0:
            raise InputError(f"levels is {levels}: give at least {self.levels}, as the plane has")
        thresholds = np.append(self.thresholds, np.full(more, np.inf))
        return Plane(levels, self.low, self.high, thresholds)

    def quantise(self, x: ArrayLike) -> jax.Array:
        """Quantise an input to the level that relays see, by the direction rule (3), (4).

        A rising input (and the first sample) counts the thresholds at or below it, a falling one
        those below it; while the input does not move, the level is kept.

        Arguments:
            x: (time,) input, in the unit of the plane.

        Returns:
            (time,) integers in 0 ... levels, the number of thresholds that the input has reached.

        Raises:
            InputError: `x` is not a row of real numbers.

        Example:
            >>> Plane(levels=3, low=0.0, high=3.0).quantise([0.0, 0.5, 0.5, 1.5, 0.5]).tolist()
            [0, 1, 1, 2, 0]
        """
        x = as_float(x, "the input x")
        if x.ndim != 1:
            raise InputError(f"the input x has the shape {x.shape}: give (time,)")
        previous = jnp.concatenate([x[:1], x[:-1]])
        # The direction of the last movement; rising, if there was none yet.
        moved_at = jax.lax.cummax(jnp.where(x != previous, jnp.arange(x.shape[0]), -1))
        rising = (moved_at < 0) | (x > previous)[moved_at]
        thresholds = jnp.asarray(self.thresholds, x.dtype)
        last, following = jnp.append(-jnp.inf, thresholds), jnp.append(thresholds, jnp.inf)
        last, following = last.astype(x.dtype), following.astype(x.dtype)
        if self.own_thresholds is None:
            # Ten times as quick as a search; what rounding may do to the count is then mended.
            count = jnp.clip(jnp.round(position_on(self, x)), 0, self.levels).astype(jnp.int32)
        else:
            count = jnp.searchsorted(thresholds, x).astype(jnp.int32)
        above, under = following[count], last[count]
        at_or_below = count + (above <= x) - (under > x)
        below = count + (above < x) - (under >= x)
        return jnp.where(rising, at_or_below, below)

    def matrix(self, values: ArrayLike) -> np.ndarray:
        """Lay values of the cells out on the plane.

        Arguments:
            values: (cells,) one value a cell.

        Returns:
            (levels, levels) matrix, row α index, column β index; NaN where α < β.

        Raises:
            InputError: `values` does not have one value a cell.

        Example:
            >>> Plane(levels=2, low=0.0, high=1.0).matrix([1.0, 2.0, 3.0])
            array([[ 1., nan],
                   [ 2.,  3.]])
        """
        flat = np.asarray(values, dtype=float)
        if flat.shape != (self.cells,):
            raise InputError(f"values has the shape {flat.shape}: give ({self.cells},), one a cell")
        plane = np.full((self.levels, self.levels), np.nan)
        plane[self.alpha_index, self.beta_index] = flat
        return plane

    def everett(self, weights: ArrayLike, alpha: ArrayLike, beta: ArrayLike) -> jax.Array:
        """Everett function of the plane with ramp hysterons.

        E(α, β) = (f_α - f_αβ)/2 (Mayergoyz), half the fall of the output (6) when the input comes
        from low, turns at α and goes back to β. As states are 0 and 1 here, that is half the weight
        of the hysterons switched on the way back: Σ R max(ρ_i(α) - ρ_j(β), 0)/2.

        Arguments:
            weights: (cells,) weights R, in the unit of the output.
            alpha: turning points, in the unit of the input, any shape.
            beta: end points, in the unit of the input, a shape that broadcasts with `alpha`.

        Returns:
            E in the unit of the output, in the common shape of `alpha` and `beta`; 0 where α ≤ β.

        Raises:
            InputError: `weights` does not have one value a cell.

        Example:
            >>> float(Plane(levels=2, low=0.0, high=2.0).everett([1.0, 2.0, 4.0], 2.0, 0.0))
            3.5
        """
        weights, alpha, beta = (
            as_float(values, name)
            for values, name in ((weights, "weights"), (alpha, "alpha"), (beta, "beta"))
        )
        if weights.shape != (self.cells,):
            raise InputError(
                f"weights has the shape {weights.shape}: give ({self.cells},), one a cell"
            )
        dtype = jnp.result_type(weights, alpha, beta)
        shape = np.broadcast_shapes(alpha.shape, beta.shape)

        def one(turn: jax.Array, end: jax.Array) -> jax.Array:
            at_turn = thresholds_reached(self, turn, turn, "ramp")[0]
            at_end = thresholds_reached(self, end, end, "ramp")[1]
            return jnp.sum(weights * jnp.maximum(at_turn - at_end, 0.0)) / 2

        turns = jnp.broadcast_to(alpha, shape).ravel().astype(dtype)
        ends = jnp.broadcast_to(beta, shape).ravel().astype(dtype)
        return jax.vmap(one)(turns, ends).reshape(shape)

    def initial_states(self, kind: str, x0: ArrayLike, hysteron: str = "ramp") -> jax.Array:
        """States of the hysterons at the first sample, from a named initial memory.

        "low" is saturated low (all off), "high" saturated high (all on), "demagnetised" what an
        input decaying about the centre leaves: on below the line α + β = low + high; on the line,
        ramps are half on and relays off. The hysterons that the input forces at x0 are then set by
        rule (1).

        Arguments:
            kind: "low", "high" or "demagnetised".
            x0: () input at the first sample, in its unit.
            hysteron: "relay" or "ramp".

        Returns:
            (cells,) states in [0, 1].

        Raises:
            InputError: `kind` or `hysteron` is unknown.

        Example:
            >>> Plane(levels=2, low=0.0, high=2.0).initial_states("demagnetised", 1.0).tolist()
            [1.0, 0.5, 0.0]
        """
        require_hysteron(hysteron)
        _require_memory(kind)
        x0 = as_float(x0, "x0")
        if kind == "low":
            states = np.zeros(self.cells)
        elif kind == "high":
            states = np.ones(self.cells)
        else:
            # α + β against low + high, in whole cells: exact.
            beyond = self.alpha_index + self.beta_index + 1 - self.levels
            on_the_line = 0.5 if hysteron == "ramp" else 0.0
            states = np.where(beyond == 0, on_the_line, beyond < 0)
        if any(isinstance(leaf, Tracer) for leaf in jax.tree.leaves((self, x0))):
            return hysteron_step(self, jnp.asarray(states, x0.dtype), x0, x0, hysteron)
        known: Any = np.asarray(x0)[()]  # nothing is compiled for what is known
        start: Any = np.asarray(states, known.dtype)
        return jax.device_put(hysteron_step(self, start, known, known, hysteron))

    def initial_turns(self, kind: str, hysteron: str = "ramp") -> np.ndarray:
        """Turning points that leave a named initial memory behind, see `initial_states`.

        Arguments:
            kind: "low", "high" or "demagnetised".
            hysteron: "relay" or "ramp".

        Returns:
            (turns,) positions (x - low)/δx in 0 ... levels, the first one 0; whole for relays.

        Raises:
            InputError: `kind` or `hysteron` is unknown.

        Example:
            >>> Plane(levels=3, low=0.0, high=3.0).initial_turns("demagnetised").tolist()
            [0.0, 3.0, 0.5, 2.0, 1.5]
        """
        require_hysteron(hysteron)
        _require_memory(kind)
        highs = self.levels - np.arange(self.levels, dtype=float)
        lows = np.arange(self.levels) + (0.5 if hysteron == "ramp" else 0.0)
        decaying = np.stack([highs, lows], axis=1).ravel()
        kept = {"low": 0, "high": 1, "demagnetised": self.levels + 1}[kind]
        return np.append(0.0, decaying[:kept])


def position_on(plane: Plane, x: Any) -> Any:
    """Position of an input on an axis of the plane, 0 to levels: (x - low)/δx for equal cells.

    Between thresholds of one's own it is linear: i + 1/2 at threshold i, 0 at low and the number of
    thresholds that there are at high.

    It is exactly 0 at low and exactly `levels` at high, of the kind, type and shape of `x`, a
    floating array of JAX or NumPy.
    """
    if plane.own_thresholds is None:
        low, high = x.dtype.type(plane.low), x.dtype.type(plane.high)
        return (x - low) / (high - low) * plane.levels
    xp, knots, places = _knots(plane, x)
    return xp.interp(x, knots, places).astype(x.dtype)


def input_at(plane: Plane, position: Any) -> Any:
    """Input at a position on an axis of the plane, 0 to levels: the inverse of `position_on`."""
    if plane.own_thresholds is None:
        return plane.low + plane.delta_x * position
    xp, knots, places = _knots(plane, position)
    return xp.interp(position, places, knots).astype(position.dtype)


def _knots(plane: Plane, like: Any) -> tuple[Any, Any, Any]:
    """NumPy or JAX, and (levels + 2,) inputs and the positions at them, between which it is linear.

    They are the lower limit, the thresholds that there are, and the upper limit.
    """
    own, dtype = plane.own_thresholds, like.dtype
    xp = namespace_of(like, own)
    own = xp.asarray(own, dtype)
    used, number = xp.sum(xp.isfinite(own)), xp.arange(plane.levels + 2)
    knots = xp.concatenate([xp.full(1, plane.low, dtype), own, xp.full(1, np.inf, dtype)])
    knots = xp.where(number == used + 1, plane.high, knots)
    return xp, knots.astype(dtype), xp.clip(number - 0.5, 0.0, used).astype(dtype)


def thresholds_reached(plane: Plane, previous: Any, x: Any, hysteron: str) -> tuple[Any, Any]:
    """Tell how far the input has reached each hysteron's two thresholds.

    Relay: χ(x - α) and χ(x - β) of (3), (4) in 0/1 form. A rising input reaches a threshold on
    which it rests exactly (3), a falling one has left it (4). An input that does not move decides
    nothing at equality, so that the state is kept there; by rule (1), so it is at the first sample.

    Ramp: ρ_i(x) = clip((x - low)/δx - i, 0, 1), a ramp of width δx centred on threshold i.

    `previous` is the input one sample before, and `x` itself at the first sample. The result is
    `(on_alpha, on_beta)`, (cells,) each, in [0, 1], of NumPy if `x` is.
    """
    xp: Any = np if isinstance(x, np.generic) else jnp
    if hysteron == "ramp":
        position = position_on(plane, x)
        on_alpha = xp.clip(position - xp.asarray(plane.alpha_index, x.dtype), 0.0, 1.0)
        on_beta = xp.clip(position - xp.asarray(plane.beta_index, x.dtype), 0.0, 1.0)
        return on_alpha, on_beta
    alpha, beta = xp.asarray(plane.alpha, x.dtype), xp.asarray(plane.beta, x.dtype)
    on_alpha = xp.where(x > previous, x >= alpha, x > alpha)
    on_beta = xp.where(x < previous, x > beta, x >= beta)
    return on_alpha.astype(x.dtype), on_beta.astype(x.dtype)


def hysteron_step(
    plane: Plane, states: jax.Array, previous: jax.Array, x: jax.Array, hysteron: str = "ramp"
) -> jax.Array:
    """Advance all hysterons by one sample of the input.

    Eq. (2) in 0/1 form, y(k) = min(on_β, max(y(k-1), on_α)), for relays and ramps alike.

    Arguments:
        plane: the Preisach plane.
        states: (cells,) states y(k-1) in [0, 1].
        previous: () input x(k-1), in the unit of the plane; pass x(k) at the first sample, so that
            only the hysterons whose state x(k) forces are changed, rule (1).
        x: () input x(k), same unit.
        hysteron: "relay" or "ramp".

    Returns:
        (cells,) states y(k) in [0, 1].

    Example:
        >>> import jax.numpy as jnp
        >>> plane = Plane(levels=2, low=0.0, high=2.0)
        >>> hysteron_step(plane, jnp.zeros(3), jnp.asarray(0.0), jnp.asarray(1.25)).tolist()
        [1.0, 0.25, 0.25]
    """
    on_alpha, on_beta = thresholds_reached(plane, previous, x, hysteron)
    xp = namespace_of(states, on_beta)
    return xp.minimum(on_beta, xp.maximum(states, on_alpha))


def namespace_of(*arrays: Any) -> Any:
    """NumPy where all arrays are its own, else JAX."""
    return np if all(isinstance(array, np.ndarray | np.generic) for array in arrays) else jnp


def flat_index(alpha_index: ArrayLike, beta_index: ArrayLike) -> jax.Array:
    """Flat index i(i+1)/2 + j of a cell."""
    i = jnp.asarray(alpha_index)
    return i * (i + 1) // 2 + jnp.asarray(beta_index)


def laid_out(plane: Plane, values: ArrayLike) -> jax.Array:
    """(levels, levels) matrix of (cells,) values, row α index, column β index; 0 where α < β."""
    values = jnp.asarray(values)
    matrix = jnp.zeros((plane.levels, plane.levels), values.dtype)
    return matrix.at[plane.alpha_index, plane.beta_index].set(values)
