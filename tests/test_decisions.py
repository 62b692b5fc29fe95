"""The numbers on which decisions turn, at stand-in points where each of them is the last straw."""

from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest
from scipy import signal

from preisach_jax.diagnosis import conclusion, judgement, step, walk
from preisach_jax.diagnosis.budget import (
    Floor,
    by_another_plane,
    discretisation_rms,
    error_budget,
    memory_rms,
    refined_levels,
)
from preisach_jax.diagnosis.evidence import Evidence, innovation_variance
from preisach_jax.diagnosis.judgement import judged
from preisach_jax.diagnosis.noise import noise_rms
from preisach_jax.diagnosis.result import Budget
from preisach_jax.diagnosis.step import Named, Step
from preisach_jax.diagnosis.trial import TOO_SLIGHT, WITHIN_BUDGET, NotFitted, Trial
from preisach_jax.effects.base import Survey
from preisach_jax.effects.creep import Creep
from preisach_jax.effects.drift import Drift
from preisach_jax.effects.hum import Hum
from preisach_jax.effects.log_rate import LogRate
from preisach_jax.effects.moving import Moving
from preisach_jax.effects.rate_dependence import RateDependence
from preisach_jax.effects.viscosity import Viscosity
from preisach_jax.identify.confidence import Certainty

# --- the locks ---


@pytest.mark.parametrize(
    ("gain", "z", "delta_bic", "opens"),
    [
        (0.05, 3.0, 10.0, True),
        (0.0499, 99.0, 99.0, False),
        (0.05, 2.99, 10.0, False),
        (0.05, 3.0, 9.99, False),
        (0.25, 2.0, 10.0, True),
        (0.25, 1.99, 10.0, False),
        (0.2499, 2.99, 10.0, False),
    ],
)
def test_both_locks_open_from_these_numbers_on(gain, z, delta_bic, opens):
    assert (Evidence(gain, z, 24, delta_bic).against == "") == opens


def test_an_error_that_grows_by_more_than_half_is_hopeless():
    def trial(gain):
        sure = Certainty(alone=True, together=True)
        return Trial(Drift(), 0, cast(Any, None), Evidence(gain, 0.0, 24, 0.0), sure)

    assert not trial(-0.5).hopeless
    assert trial(-0.501).hopeless


def echoing(lag):
    """White noise of variance 1 and 0.9 of the value that many samples before."""
    white = np.random.default_rng(3).normal(size=40_000)
    return np.asarray(signal.lfilter([1.0], [1.0, *np.zeros(lag - 1), -0.9], white))


def test_residuals_are_whitened_by_twenty_lags():
    assert innovation_variance(echoing(20)) == pytest.approx(1.0, rel=0.03)
    # One lag more cannot be foretold: the variance is that of the echoes, 1 / (1 - 0.9²).
    assert innovation_variance(echoing(21)) == pytest.approx(1 / 0.19, rel=0.1)


def test_a_tenth_of_few_rows_is_how_many_lags_they_take():
    half = np.random.default_rng(4).normal(size=15)
    repeated = np.tile(np.append(half, -half), 6)  # each value is minus the one 15 samples before
    assert innovation_variance(repeated[:150]) < 1e-20  # 15 lags
    assert innovation_variance(repeated[:149]) > 1e-6  # 14


# --- the error budget ---


@pytest.mark.parametrize(
    ("noise", "grid", "memory", "unexplained", "met"),
    [
        (3.0, 4.0, 0.0, 5.0, True),
        (3.0, 4.0, 0.0, 5.001, False),
        (1.0, 0.0, 0.0, 1.0, True),
        (1.0, 0.0, 0.0, 1.001, False),
        (0.0, 1.0, 0.0, 1.0, True),
        (0.0, 1.0, 0.0, 1.001, False),
        # Memory counts in full up to noise (9 + 16 + 9 = 34), and no further.
        (3.0, 4.0, 2.0, 5.385, True),
        (3.0, 4.0, 2.0, 5.386, False),
        (3.0, 4.0, 99.0, 5.830, True),
        (3.0, 4.0, 99.0, 5.831, False),
        (0.0, 4.0, 99.0, 4.001, False),
    ],
)
def test_a_budget_is_met_up_to_what_its_shares_allow(noise, grid, memory, unexplained, met):
    assert Budget(noise, 9.0, 9.0, grid, memory, unexplained, "um").is_met == met


