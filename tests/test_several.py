"""Several records fitted together: one model, and a memory, an offset and a drift for each."""

import json

import jax
import numpy as np
import pytest
from blind import hidden
from test_hysteron import slow_ramp

import preisach_jax as pj
from preisach_jax.chain.coefficients import Coefficients
from preisach_jax.chain.description import Chain
from preisach_jax.chain.runs import response, signals_of
from preisach_jax.cli import main
from preisach_jax.diagnosis.noise import innovation_variance
from preisach_jax.effects.creep import Creep
from preisach_jax.identify.problem import Problem, evaluate
from preisach_jax.plant.stage import make_stage
from preisach_jax.record.course import input_rate, time_since_reversal
from preisach_jax.record.joined import joined, parts_of

RATE_HZ = 100.0
UNITS = {"input": "V", "output": "um"}
STAGE = make_stage(5)


def triangles(speed, seconds):
    """Time, and triangles of falling height from zero, all at one rate in V/s."""
    t = np.arange(round(seconds * RATE_HZ)) / RATE_HZ
    tops = 74.0 * np.append(1.0, np.maximum(0.5 * 0.97 ** np.arange(200), 0.2))
    corners = np.append(0.0, np.stack([tops, 0 * tops], axis=1))
    return t, np.interp(speed * t, np.append(0.0, np.cumsum(np.abs(np.diff(corners)))), corners)


def record(name, t, u, z, seed=0, zero=0.0):
    noise = np.random.default_rng(seed).normal(0.0, 0.006, len(t))
    return pj.Record.from_arrays(t, u, z + zero + noise, units=UNITS, name=name)


def sweep(name, seed, top=74.0, seconds=12.0, zero=0.0, more=0.0):
    """A record of the stage at a rate that wanders, beside which something may be added."""
    t = np.arange(round(seconds * RATE_HZ)) / RATE_HZ
    phase = 2 * np.pi * (0.3 + 0.1 * seed) * t * (1 + t / seconds)
    u = top * 0.5 * (1 - np.cos(phase)) * (1 - 0.5 * t / seconds)
    return record(name, t, u, STAGE.hysteresis(u) + more * t / seconds, seed, zero)


# What a model of several records computes


def test_each_record_is_followed_by_its_own_slow_operator():
    rng = np.random.default_rng(1)
    plane, creep = pj.Plane(5, 0.0, 10.0), Creep(tau_s=(0.4, 4.0))
    weights = rng.uniform(0.1, 1.0, plane.cells)
    records, shares, offsets, expected = [], [], [3.0, -1.0], []
    for position, count in enumerate((90, 130)):
        t = 0.1 * np.arange(count)
        x = 5.0 + 5.0 * np.sin(0.9 * t + position) * rng.uniform(0.9, 1.0, count)
        share = rng.integers(0, 2, plane.cells).astype(float)  # which hysterons were on before
        states = [
            slow_ramp(x, alpha, beta, plane.delta_x, on)
            for alpha, beta, on in zip(plane.alpha, plane.beta, share, strict=True)
        ]
        loop = weights @ np.array(states)
        late = [hidden.lag(loop, tau, 0.1) for tau in creep.tau_s]
        expected.append(loop + 0.1 * late[0] + 0.2 * late[1] + offsets[position])
        shares.append(weights * share)
        records.append(pj.Record.from_arrays(t, x, x, name=f"{position}.csv"))
    own, gains = np.array([[offsets[0], 0.0, 0.0]]), {"creep": {"c_1": 0.1, "c_2": 0.2}}
    memory = np.concatenate(shares)
    coefficients = Coefficients(weights, memory, offsets[-1], np.zeros(2), own=own)
    with jax.enable_x64(True):
        got = response(Chain(plane, (creep,)), gains, signals_of(joined(records)), coefficients)
    np.testing.assert_allclose(got, np.concatenate(expected), atol=1e-9)


