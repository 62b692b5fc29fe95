"""The FORC diagram shows the mixed second derivative of simulated reversal curves, and its mass."""

import jax
import numpy as np
import pytest
from stand_ins import make_model

import preisach_jax as pj
from preisach_jax import plot


def model_of(weights, plane, units=("counts", "counts"), visited=None):
    """What the diagram reads of a model with known weights."""
    model = make_model(levels=plane.levels, visited=visited)
    model.plane, model.weights = plane, weights
    model.units = dict(zip(("input", "output"), units, strict=True))
    model.visited = np.ones(plane.cells, bool) if visited is None else visited
    return model


def drawn(figure):
    """Densities of the cells that are drawn, and the middle and the area of each."""
    mesh = figure.axes[0].collections[0]
    values = np.ma.filled(mesh.get_array(), np.nan)
    corners = np.asarray(mesh.get_coordinates())
    x, y = corners[..., 0], corners[..., 1]
    middle = [(c[:-1, :-1] + c[1:, :-1] + c[:-1, 1:] + c[1:, 1:]) / 4 for c in (x, y)]
    along, across = corners[1:, :-1] - corners[:-1, :-1], corners[:-1, 1:] - corners[:-1, :-1]
    area = np.abs(along[..., 0] * across[..., 1] - along[..., 1] * across[..., 0])
    there = ~np.isnan(values)
    return values[there], middle[0][there], middle[1][there], area[there]


def simulated_curves(plane, weights):
    """Output M(Ha, Hb) of reversal curves played on relays, at the borders of cells."""
    edges = plane.low + plane.delta_x * np.arange(plane.levels + 1)
    moments = np.full((plane.levels + 1, plane.levels + 1), np.nan)
    for a, turn in enumerate(edges):
        # It rests at first, so that all paths have one length, and are compiled once.
        path = np.concatenate([[plane.low] * (a + 1), [plane.high, turn], edges[a + 1 :]])
        with jax.enable_x64(True):
            output = np.asarray(pj.simulate(plane, weights, path, hysteron="relay"))
        moments[a, a:] = output[a + 2 :]
    return moments


def test_it_is_the_mixed_second_derivative_of_reversal_curves():
    plane = pj.Plane(levels=9, low=-40.0, high=50.0)
    weights = np.random.default_rng(1).uniform(0.1, 2.0, plane.cells)
    moments = simulated_curves(plane, weights)
    mixed = np.diff(np.diff(moments, axis=0), axis=1) / plane.delta_x**2  # [Ha, Hb]
    values, coercive, bias, _ = drawn(plot.forc_diagram(model_of(weights, plane)))
    assert values.size == plane.cells - plane.levels  # all but the diagonal
    b, a = np.rint((np.stack([bias + coercive, bias - coercive]) - plane.low) / 10 - 0.5).astype(
        int
    )
    np.testing.assert_allclose(values, -0.5 * mixed[a, b], rtol=1e-9)


def test_its_mass_is_the_sum_of_the_weights_that_it_shows():
    plane = pj.Plane(levels=12, low=-0.3, high=0.3)
    weights = np.random.default_rng(2).uniform(size=plane.cells)
    figure = plot.forc_diagram(model_of(weights, plane, units=("T", "counts")))
    values, _, _, area = drawn(figure)
    assert "(mT)" in figure.axes[0].get_xlabel()  # so that the area is in mT²
    off = plane.alpha_index != plane.beta_index
    assert (4 * values * area).sum() == pytest.approx(weights[off].sum(), rel=1e-9)
    share = 100 * weights[~off].sum() / weights.sum()
    labels = [text.get_text() for legend in figure.legends for text in legend.get_texts()]
    assert labels == [f"reversible (Hc = 0), not drawn: {share:.0f} % of the sum"]