def on_plane(levels, held_out):
    chain = SimpleNamespace(plane=SimpleNamespace(levels=levels))
    return cast(Any, SimpleNamespace(chain=chain, validation_mean_square=held_out))


SOUND = SimpleNamespace(stretches=(), jumps={})  # a record without jumps
UNIT = cast(Any, SimpleNamespace(unit=10.0, record=SOUND))


def test_the_error_of_the_grid_is_held_to_fall_with_the_cell():
    # e² = n² + g² on 20 levels and n² + (g/2)² on 40, so that g² = (9 - 4.5) · 4/3 = 6.
    fine = by_another_plane(UNIT, on_plane(20, 9.0), on_plane(40, 4.5))
    assert fine == pytest.approx(10 * np.sqrt(6.0))
    # On 10 levels n² + (2g)²: g² = (18 - 9) / 3.
    coarse = by_another_plane(UNIT, on_plane(20, 9.0), on_plane(10, 18.0))
    assert coarse == pytest.approx(10 * np.sqrt(3.0))


def test_the_grid_of_relays_falls_with_the_root_of_the_cell_where_it_comes_back():
    now, finer = on_plane(20, 9.0), on_plane(40, 4.5)  # 10 sqrt(6) = 24.5 by the cell
    # n² + g² = 9 and n² + g²/2 = 4.5, so that g² = 9.
    assert discretisation_rms(UNIT, now, finer, 20.0) == pytest.approx(31.6, rel=0.01)
    assert discretisation_rms(UNIT, now, finer, 16.0) == pytest.approx(24.5, rel=0.01)
    assert discretisation_rms(UNIT, now, finer, 3.0) == pytest.approx(18.0)
    assert discretisation_rms(UNIT, now, finer, None) == pytest.approx(24.5, rel=0.01)
    # Jumps in a cell: n steps of variance 1 each; lines fitted by NumPy leave 1/15 of n, means 1/6.
    walks = np.cumsum(np.random.default_rng(1).normal(size=(4000, 200)), axis=1)
    x = np.arange(200.0)
    lines = np.polynomial.polynomial.polyval(x, np.polynomial.polynomial.polyfit(x, walks.T, 1))
    ratio = np.mean(np.var(walks, axis=1)) / np.mean((walks - lines) ** 2)
    assert discretisation_rms(UNIT, now, on_plane(40, 9.0), 2.0) == pytest.approx(
        2.0 * np.sqrt(ratio), rel=0.05
    )


def test_the_grid_is_no_more_than_the_whole_and_no_less_than_nothing():
    assert by_another_plane(UNIT, on_plane(20, 9.0), on_plane(40, 0.0)) == pytest.approx(30.0)
    assert by_another_plane(UNIT, on_plane(20, 9.0), on_plane(40, 9.1)) == 0.0


def test_planes_are_refined_up_to_these_numbers():
    assert refined_levels(10_000, 24) == 36  # by half
    assert refined_levels(10_000, 40) == 50
    assert refined_levels(10_000, 50) is None
    # 36 levels have 666 cells, and 3e10 / 666² is 67,635.
    assert refined_levels(67_000, 24) == 36
    assert refined_levels(68_000, 24) is None


def resting(rows_a_rest, rests=12, ringing=50, noise=1e-3, seed=0):
    """A problem whose input rests, and a residual that rings for so many samples of each rest."""
    rng = np.random.default_rng(seed)
    rows = rows_a_rest * rests
    # Levels at random: of a drive that repeats itself, noise is not read at its rests.
    stairs = np.repeat(np.random.default_rng(9).uniform(0.0, 10.0, rests), rows_a_rest)
    course = np.concatenate([[5.0], stairs])  # the first stretch, of one sample, does not count
    residual = np.convolve(rng.normal(size=rows + 4), np.ones(4) / 2, "valid")[: rows + 1] * noise
    since = np.append(0, np.arange(rows) % rows_a_rest)
    residual[since < ringing] += 10.0
    record = SimpleNamespace(time=np.arange(rows + 1) * 1e-3, input=course, starts=())
    index = np.arange(rows + 1)
    problem = SimpleNamespace(
        record=record,
        rows=index,
        in_time=index,
        unit=1.0,
        target=rng.normal(size=rows + 1),
        breaks=(),
    )
    return cast(Any, problem), cast(Any, SimpleNamespace(residual=residual))