def test_the_regression_has_the_columns_of_that_model():
    both = joined([sweep("a.csv", 1), sweep("b.csv", 2, top=60.0, zero=4.0)])
    known = pj.effects()
    with jax.enable_x64(True):
        problem = Problem.of(both)
        effects = tuple(known[name].bound_to(problem.survey) for name in ("creep", "drift"))
        values = {"creep": {p.name: 0.02 for p in effects[0].parameters()}, "drift": {"tau_s": 3.0}}
        chain = Chain(pj.Plane(5, 0.0, 74.0), effects)
        point = evaluate(problem, chain, values, 1e-4)
        modelled = response(chain, values, problem.signals, point.coefficients())
    left = problem.target - np.asarray(modelled)[problem.rows]
    np.testing.assert_allclose(left, point.residual * point.unit, atol=1e-8)
    # Offset, drift and past of each record are its own; weights and gains are not.
    assert len(point.columns.own) == 1 + len(chain.coefficients)


def test_offset_and_drift_of_each_record_are_its_own_and_the_model_goes_on_from_the_last():
    second = sweep("b.csv", 2, seconds=14.0, zero=20.0, more=2.8)
    records = [sweep("a.csv", 1), second.part(0, 1200)]
    fit = pj.fit(records, ["drift"], levels=9)
    assert fit.rms_validation < 0.2
    amplitude = fit.model.parameters["drift"]["amplitude"]
    assert amplitude.value == pytest.approx(2.4, rel=0.1)  # of the last record, over 12 s
    assert abs(fit.point.coefficients().own[0, 1]) < 0.2  # and that of the first one
    assert [each.record for each in fit.by_record] == ["a.csv", "b.csv"]
    assert max(each.rms_validation for each in fit.by_record) < 0.2
    assert fit.model.origin.record == "b.csv, the last of 2 records"
    assert fit.model.begins_with_origin(second)
    left = second.output - fit.predict(second).output
    assert np.sqrt(np.mean(left[1200:] ** 2)) < 0.4


# Nothing reaches from one record to the next


def test_no_block_holds_rows_of_two_records(x64):
    both = joined([sweep("a.csv", 1, seconds=5.0), sweep("b.csv", 2)])
    for each in (Problem.of(both), Problem.of(both, 400)):
        (start,) = each.record.starts
        later = each.rows >= start
        assert not np.intersect1d(each.block[later], each.block[~later]).size
        for side in (later, ~later):
            assert set(each.fold[side]) == {0, 1, 2, 3}
        assert each.breaks == (start,)


def test_rates_turns_and_whitening_are_those_of_each_record():
    both = joined([sweep("a.csv", 1, seconds=5.0), sweep("b.csv", 2, seconds=5.0)])
    for law in (input_rate, lambda t, u, *starts: time_since_reversal(t, u, 1.0, *starts)):
        alone = [law(part.time, part.input) for part in parts_of(both)]
        together = law(both.time, both.input, both.starts)
        np.testing.assert_allclose(together, np.concatenate(alone), atol=1e-9)
    assert both.gaps == []
    rng = np.random.default_rng(0)
    parts = rng.normal(size=2000), 3.0 * np.cumsum(rng.normal(size=2000))
    together = innovation_variance(np.concatenate(parts), breaks=(2000,))
    assert together == pytest.approx(np.mean([innovation_variance(p) for p in parts]), rel=1e-12)


# What only several records tell


def test_two_rates_in_two_files_name_what_one_rate_cannot_show():
    made = []
    for name, speed, zero in (("slow.csv", 40.0, 0.0), ("fast.csv", 400.0, 1.5)):
        t, u = triangles(speed, 12.0)
        z = STAGE.hysteresis(u, 0.02 * np.abs(np.gradient(u, t)) ** 0.7)
        made.append(record(name, t, u, z, zero=zero))
    found = pj.diagnose(made, ["rate_dependence"], levels=9)
    assert found.effects == ("rate_dependence",)
    assert found.final.rms_validation < 0.2 * found.base.rms_validation
    assert "fast.csv (1,200 rows)" in found.summary()


# Held-out records


