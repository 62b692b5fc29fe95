"""Rivals of effects that were named, asked again after something beside them has changed."""

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from scipy import signal
from test_modes import plays

import preisach_jax as pj
from preisach_jax.diagnosis import conclusion
from preisach_jax.diagnosis.evidence import compare
from preisach_jax.diagnosis.plausible import implausible
from preisach_jax.diagnosis.step import Named, Step
from preisach_jax.diagnosis.trial import Trial
from preisach_jax.diagnosis.walk import with_better_rivals
from preisach_jax.effects import resolve
from preisach_jax.effects.drift import Drift
from preisach_jax.fit import begun, double_precision, with_effect
from preisach_jax.identify import evaluate
from preisach_jax.identify.confidence import differs_from_nothing

RATE, COUNT = 187.5, 3000
LAG_S, SETTLING_S, SETTLED = 0.04, 4.0, 3.0

OUTPUT_LAG, INPUT_LAG, CREEP, DRIFT = resolve(["output_lag", "input_lag", "creep", "drift"], {})


@pytest.fixture(scope="module", autouse=True)
def in_double_precision():
    with double_precision():
        yield


@pytest.fixture(scope="module")
def plain():
    """The model without effects of a stage with a lag of its input and a drift that settles."""
    rng = np.random.default_rng(8)
    time = np.arange(COUNT) / RATE
    u = np.interp(np.arange(COUNT), np.arange(0, COUNT, 40), rng.uniform(0.0, 10.0, COUNT // 40))
    late = u[0] + signal.lsim(([1.0], [LAG_S, 1.0]), u - u[0], time)[1]
    z = plays(late) + SETTLED * (1 - np.exp(-time / SETTLING_S)) + rng.normal(0, 0.01, COUNT)
    record, problem, point = begun(pj.Record.from_arrays(time, u, z), 9)
    tried = (OUTPUT_LAG, INPUT_LAG, CREEP, DRIFT)
    return Step(record, problem, problem, tried, (point,))


def added(step, effect):
    """The step with one effect more, whatever speaks for it."""
    after = with_effect(step.problem, step.now, effect)
    certain = differs_from_nothing(step.problem, after, effect.name)
    evidence = compare(step.problem, step.now, after)
    trial = Trial(effect, step.position, after, evidence, certain)
    return replace(
        step,
        path=(*step.path, after),
        named=(*step.named, Named(trial, {})),
        trials=(*step.trials, (trial, True, effect.name)),
    )


@pytest.fixture(scope="module")
def lag(plain):
    return added(plain, INPUT_LAG)


@pytest.fixture(scope="module")
def creep(lag):
    return added(lag, CREEP)


@pytest.fixture(scope="module")
def drift(lag):
    return added(lag, DRIFT)


def with_rival(step, rival, point):
    """The step with a rival of its second effect, which was tried where that was added."""
    first, second = step.named
    row = (replace(rival.named[1].trial, point=point), False, second.name)
    named = (first, replace(second, rivals={rival.named[1].name: point}))
    return replace(step, named=named, trials=(*step.trials, row))


def as_waves(plain):
    """A drift without a law beside a lag of the output, whose misfit it takes up."""
    wrong = added(plain, OUTPUT_LAG).now
    waves = Drift(horizon_s=COUNT / RATE, waves=6)
    chain = wrong.chain.with_effects((*wrong.chain.effects, waves))
    return evaluate(plain.problem, chain, {**wrong.values, "drift": {}}, wrong.strength, wrong)


def test_a_rival_is_searched_for_anew_beside_an_effect_that_was_exchanged(plain, creep, drift):
    found = with_better_rivals(with_rival(creep, drift, as_waves(plain)), [1])
    assert [each.name for each in found.named] == ["input_lag", "drift"]
    assert found.now.values["drift"]["tau_s"] == pytest.approx(SETTLING_S, rel=0.05)
    assert found.now.values["input_lag"]["tau_s"] == pytest.approx(LAG_S, rel=0.01)
    assert set(found.named[1].rivals) == {"creep"}


def test_a_creep_may_have_a_past():
    """A stage that creeps by 3 % with each of two time constants, and its state from a past."""
    rng = np.random.default_rng(11)
    before, count = 3760, 3760 + COUNT
    u = np.interp(np.arange(count), np.arange(0, count, 40), rng.uniform(0.0, 10.0, count // 40))
    u[:before] = u[before] + 10.0 * (u[before] < 5.0)  # it comes from a rest far away
    time, h = np.arange(count) / RATE, plays(u)
    z = h + sum(0.03 * signal.lsim(([1.0], [tau, 1.0]), h, time)[1] for tau in (0.5, 5.0))
    z = (z + rng.normal(0, 0.01, count))[before:]
    problem, point = begun(pj.Record.from_arrays(time[:COUNT], u[before:], z), 9)[1:]
    assert implausible(problem, with_effect(problem, point, CREEP), "creep") == ""


def test_a_creep_of_hardly_any_gain_is_no_name_for_a_drift(creep, drift):
    told = implausible(creep.problem, creep.now, "creep")
    assert "is put down to the time before the record" in told
    assert told.endswith("it stands for a drift")
    # Both together make up for each other, which contradicts neither.
    both = added(drift, CREEP)
    assert implausible(both.problem, both.now, "creep") == ""


@pytest.mark.parametrize(
    ("contradicted", "leads"),
    [({"creep"}, "drift"), ({"creep", "drift"}, "creep"), (set(), "creep")],
)
def test_a_rival_stands_for_an_effect_that_all_rows_contradict(creep, drift, contradicted, leads):
    finals: Any = SimpleNamespace(of=lambda *model: SimpleNamespace(contradicted=contradicted))
    step = with_rival(creep, drift, drift.now)
    found = conclusion._with_plausible_rivals(step, finals)
    assert [each.name for each in found.named] == ["input_lag", leads]
    assert set(found.named[1].rivals) == {"creep", "drift"} - {leads}
    assert found.now.chain.effects[1].name == leads
    assert [t.effect.name for t, accepted, _ in found.trials if accepted] == ["input_lag", leads]