def test_the_fifty_samples_after_a_move_are_no_noise():
    noise = 1e-3  # of a longer memory: second differences alone show less than 0.8 of it
    assert noise_rms(*resting(150, noise=noise)) == pytest.approx(noise, rel=0.15)
    assert noise_rms(*resting(150, ringing=51, noise=noise)) > 0.5
    # A rest of one sample less holds no hundred samples after those fifty.
    assert noise_rms(*resting(149, noise=noise)) < 0.8 * noise


def test_ten_stretches_of_rest_tell_of_noise_and_nine_do_not():
    assert noise_rms(*resting(150, rests=10)) == pytest.approx(1e-3, rel=0.15)
    assert noise_rms(*resting(150, rests=9)) < 0.8e-3


def test_white_noise_is_read_from_second_differences():
    problem, point = resting(20, rests=2000, ringing=0)
    white = np.random.default_rng(5).normal(0, 0.3, len(problem.target))
    point.residual = white + 2.0 * np.arange(len(white)) / len(white)
    assert noise_rms(problem, point) == pytest.approx(0.3, rel=0.02)


def test_shares_are_taken_in_their_order_from_what_is_left(monkeypatch):
    budget = "preisach_jax.diagnosis.budget."
    monkeypatch.setattr(budget + "input_quantisation_rms", lambda problem, point: 7.0)
    monkeypatch.setattr(budget + "output_quantisation_rms", lambda problem: 8.0)
    channels = {"output": SimpleNamespace(unit="um")}
    problem = cast(
        Any, SimpleNamespace(record=SimpleNamespace(channels=channels, stretches=(), jumps={}))
    )
    fit = cast(Any, SimpleNamespace(rms_validation=13.0, point=None))

    def found(memory):
        return error_budget(problem, fit, Floor(noise=3.0, memory=memory), 4.0)

    # 13² = 3² + 4² + 12², and nothing is left.
    assert found(12.0) == Budget(3.0, 7.0, 8.0, 4.0, 12.0, 0.0, "um")
    assert found(99.0).memory == pytest.approx(12.0)  # more than is left
    assert found(0.0).unexplained == pytest.approx(12.0)


def test_memory_is_the_fall_of_the_held_out_mean_square(monkeypatch):
    told = SimpleNamespace(residual=np.array([9.0, 9.0, 3.0, 3.0]))
    monkeypatch.setattr("preisach_jax.diagnosis.budget.with_all_rows", lambda point: told)
    problem = cast(Any, SimpleNamespace(fold=np.array([0, 1, 3, 3]), unit=2.0))
    assert memory_rms(problem, on_plane(5, 25.0)) == pytest.approx(2 * 4.0)
    assert memory_rms(problem, on_plane(5, 4.0)) == 0.0


# --- what speaks against a weak effect ---

STRONG = Evidence(0.95, 9.0, 24, 999.0)
CLOSED = Evidence(0.0, 0.0, 24, 0.0)


def stand_in(name, held_out, strength=1e-3, levels=20, effects=()):
    return cast(
        Any,
        SimpleNamespace(
            name=name,
            validation_mean_square=held_out,
            strength=strength,
            chain=SimpleNamespace(plane=SimpleNamespace(levels=levels), effects=effects),
            values={},
        ),
    )


@pytest.fixture
def judging(monkeypatch):
    """`judged` with models that are not fitted: how it compares them, and what it was asked."""

    class Judging:
        def __init__(self):
            self.plain = stand_in("plain", 3.0, 1e-2)
            self.contradiction = ""
            self.same_as = set()  # pairs (simple, rich) between which nothing speaks for the rich
            self.compared = []
            self.refined = []

        def compare(self, problem, simple, rich):
            self.compared.append((simple.name, rich.name))
            return CLOSED if (simple.name, rich.name) in self.same_as else STRONG

        def at_levels(self, problem, point, levels):
            self.refined.append((point.name, levels))
            return stand_in(f"{point.name} on {levels}", 0.5, levels=levels)

        def evaluate(self, problem, chain, values, strength, like):
            assert strength == 1e-2
            return self.plain

        def judge(self, effect=None, gain=0.5, strength=1e-2, levels=20, held_out=2.0, present=()):
            now = stand_in("now", 4.0, 1e-3, levels, present)
            rich = stand_in("rich", held_out, strength, levels)
            sure = Certainty(alone=True, together=True)
            trial = Trial(effect or Drift(), 0, rich, Evidence(gain, 9.0, 24, 999.0), sure)
            trials, best, after = judged(UNIT, now, [trial], lambda text: None)
            (told,) = trials
            assert not isinstance(told, NotFitted)
            named: Any = (best and best.point, after)
            return told.objection, *(each and each.name for each in named)

    one = Judging()
    monkeypatch.setattr(judgement, "implausible", lambda problem, point, name: one.contradiction)
    monkeypatch.setattr(judgement, "compare", one.compare)
    monkeypatch.setattr(judgement, "at_levels", one.at_levels)
    monkeypatch.setattr(judgement, "evaluate", one.evaluate)
    monkeypatch.setattr(judgement, "refine", lambda problem, point, iterations: point)
    monkeypatch.setattr(judgement, "free_parameters", lambda point: 1)
    return one


