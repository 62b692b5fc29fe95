"""Effects that hold arrays are trained through the model: gradients, laws, mistakes, files."""

import importlib
import re
from dataclasses import replace
from typing import Any, Literal

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import optax
import pytest
from oracles import play

import preisach_jax as pj
from preisach_jax.fit import Schedule
from preisach_jax.fit.stepwise import double_precision, in_reduced_basis, plain_model, with_effect
from preisach_jax.fit.training import VariableProjection, leaves_of, trained, with_leaves
from preisach_jax.identify.problem import VALIDATION, Problem, evaluate

TRAINED = importlib.import_module("preisach_jax.fit.training").TRAINED
LEVELS, SAMPLES, NOISE = 9, 1000, 0.01
ADAM = optax.adam(1e-2)


@eqx.filter_jit
def drawn(key, inputs, width):
    return eqx.nn.MLP(inputs, "scalar", width, 2, jnp.tanh, key=key)


def network(seed, inputs: int | Literal["scalar"] = "scalar", width=8):
    return drawn(jax.random.key(seed), inputs, width)


def rate_of(signal, time):
    """Rate of an input, in parts of 60 V/s."""
    return jnp.asarray(jnp.gradient(signal)) / jnp.asarray(jnp.gradient(time)) / 60


class Warp(pj.InputEffect):
    """An input that moves with its rate."""

    net: eqx.nn.MLP
    name = "warp"

    def __init__(self, seed=0):
        self.net = network(seed)

    def apply(self, signal, time):
        return signal + jax.vmap(self.net)(rate_of(signal, time)) - self.net(jnp.zeros(()))


class Product(pj.AddedEffect):
    """What is added as a function of place and rate."""

    net: eqx.nn.MLP
    name = "product"

    def __init__(self, seed=0):
        self.net = network(seed, inputs=2, width=12)

    def coefficients(self):
        return (pj.coefficient("amount", "{z}"),)

    def columns(self, signals):
        rate = rate_of(signals.input, signals.time)
        return jax.vmap(self.net)(jnp.stack([(signals.input - 5) / 5, rate], axis=1))[:, None]


def played(seed=9):
    """Moves of many heights and speeds: time and input."""
    rng = np.random.default_rng(seed)
    time = np.arange(SAMPLES) / 250
    turns = np.where(np.arange(50) % 2, 1, -1) * rng.uniform(1, 5, 50)
    corners = np.cumsum(10 ** rng.uniform(-1.3, -0.3, 50))
    return time, 5 + np.interp(time, (corners - corners[0]) * time[-1] / np.ptp(corners), turns)


def through_play(u, radius=0.5):
    return u + 0.4 * play(u, radius)


def recorded(law: Any = 0.0):
    time, u = played()
    output = through_play(u) + law + NOISE * np.random.default_rng(5).normal(size=SAMPLES)
    return pj.Record.from_arrays(time, u, output, units={"input": "V", "output": "um"})


def rated():
    time, u = played()
    return np.gradient(u, time) / 60


@pytest.fixture(scope="module")
def hidden():
    """A record that hides a product that no library of terms has, and (time,) that product."""
    law = 0.15 * np.sin(1.2 * (played()[1] - 5)) * rated()
    return recorded(law), law


@pytest.fixture(scope="module")
def fitted(hidden):
    return pj.fit(hidden[0], [Product()], LEVELS, optimiser=ADAM, training_steps=800)


@pytest.mark.parametrize("kind", [Warp, Product])
def test_the_gradient_is_that_of_the_objective_with_the_density_solved_for(kind):
    record = recorded()
    with double_precision():
        effect = jax.tree.map(lambda x: x.astype(float) if eqx.is_array(x) else x, kind(1))
        _, problem, point = plain_model(record, LEVELS)
        problem, point = in_reduced_basis(problem, point)
        point = with_effect(problem, point, effect)
        point = evaluate(problem, point.chain, point.values, point.strength, point, TRAINED)
        leaves = leaves_of(point.chain.effects)
        projection = VariableProjection.of(problem, point, tuple(leaves))
        before = projection.output(leaves)
        gradient = jax.jit(jax.grad(lambda now: jnp.mean(projection.projected(now, before) ** 2)))
        flat, tree = jax.tree.flatten(leaves)
        found = [np.asarray(each) for each in jax.tree.leaves(gradient(leaves))]

        def objective(array, place, step):
            moved = [np.array(each) for each in flat]
            moved[array][place] += step
            effects = with_leaves(point.chain.effects, jax.tree.unflatten(tree, moved))
            chain = point.chain.with_effects(effects)
            strength = point.strength
            return evaluate(problem, chain, point.values, strength, point, TRAINED).objective

        largest = max(np.abs(each).max() for each in found)
        for array in (0, 4):
            place = np.unravel_index(np.argmax(np.abs(found[array])), found[array].shape)
            h = 1e-4
            slope = (objective(array, place, h) - objective(array, place, -h)) / (2 * h)
            np.testing.assert_allclose(found[array][place], slope, rtol=5e-3, atol=1e-4 * largest)


