"""What a remainder goes with: against an analysis of variance, and with nothing to be found."""

import numpy as np
import pytest
import scipy
from stand_ins import make_diagnosis

import preisach_jax as pj
from preisach_jax.diagnosis.remainder import LEVEL, PARTS, is_related, relations
from preisach_jax.diagnosis.result import NOTABLE
from preisach_jax.report import write_report

TIME = np.arange(6000) / 500


def driven(aux=None):
    """A record of moves of many heights, each at several speeds."""
    rng = np.random.default_rng(4)
    turns = np.where(np.arange(41) % 2, 1, -1) * rng.uniform(2.0, 9.0, 41)
    heights = np.interp(np.arange(40 * 5 + 1) / 5, np.arange(41), turns)
    corners = np.concatenate([[0.0], np.cumsum(10 ** rng.uniform(-2.0, -0.4, 200))])
    values = np.interp(TIME, corners * TIME[-1] / corners[-1], heights)
    units = {"input": "V", "output": "um"} | ({"load": "N"} if aux else {})
    return pj.Record.from_arrays(TIME, values, values, aux=aux, units=units)


def slow_noise(seed, size=1.0):
    """Noise with a memory of some thirty samples."""
    white = np.random.default_rng(seed).normal(size=len(TIME))
    return size * scipy.signal.lfilter([0.2], [1, -0.97], white)


def test_share_of_the_position_is_that_of_an_analysis_of_variance():
    record = driven()
    remainder = 0.3 * np.sin(record.input) + slow_noise(1, 0.1)
    found = {each.quantity: each for each in relations(record, remainder)}["input"]
    order = np.argsort(record.input, kind="stable")
    groups = [remainder[rows] for rows in np.array_split(order, PARTS)]
    f = scipy.stats.f_oneway(*groups).statistic
    between, within = f * (PARTS - 1), len(TIME) - PARTS
    assert found.share == pytest.approx(between / (between + within), rel=0.02)
    assert found.share > 0.5 > found.chance
    assert np.corrcoef(found.mean, np.sin(found.position))[0, 1] > 0.99


@pytest.mark.parametrize(
    ("quantity", "law"),
    [
        ("rate of the input", lambda u, rate: 0.01 * rate),
        ("logarithm of the speed", lambda u, rate: np.sign(rate) * np.log10(np.abs(rate) / 10)),
        ("direction of the input", lambda u, rate: np.sign(rate)),
        ("output", lambda u, rate: 0.02 * u**2),
        ("time", lambda u, rate: TIME**2 / 20),
    ],
)
def test_strongest_relation_is_the_one_that_was_made(quantity, law):
    record = driven()
    rate = np.gradient(record.input, record.time)
    told = [
        each.quantity for each in relations(record, law(record.input, rate) + slow_noise(2, 0.2))
    ]
    # Input and output of this record are one.
    assert told[0] in ((quantity, "input") if quantity == "output" else (quantity,))


def test_column_that_acts_is_named_with_its_unit():
    load = slow_noise(8)
    found = relations(driven({"load": load}), 0.5 * load + slow_noise(3, 0.1))[0]
    assert (found.quantity, found.unit) == ("column load", "N")


def test_ringing_is_told_with_its_frequency():
    record = driven()
    wave = scipy.signal.lsim(([1.0, 0.0], [1.0, 8.0, (2 * np.pi * 60) ** 2]), record.input, TIME)[1]
    found = relations(record, wave + slow_noise(5, 1e-3 * float(np.std(wave))))[0]
    assert found.quantity == "frequency 60 Hz" or abs(float(found.quantity.split()[1]) - 60) < 3
    assert found.share > 0.5
    assert "a resonance that rings" in found.physics
    (known, *_) = relations(record, wave, {"resonance": [58.0]})
    assert "what the resonance that was found leaves" in known.physics


def test_slow_noise_goes_with_nothing():
    record = driven()
    told = [relations(record, slow_noise(seed)) for seed in range(100, 110)]
    # Of nine quantities each exceeds chance in one case of a hundred.
    expected = 10 * 9 * (1 - LEVEL)
    assert sum(map(len, told)) <= expected + 2 * np.sqrt(expected)


def test_noise_of_no_colour_is_related_to_anything():
    record, rng = driven(), np.random.default_rng(0)
    for seed in range(3):
        assert not is_related(record, slow_noise(seed), NOTABLE)
        assert not is_related(record, rng.normal(size=len(TIME)), NOTABLE)


@pytest.mark.parametrize(
    "made",
    [
        lambda record, noise: noise * (1 + np.abs(record.input)),
        lambda record, noise: noise + 2 * np.std(noise) * np.sin(2 * np.pi * 50 * TIME),
        lambda record, noise: noise + np.cumsum(np.where(np.arange(len(TIME)) % 300 == 0, 1.0, 0)),
    ],
    ids=["of the position's size", "at a line", "of jumps"],
)
def test_what_is_no_noise_is_related(made):
    record = driven()
    assert is_related(record, made(record, slow_noise(6)), NOTABLE)


def test_report_tells_and_draws_what_the_remainder_goes_with(tmp_path):
    record = driven()
    assert relations(record, np.zeros(6000)) == relations(record, np.full(6000, np.nan)) == ()
    found = relations(record, 0.01 * np.gradient(record.input, TIME) + slow_noise(2, 0.2))
    diagnosis = make_diagnosis("unexplained", remainder=found)
    assert (tmp_path / "remainder.svg") in write_report(diagnosis, tmp_path)
    page = (tmp_path / "report.html").read_text(encoding="utf-8")
    assert "goes with the rate of the input" in page
    content = diagnosis.to_json()["remainder"]
    assert content[0]["goes_with"] == "rate of the input"
    assert 0 < content[0]["chance"] < content[0]["share"] <= 1