BY_THE_PRIOR = "with the same smoothness of the density, the model is as good without it"
BY_THE_GRID = "not confirmed on a finer plane; it only compensates discretisation"


def test_an_effect_whose_parameters_contradict_it_is_refused_whatever_it_gains(judging):
    judging.contradiction = "its f_hz lies at the lower bound of the search"
    assert judging.judge(gain=0.99) == (judging.contradiction, None, "now")
    assert judging.compared == judging.refined == []


def test_a_second_effect_that_goes_with_speed_must_halve_the_mean_square(judging):
    first = (RateDependence(),)
    objection, named, _ = judging.judge(Viscosity(), gain=0.499, present=first)
    assert objection.startswith("it depends on the speed, as rate_dependence does")
    assert named is None
    assert judging.judge(Viscosity(), gain=0.5, present=first)[1] == "rich"
    assert judging.judge(Viscosity(), gain=0.1)[1] == "rich"
    assert judging.judge(Drift(), gain=0.1, present=first)[1] == "rich"


@pytest.mark.parametrize("alike", [True, False])
def test_a_common_effect_leads_before_a_special_one_that_is_no_better(judging, alike):
    judging.same_as = {("common", "special")} if alike else set()
    sure = Certainty(alone=True, together=True)
    trials = [
        Trial(effect, 0, stand_in(name, error, 1e-3), Evidence(0.5, 9.0, 24, 999.0), sure)
        for effect, name, error in (
            (LogRate(), "special", 2.0), (RateDependence(), "common", 2.1),
        )
    ]  # fmt: skip
    _, best, _ = judged(UNIT, stand_in("now", 4.0, 1e-3), trials, lambda text: None)
    assert best is not None
    assert best.effect.name == ("rate_dependence" if alike else "log_rate")


def test_an_effect_that_does_no_more_than_its_smoothness_is_refused_and_that_is_kept(judging):
    judging.same_as = {("plain", "rich")}
    assert judging.judge() == (BY_THE_PRIOR, None, "plain")
    assert judging.compared == [("plain", "rich")]


def test_an_effect_that_does_more_than_its_smoothness_stays(judging):
    assert judging.judge() == ("", "rich", "now")
    assert judging.compared[0] == ("plain", "rich")


def test_a_smoothness_that_does_worse_alone_is_not_taken_over(judging):
    judging.plain = stand_in("plain", 4.5, 1e-2)
    judging.same_as = {("now", "rich")}
    assert judging.judge() == (BY_THE_PRIOR, None, "now")


def test_the_smoothness_is_not_asked_where_it_is_the_same(judging):
    assert judging.judge(strength=1e-3) == ("", "rich", "now")
    assert judging.compared[0] == ("now", "rich")


def test_what_takes_nine_tenths_away_need_not_stand_on_a_finer_plane(judging):
    judging.same_as = {("plain", "rich"), ("now on 30", "rich on 30")}
    assert judging.judge(gain=0.9) == ("", "rich", "now")
    assert judging.compared == judging.refined == []
    assert judging.judge(gain=0.899)[0] == BY_THE_PRIOR


def test_what_does_nothing_on_a_finer_plane_made_up_for_the_grid(judging):
    judging.same_as = {("now on 30", "rich on 30")}
    assert judging.judge() == (BY_THE_GRID, None, "now")
    assert judging.refined == [("now", 30), ("rich", 30)]