def test_a_hidden_product_is_learned_to_near_the_noise(hidden, fitted):
    record, law = hidden
    plain, clean = (pj.fit(each, [Product()], LEVELS) for each in (record, recorded()))
    # Without an optimiser arrays stay as they are.
    assert plain.training is None
    for kept, given in zip(*map(jax.tree.leaves, (plain.model.effects[0], Product())), strict=True):
        np.testing.assert_array_equal(kept, given)
    assert plain.rms_validation > 3 * clean.rms_validation
    assert fitted.rms_validation < 1.6 * clean.rms_validation
    left = record.output - fitted.prediction
    np.testing.assert_allclose(fitted.residual, np.where(fitted.record.measured, left, np.nan))
    assert fitted.effects == ("product",)
    (effect,) = fitted.model.effects
    assert isinstance(effect, Product)
    # The density takes up functions of the input: what is left of them goes with the rate.
    amount = fitted.model.parameters["product"]["amount"].value
    states = np.stack([(record.input - 5) / 5, rated()], axis=1)
    learned = amount * np.asarray(jax.jit(lambda rows: jax.vmap(effect.net)(rows))(states))
    basis = np.polynomial.chebyshev.chebvander(states[:, 0], 9)
    beside, own = (
        each - basis @ np.linalg.lstsq(basis, each, rcond=None)[0] for each in (learned, law)
    )
    assert np.corrcoef(beside, own)[0, 1] > 0.95
    assert fitted.training is not None
    assert 0 < fitted.training.best_step <= fitted.training.steps <= 800
    assert fitted.training.numbers == 12 * 3 + 12 * 13 + 13
    assert "numbers trained" in fitted.summary()


def test_the_rows_held_out_do_not_steer_the_training(hidden):
    record, _ = hidden
    with double_precision():
        problem, chain = Problem.of(record), plain_model(record, LEVELS)[2].chain
        held_out = problem.rows[np.isin(problem.fold, VALIDATION)]
        mixed = record.output.copy()
        # Mean and range of the output, which scale the problem, stay what they are.
        mixed[held_out] = np.random.default_rng(0).permutation(mixed[held_out])
        found = [_trained(Problem.of(replace(record, output=each)), chain) for each in (
            record.output, mixed)]  # fmt: skip
    (first, one), (second, two) = found
    assert first.best_step == second.best_step > 0
    assert first.rms_after == pytest.approx(second.rms_after, rel=1e-9)
    for mine, other in zip(one, two, strict=True):
        np.testing.assert_allclose(mine, other, rtol=1e-6, atol=1e-9)


def _trained(problem, chain):
    """How a training goes, and the arrays at its end, from a prior that is given."""
    effect = jax.tree.map(lambda x: x.astype(float) if eqx.is_array(x) else x, Product())
    chain = chain.with_effects((effect,))
    point = evaluate(problem, chain, {"product": {}}, 1e-4)
    end, training = trained(problem, point, ["product"], Schedule.of(ADAM, 50))
    return training, jax.tree.leaves(leaves_of(end.chain.effects))


def test_a_trained_model_is_saved_and_read(hidden, fitted, tmp_path):
    path = tmp_path / "model.json"
    fitted.save(path)
    again = pj.Model.load(path, effects=[Product(seed=7)])
    record = hidden[0]
    np.testing.assert_array_equal(again.predict(record).output, fitted.model.predict(record).output)

    class Small(Product):
        def __init__(self):
            self.net = network(0, inputs=2, width=5)

    with pytest.raises(pj.InputError, match=r"settings\.net holds arrays of .* pass one of the"):
        pj.Model.load(path, effects=[Small()])
    with pytest.raises(pj.InputError, match="does not know; pass it"):
        pj.Model.load(path)


@pytest.mark.parametrize(
    ("effects", "given", "message"),
    [
        ([Warp()], {"optimiser": 3}, "optimiser is 3: give one of optax"),
        (["creep"], {"optimiser": ADAM}, r"no effect \(effects: creep\) holds a floating array"),
        ([], {"optimiser": ADAM}, r"no effect \(effects: none\)"),
        ([Warp()], {"training_steps": 5}, "nothing is trained without an optimiser"),
        ([Warp()], {"optimiser": ADAM, "training_steps": 0}, "training_steps is 0: give"),
        ([Product()], {"optimiser": optax.sgd(jnp.inf)}, "diverges at step 2, .* not finite; give"),
    ],
)
def test_mistakes_are_named_in_a_line(effects, given, message):
    with pytest.raises(pj.InputError, match=message) as told:
        pj.fit(recorded(), effects, LEVELS, **given)
    assert "\n" not in str(told.value)


def test_what_was_found_before_a_training_diverged_is_kept(hidden):
    steady = [optax.constant_schedule(rate) for rate in (1e-2, jnp.inf)]
    rates = optax.join_schedules(steady, [150])
    found = pj.fit(hidden[0], [Product()], LEVELS, optimiser=optax.adam(rates), training_steps=400)
    training = found.training
    assert training is not None
    assert 0 < training.best_step <= 150
    assert re.search(r"diverges at step 15\d.*what was found at step \d+ is kept", training.ended)
    assert training.rms_after < training.rms_before
    assert np.isfinite(found.prediction).all()
