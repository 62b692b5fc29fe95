"""What the adaptive filter and recursive least squares learn from a record.

Replay of a record that was not used, RMS error in % of the output's range: mean of three smooth
stages that are no grid, N = 37, 5000 samples of a Bernoulli ramp at 2 kHz, noise 1 % of the range.

                              relay, no noise   noise    ramp, no noise   noise
    adaptive filter, 1 pass               2.6     2.9               2.3    19.3
    adaptive filter, 5 passes             1.6     2.3               0.9    16.3
    adaptive filter, step 0.2             7.4     7.3               2.6     3.7
    least squares                         1.7     2.0               0.9     1.4

So: the paper's rule for long records and little noise, as it costs O(L) a sample and keeps nothing
but the weights; several passes for a record that is at hand and has little noise; a step size of
about 0.2 for long records with noise, above all with ramps; least squares for short records, noise,
or an output with an unknown constant, as long as (L + 1)² numbers fit (N = 37: 4 MB); with
forgetting where the weights change. Several passes learn the noise by heart.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from jax.typing import ArrayLike

from preisach_jax.errors import InputError
from preisach_jax.filter.adaptive import AdaptiveFilter
from preisach_jax.filter.least_squares import (
    LeastSquaresResult,
    RecursiveLeastSquares,
    require_double,
)
from preisach_jax.filter.state import FilterResult, input_and_output
from preisach_jax.operator.plane import Plane
from preisach_jax.operator.simulation import simulate


class RecursionScore(NamedTuple):
    """What one recursion has learnt from a record.

    Attributes:
        name: the recursion and its setting.
        error: RMS of the error e at events over the last half of the record (of the last pass), in
            parts of the output's range. It is what the output moved since the event before, less
            the model's, for the adaptive filter, and the output less the model's for least squares.
        replay: RMS of the output less the model's with the final weights, over the new record and
            without the mean, in parts of the output's range.
    """

    name: str
    error: float
    replay: float


def compare_recursions(
    plane: Plane,
    x: ArrayLike,
    z: ArrayLike,
    new_x: ArrayLike,
    new_z: ArrayLike,
    hysteron: str = "relay",
    passes: Sequence[int] = (1, 2, 5, 20),
    step_sizes: Sequence[float] = (0.5, 0.2, 0.05),
    forgettings: Sequence[float] = (1.0, 0.999),
) -> tuple[RecursionScore, ...]:
    """Compare what the recursions learn from a record, by replaying another one.

    Both records start from saturated low. The error during a run flatters rules that only explain
    the last few events; the replay shows whether the weights hold everywhere.

    Arguments:
        plane: the Preisach plane.
        x: (time,) input, in the unit of the plane.
        z: (time,) measured output, in its unit.
        new_x: (new time,) input of a record that is not used for learning.
        new_z: (new time,) measured output there, complete.
        hysteron: "relay" or "ramp".
        passes: numbers of passes of the adaptive filter with the step size 1.
        step_sizes: step sizes of the adaptive filter in one pass.
        forgettings: forgetting factors of recursive least squares.

    Returns:
        One row a recursion, in the order of the arguments.

    Raises:
        InputError: a record or a setting cannot be used, or JAX is set to single precision.

    Example:
        >>> import jax, numpy as np
        >>> plane = Plane(levels=4, low=0.0, high=1.0)
        >>> x = np.abs(np.mod(np.linspace(0.0, 9.0, 400), 2.0) - 1.0)
        >>> with jax.enable_x64(True):
        ...     rows = compare_recursions(plane, x, x**2, x[:90], x[:90] ** 2, "ramp", (1, 2))
        >>> [row.name for row in rows][:3]
        ['adaptive filter, 1 pass', 'adaptive filter, 2 passes', 'adaptive filter, step size 0.5']
    """
    require_double()
    new_x, new_z = input_and_output(plane, new_x, new_z)
    spread = float(np.ptp(np.asarray(new_z)))
    if not spread > 0.0:
        raise InputError(f"new_z spans {spread}: give a record, without gaps, that moves")

    def row(name: str, result: FilterResult | LeastSquaresResult) -> RecursionScore:
        late = np.asarray(result.error)[np.shape(x)[0] // 2 :]
        late = late[np.asarray(result.switched)[np.shape(x)[0] // 2 :] > 0]
        left = np.asarray(new_z) - np.asarray(simulate(plane, result.weights, new_x, hysteron))
        return RecursionScore(name, float(np.sqrt(np.mean(late**2))) / spread, left.std() / spread)

    rows: list[RecursionScore] = []
    for count in passes:
        result = AdaptiveFilter(plane, hysteron).run(x, z, passes=count)
        rows.append(row(f"adaptive filter, {count} pass{'es' if count > 1 else ''}", result))
    for step_size in step_sizes:
        result = AdaptiveFilter(plane, hysteron, step_size=step_size).run(x, z)
        rows.append(row(f"adaptive filter, step size {step_size:g}", result))
    for forgetting in forgettings:
        result = RecursiveLeastSquares(plane, hysteron, forgetting).run(x, z)
        rows.append(row(f"least squares, forgetting {forgetting:g}", result))
    return tuple(rows)