def test_no_plane_is_finer_than_fifty_levels_where_effects_are_confirmed(judging):
    judging.same_as = {("now on 50", "rich on 50")}
    assert judging.judge(levels=40)[0] == BY_THE_GRID
    judging.refined.clear()
    assert judging.judge(levels=50) == ("", "rich", "now")
    assert judging.refined == []


def test_what_bends_the_loop_must_do_more_than_all_of_the_grid(judging):
    # On 30 levels 0.5 is left of 4.0: the grid makes 3.5 / (1 - 4/9) = 6.3 of it, cut to 4.0.
    assert judging.judge(Moving()) == (BY_THE_GRID, None, "now")
    assert judging.judge(Drift()) == ("", "rich", "now")
    assert judging.judge(Creep()) == ("", "rich", "now")


# --- a drift without a law ---


def zero_that_moves(amplitudes, rows=2000):
    """A sum of waves {k: a}, of which half periods cos(π k t / T) fit into the record."""
    time = np.linspace(0.0, 10.0, rows)
    course = sum(a * np.cos(np.pi * k * time / 10.0) for k, a in amplitudes.items())
    return Survey(10.0, 10.0 / (rows - 1), time, time, time, np.asarray(course))


@pytest.mark.parametrize(
    ("amplitudes", "waves"),
    [
        # Waves beyond the 48th stay: of squares that sum up to 100, so many are left.
        ({3: np.sqrt(51), 60: 7.0}, [0, 6]),
        ({3: 7.0, 60: np.sqrt(51)}, [0]),
        ({6: np.sqrt(51), 60: 7.0}, [0, 6]),
        ({7: np.sqrt(51), 60: 7.0}, [0, 12]),
        ({48: np.sqrt(51), 60: 7.0}, [0, 48]),
        ({49: np.sqrt(51), 60: 7.0}, [0]),
        # Six waves leave 40, of which twelve must take half.
        ({3: np.sqrt(60), 9: np.sqrt(21), 60: np.sqrt(19)}, [0, 12]),
        ({3: np.sqrt(60), 9: np.sqrt(19), 60: np.sqrt(21)}, [0, 6]),
    ],
)
def test_a_wander_needs_waves_that_take_half_of_what_fewer_leave(x64, amplitudes, waves):
    variants = Drift().variants(zero_that_moves(amplitudes))
    assert [each.waves for each in variants] == waves


def test_few_rows_hold_no_wander(x64):
    amplitudes = {3: 10.0, 60: 1.0}
    assert [each.waves for each in Drift().variants(zero_that_moves(amplitudes, 480))] == [0, 6]
    assert [each.waves for each in Drift().variants(zero_that_moves(amplitudes, 479))] == [0]


def test_a_wander_of_few_waves_is_tried_with_more(x64):
    survey = zero_that_moves({3: 10.0, 60: 1.0})
    more = [Drift(waves=waves).enlarged(survey, {}) for waves in (6, 24, 34, 48)]
    assert [found and found[0].waves for found in more] == [12, 34, 48, None]
    assert Drift().enlarged(survey, {}) is None
    assert Drift(waves=6).enlarged(zero_that_moves({3: 10.0}, 479), {}) is None


# --- what is given up in the end ---


@pytest.mark.parametrize(
    ("unexplained", "tolerance", "given_up"),
    [(3.17, 0.0, True), (3.16, 0.0, False), (3.17, 4.0, False), (0.5, 0.0, False)],
)
def test_a_last_effect_that_takes_less_than_a_fifth_of_the_rest_is_given_up(
    unexplained, tolerance, given_up
):
    trial: Any = Trial(Drift(), 0, cast(Any, None), STRONG, Certainty(True, True))
    last = Step(
        cast(Any, None), UNIT, UNIT, (), path=cast(Any, (0, 1)), named=(Named(trial, {}),),
        trials=((trial, True, "drift"),),
    )  # fmt: skip
    fits: Any = [
        SimpleNamespace(rms_validation=np.sqrt(12)),
        SimpleNamespace(rms_validation=10**0.5),
    ]
    budget = Budget(1.0, 0.0, 0.0, 0.0, 0.0, unexplained, "um")
    left = conclusion._without_the_slight(last, budget, fits, tolerance)
    assert (left is not None) == given_up
    if left is not None:
        assert (left.path, left.named) == ((0,), ())
        ((given, accepted, _),) = left.trials
        assert not accepted
        assert given.effect == trial.effect
        assert isinstance(given, Trial)
        assert given.objection == TOO_SLIGHT