def test_the_error_of_a_record_held_out_is_that_of_its_prediction():
    records = [sweep("a.csv", 1), sweep("b.csv", 2, zero=3.0)]
    apart = sweep("c.csv", 4, top=60.0, zero=3.0)
    fit = pj.fit(records, ["drift"], levels=5, hold_out=[apart])
    predicted = fit.model.predict(apart).output
    rms = float(np.sqrt(np.mean((apart.output - predicted) ** 2)))
    assert fit.rms_validation == pytest.approx(rms, rel=1e-9)
    run = fit.record.runs[-1]
    np.testing.assert_allclose(fit.prediction[run.rows], predicted, atol=1e-9)
    assert fit.validation[run.rows].all()
    assert not fit.validation[: run.start].any()
    *fitted, last = fit.by_record
    assert last.held_out
    assert last.rms_validation == pytest.approx(rms)
    assert all(np.isnan(each.rms_validation) for each in fitted)


# Refusals


def other(time, units=UNITS, aux=None):
    one = sweep("b.csv", 2)
    return pj.Record.from_arrays(
        time * one.time, one.input, one.output, units=units, name="b.csv", aux=aux
    )


@pytest.mark.parametrize(
    ("make", "said"),
    [
        (lambda: sweep("b.csv", 1), "b.csv: this record is the same as a.csv"),
        (lambda: other(1, {"input": "mV", "output": "um"}), "its unit is mV, and V in a.csv"),
        (lambda: other(0.02), "5000 Hz, and a.csv at 100 Hz"),
        (lambda: other(1, aux={"load": np.arange(1200)}), "auxiliary columns are load, and those"),
        (lambda: np.zeros(9), "given a ndarray, which is no record"),
    ],
)
def test_records_that_do_not_belong_together_are_refused_in_one_line(make, said):
    for ask in (pj.fit, pj.diagnose):
        with pytest.raises(pj.InputError) as error:
            ask([sweep("a.csv", 1), make()])
        assert said in str(error.value)
        assert "\n" not in str(error.value)


def test_what_is_no_record_and_one_beyond_the_others_are_refused():
    stage = pj.simulate_stage(seconds=3.0)
    for ask in (pj.fit, pj.diagnose):
        with pytest.raises(pj.InputError, match=r"StageRecord.*Record\.from_arrays\(s\.time, s\."):
            ask(stage)  # pyright: ignore[reportArgumentType] - the mistake that is tested
    with pytest.raises(pj.InputError, match="fit was given no record"):
        pj.fit([])
    beyond = r"c\.csv: its input reaches 71\.59 V.* hold out a record"
    with pytest.raises(pj.InputError, match=beyond):
        pj.fit([sweep("a.csv", 1, top=40.0)], hold_out=[sweep("c.csv", 3)], levels=5)


# On the command line


def test_commands_take_several_files_and_hold_one_out(tmp_path, capsys):
    for seed, name in enumerate(("a.csv", "b.csv", "c.csv"), start=1):
        one = sweep(name, seed, 74.0 - 10.0 * seed)
        table = np.column_stack([one.time, one.input, one.output])
        np.savetxt(tmp_path / name, table, delimiter=",", header="t_s,u_V,z_um", comments="")
    *given, apart = (str(tmp_path / name) for name in ("a.csv", "b.csv", "c.csv"))
    report, out = tmp_path / "report", str(tmp_path / "model.json")
    words = ["--effects", "drift", "--levels", "5", "--report", str(report)]
    assert main(["diagnose", *given, "--hold-out", apart, *words]) == 0
    assert "c.csv (held out)" in capsys.readouterr().out
    found = json.loads((report / "diagnosis.json").read_text(encoding="utf-8"))
    names = [(each["record"], each["rows"], each["held_out"]) for each in found["records"]]
    assert names == [("a.csv", 1200, False), ("b.csv", 1200, False), ("c.csv", 1200, True)]
    assert "All rows of c.csv are held out" in (report / "report.html").read_text(encoding="utf-8")
    (tmp_path / "broken.csv").write_text("t_s,u_V\n0,1\n")
    for words, said in (
        ((given[0], str(tmp_path / "broken.csv"), "--out", out), "broken.csv"),
        ((given[0], str(tmp_path / "none.csv"), "--out", out), "none.csv"),
        ((given[0], "--hold-out", given[0], "--out", out), "a.csv: this record is given twice"),
        ((*given, "--out", given[1]), "would be lost"),
    ):
        assert main(["fit", *words, "--levels", "5"]) == 2
        error = capsys.readouterr().err
        assert said in error
        assert error.count("\n") == 1