@pytest.mark.parametrize(("told", "kept"), [({"hum": "it is the drive's"}, ("creep",)), ({}, None)])
def test_a_hum_that_all_rows_show_to_be_the_drives_is_taken_back(monkeypatch, told, kept):
    trials = [
        Trial(effect, 0, cast(Any, None), STRONG, Certainty(alone=True, together=True))
        for effect in (Hum(), Creep())
    ]
    monkeypatch.setattr(Step, "ladder", lambda self, names: (self.path[0], *names))
    asked = Step(
        cast(Any, None), cast(Any, None), cast(Any, None), (),
        path=cast(Any, (0, 1, 2)),
        named=tuple(Named(trial, {}) for trial in trials),
        trials=tuple((trial, True, "") for trial in trials),
    )  # fmt: skip
    final = cast(Any, SimpleNamespace(from_the_drive=told))
    left = conclusion._without_what_the_drive_makes(asked, final)
    assert (left is None) == (kept is None)
    if left is not None:
        assert left.path == (0, *kept)
        assert tuple(named.name for named in left.named) == kept
        (hum, accepted, _), (_, stays, _) = left.trials
        assert isinstance(hum, Trial)
        assert (hum.objection, accepted, stays) == ("it is the drive's", False, True)


# --- steps ---


def at(now, other=None):
    """A step at a stand-in of a model, and the same on another plane."""
    problem = cast(Any, SimpleNamespace(unit=10.0, record=SOUND))
    return Step(cast(Any, range(10_000)), problem, problem, (), path=(now,), other=other)


@pytest.mark.parametrize(("noise_squared", "within"), [(250.1, True), (249.9, False)])
def test_a_model_is_within_its_budget_if_noise_and_grid_explain_half(
    monkeypatch, noise_squared, within
):
    # 900 are held out, and the grid makes 100 · (9 - 7.5) · 4/3 = 200.
    monkeypatch.setattr(step, "noise_rms", lambda problem, now: noise_squared**0.5)
    assert at(on_plane(20, 9.0), on_plane(40, 7.5)).is_within_budget == within


@pytest.mark.parametrize(("held_out", "levels"), [(0.899, 36), (0.9, 24)])
def test_a_finer_plane_is_kept_if_it_takes_more_than_a_tenth_away(monkeypatch, held_out, levels):
    asked = []

    def finer(problem, point, count):
        asked.append(count)
        return on_plane(count, held_out if len(asked) == 1 else 99.0)

    monkeypatch.setattr(step, "at_levels", finer)
    found = step.on_a_refined_plane(at(on_plane(24, 1.0)), False, lambda text: None)
    assert found.now.chain.plane.levels == levels
    assert found.other is not None
    assert found.other.chain.plane.levels == asked[-1]
    assert step.on_a_refined_plane(at(on_plane(24, 1.0)), True, lambda text: None).now.chain == (
        SimpleNamespace(plane=SimpleNamespace(levels=24))
    )


@pytest.mark.parametrize(
    ("effects", "within", "least"), [(0, True, 0.05), (1, True, 0.5), (1, False, 1 / 6)]
)
def test_beside_other_effects_one_more_must_take_a_sixth_and_within_the_budget_half(
    monkeypatch, effects, within, least
):
    asked = []

    def screening(problem, now, left, position, progress, least_gain):
        asked.append(least_gain)
        return SimpleNamespace(left=[], groups=[], rest=(), passed_over=lambda groups: [])

    monkeypatch.setattr(walk, "screened", screening)
    here: Any = SimpleNamespace(
        problem=UNIT, now=stand_in("now", 4.0), position=effects, is_within_budget=within, left=[]
    )
    walk.tried_beside(here, 0.0)
    assert asked == [least]


@pytest.mark.parametrize(("gain", "named"), [(0.499, False), (0.5, True)])
def test_what_takes_less_than_was_asked_is_not_named(judging, gain, named):
    sure = Certainty(alone=True, together=True)
    trial = Trial(Drift(), 0, stand_in("rich", 2.0), Evidence(gain, 9.0, 24, 999.0), sure)
    (told,), best, _ = judged(
        UNIT, stand_in("now", 4.0), [trial], lambda text: None, least_gain=0.5
    )
    assert (best is not None) == named
    assert isinstance(told, Trial)
    assert told.objection == ("" if named else WITHIN_BUDGET)
