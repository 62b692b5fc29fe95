"""Generated C is the model: its outputs, its inverse, its learning, and its way with nonsense."""

import json
import subprocess
from dataclasses import replace
from importlib import import_module

import jax
import numpy as np
import pytest
from exported import GCC, STEP_S, STRICT, Compiled, drawn, needs_compiler, predicted, smooth, wild

from preisach_jax import AdaptiveFilter, AddedEffect, InputError, OnlineFilter, Parameter
from preisach_jax.chain.description import Chain
from preisach_jax.cli.application import run
from preisach_jax.export import export_c
from preisach_jax.export.c import files
from preisach_jax.export.description import describe
from preisach_jax.export.stepper import sample_by_sample

pytestmark = needs_compiler

ALWAYS = (
    "creep input_quantisation aux:load_N cross:y_V hum ageing delay slew_limit reptation "
    "operator_creep moving eddy_currents output_quantisation leakage"
)
# All effects of the library are together in each of these, in one form or another.
TOGETHER = [
    f"{ALWAYS} {forms}".split()
    for forms in (
        "drift output_nonlinearity input_lag output_lag resonance rate_corners",
        "drift_waves ripples input_lag output_filter two_modes rate_smooth_all",
        "drift ripples input_filter output_filter resonance rate_corners",
    )
]
LEARNT_THROUGH = [
    "creep", "input_quantisation slew_limit", "drift aux:load_N reptation operator_creep",
    "ageing", "delay", "moving", "eddy_currents", "output_quantisation output_nonlinearity",
    "ripples", "leakage", "input_lag", "output_lag", "resonance", "two_modes", "rate_corners",
    "rate_smooth_all",
]  # fmt: skip
"""Effects, in one form where others have the same code."""
BY_PATH = ["ageing_by_path", "drift_by_path", "reptation"], ["waves_by_path", "moving"]
CHAINS = [[], *BY_PATH, ["output_quantisation", "creep"], ["rate_corners_all", "moving"]]


def columns(model, samples):
    return [smooth(samples, 9, 0.0, 1.0) + k for k, _ in enumerate(model.columns["aux"])]


def first_of(names):
    """At the first sample the code does not know the speed that the second one tells."""
    return int(any(name.startswith("rate") for name in names))


def course(seed=1):
    """An input that moves in all ways, and then smoothly."""
    return np.concatenate([wild(300, seed), smooth(100, seed + 1)])


@pytest.mark.parametrize("names", CHAINS, ids="+".join)
def test_the_output_is_that_of_predict(names, tmp_path):
    for hysteron in ("ramp", "relay") if names == [] else ("ramp",):
        polarity = -1 if len(names) == 3 else 1  # an output that falls as the input rises
        model, u = drawn(names, len(names), hysteron=hysteron, polarity=polarity), course()
        aux = columns(model, len(u))
        expected = predicted(model, u, aux)[first_of(names) :]
        found = Compiled(model, tmp_path)(u, aux)[first_of(names) :]
        assert np.ptp(expected) > 0.1
        if hysteron == "relay":
            assert np.array_equal(found, expected)
        np.testing.assert_allclose(found, expected, rtol=0, atol=1e-12 * np.ptp(expected))


def test_weights_of_both_signs_are_predicted_and_learnt_and_not_inverted(tmp_path):
    model = drawn(["creep"])
    signs = np.where(np.arange(model.plane.cells) % 3 == 0, -1.0, 1.0)
    own = replace(model.coefficients, weights=signs * model.weights, memory=0 * model.weights)
    model = replace(model, chain=replace(model.chain, signed=True), coefficients=own)
    compiled, u = Compiled(model, tmp_path), course()
    expected = predicted(model, u)
    np.testing.assert_allclose(compiled(u), expected, rtol=0, atol=1e-12 * np.ptp(expected))
    # From the model with all signs turned, the readings lead back to weights of both signs.
    other = compiled.with_weights(-own.weights)
    u = wild(2000)
    readings = compiled.again(u)
    for _ in range(10):
        other.adapt(u, readings)
    assert np.corrcoef(other.weights, own.weights)[0, 1] > 0.5
    assert other.weights.min() < 0 < other.weights.max()
    written = files(model)
    assert "preisach_inverse_step(" not in written["preisach_model.c"]
    assert "weights have both signs" in written["README.md"]
    self_tested(model, tmp_path)


def test_a_speed_that_looks_ahead_in_predict_is_causal_here(tmp_path):
    """The oracle is the model sample by sample; `predict` is near on smooth inputs."""
    model = drawn(["rate_smooth", "ripples"])
    described, compiled = describe(model), Compiled(model, tmp_path)
    u = wild(300, 2)
    oracle = sample_by_sample(described, u[:, None])
    np.testing.assert_allclose(compiled(u), oracle, rtol=0, atol=1e-12)
    slow = smooth(400, 3)
    expected = predicted(model, slow)
    missed = np.abs(compiled.again(slow) - expected)[1:]
    assert missed.max() < 1e-3 * np.ptp(expected)


def test_nested_loops_inside_one_cell_are_remembered_in_a_state_of_fixed_size(tmp_path):
    """Thousands of ever smaller loops, and then back out through all of them."""
    model = drawn([], levels=5)
    shrinking = 0.999 ** np.arange(4000)
    low, high = model.plane.low, model.plane.high
    centre, swing = 0.47 * (low + high), 4.0 * shrinking * (-1.0) ** np.arange(4000)
    u = np.clip(np.concatenate([centre + swing, centre - swing[::-7], [centre]]), low, high)
    compiled = Compiled(model, tmp_path, "-fsanitize=undefined", "-fno-sanitize-recover")
    expected = predicted(model, u)
    np.testing.assert_allclose(compiled(u), expected, rtol=0, atol=1e-12)


@pytest.mark.parametrize("polarity", [1, -1])
def test_the_inverse_drives_the_model_along_what_is_wanted(polarity, tmp_path):
    names = ["drift", "aux:load_N", "ageing", "operator_creep", "output_nonlinearity"]
    model = drawn(names, polarity=polarity)
    compiled = Compiled(model, tmp_path)
    aux = columns(model, 400)
    wanted = compiled.again(smooth(400, 3, model.plane.low + 1, model.plane.high - 1), aux)
    drive = compiled.inverse(wanted, aux)
    np.testing.assert_allclose(predicted(model, drive, aux), wanted, rtol=0, atol=1e-11)


@pytest.mark.parametrize("kind", ["lag", "filter"])
def test_the_inverse_leads_lags_and_keeps_to_the_plane(kind, tmp_path):
    model = drawn([f"input_{kind}", f"output_{kind}"])
    compiled = Compiled(model, tmp_path)
    t = np.arange(400) * STEP_S
    wanted = 0.25 + float(model.weights.sum()) * (0.5 - 0.3 * np.cos(2 * np.pi * t))
    drive = compiled.inverse(wanted)
    missed = np.abs(predicted(model, drive) - wanted)[100:]
    assert missed.max() < 5e-3 * np.ptp(wanted)
    compiled.begin()
    beyond = compiled.inverse(np.where(t % 0.4 < 0.2, 1e6, -1e6))
    assert (beyond.min(), beyond.max()) == (model.plane.low, model.plane.high)


@pytest.mark.parametrize("hysteron", ["ramp", "relay"])
def test_learning_is_that_of_the_online_filter(hysteron, tmp_path):
    with jax.enable_x64(True):
        model, true = (drawn([], seed, hysteron=hysteron) for seed in (0, 1))
        u = np.concatenate([[model.plane.low], wild(399, 3)])  # nothing is unknown
        z = predicted(true, u).copy()
        z[40:60] = np.nan
        filt = AdaptiveFilter(model.plane, hysteron, initial_weight=model.weights, nonnegative=True)
        online = OnlineFilter(filt)
        expected = np.array([online(*sample) for sample in zip(u, z, strict=True)])
        compiled = Compiled(model, tmp_path)
        np.testing.assert_allclose(compiled.adapt(u, z) - model.offset, expected, atol=1e-11)
        assert online.state is not None
        np.testing.assert_allclose(compiled.weights, online.state.weights, atol=1e-11)
        assert np.abs(compiled.weights - model.weights).max() > 0.01


def self_tested(model, folder, precision="-DPREISACH_DOUBLE"):
    """Run the self test, built for addresses and arithmetic that are watched over."""
    for name, text in files(model).items():
        (folder / name).write_text(text)
    watched = ["-O0", "-fsanitize=address,undefined", "-fno-sanitize-recover=all", precision]
    words = [GCC, *STRICT, *watched, "-o", "program", "preisach_test.c", "preisach_model.c"]
    built = subprocess.run([*words, "-lm"], cwd=folder, capture_output=True, text=True)
    assert built.returncode == 0, built.stderr[:2000]
    done = subprocess.run([folder / "program"], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout + done.stderr[:2000]
    assert "learning another stage" in done.stdout


@pytest.mark.parametrize("names", TOGETHER, ids=range(3))
def test_the_self_test_passes_for_all_effects_together(names, tmp_path):
    precision = "-DPREISACH_FLOAT" if names is TOGETHER[0] else "-DPREISACH_DOUBLE"
    self_tested(drawn(names, seed=2), tmp_path, precision)


def other_stage(compiled):
    """A stage with other weights."""
    model = compiled.model
    scale = np.random.default_rng(1).uniform(0.5, 1.5, model.plane.cells)
    return compiled.with_weights(model.weights * scale)


def learning(compiled, stage):
    """The stage is learnt; errors of the weights on the way, and of a replay before and after."""

    def replayed(weights):
        u = smooth(800, 8)
        aux = columns(compiled.model, len(u))
        missed = compiled.with_weights(weights)(u, aux) - stage.with_weights(true)(u, aux)
        return np.linalg.norm(missed)

    true, weights = stage.weights, [compiled.weights]
    for k in range(4):
        u = wild(800, k)
        aux = columns(compiled.model, len(u))
        compiled.adapt(u, stage(u, aux), aux)
        weights.append(compiled.weights)
    errors = np.linalg.norm(np.array(weights) - true, axis=1)
    return [replayed(each) for each in (weights[0], weights[-1])], errors


@pytest.mark.parametrize(("f_hz", "zeta"), [(5.0, 0.02), (300.0, 0.02)])
def test_another_stage_is_learnt_through_a_mode(f_hz, zeta, tmp_path):
    """Whatever the mode and the rate, errors of weights and readings fall, eq. (9)."""
    model = drawn(["resonance", "delay"])
    mode = {"resonance": {"f_hz": f_hz, "zeta": zeta}}
    model = replace(model, values={**model.values, **mode})
    compiled = Compiled(model, tmp_path, rate_hz=2000.0)
    replayed, weights = learning(compiled, other_stage(compiled))
    assert np.all(np.diff(weights) <= 1e-12)
    assert weights[-1] < 0.98 * weights[0]
    assert replayed[-1] < 0.9 * replayed[0]


@pytest.mark.parametrize("names", LEARNT_THROUGH)
def test_whatever_the_effect_bounded_readings_keep_the_weights_bounded(names, tmp_path):
    """Readings of no stage at all: noise, jumps and holds within three strokes."""
    polarity = (-1) ** LEARNT_THROUGH.index(names)
    model = drawn(names.split(), polarity=polarity)
    compiled = Compiled(model, tmp_path)
    stage = other_stage(compiled)
    u, rng = wild(1500, 5), np.random.default_rng(6)
    stroke = np.abs(model.weights).sum()
    z = 3 * stroke * rng.uniform(-1, 1, len(u)) * (rng.random(len(u)) < 0.5)
    aux = columns(model, len(u))
    out = compiled.adapt(u, z, aux)
    assert np.all((polarity * compiled.weights >= 0) & (polarity * compiled.weights <= 2 * stroke))
    assert np.all(np.isfinite(out))
    # What they have made of the weights is unlearnt, and the stage is learnt, eq. (9).
    stage(u, aux)
    replayed, errors = learning(compiled, stage)
    assert errors[-1] < 0.8 * errors[0]
    assert replayed[-1] < 0.5 * replayed[0]


def test_learnt_weights_are_put_back(tmp_path):
    model = drawn(["output_lag", "moving"])
    compiled, u = Compiled(model, tmp_path), wild(600, 3)
    z = 1.2 * compiled.again(u)
    compiled.adapt(u, z)
    kept = compiled.weights
    own = replace(model.coefficients, weights=kept, memory=0 * kept)
    expected = Compiled(replace(model, coefficients=own), tmp_path)(u)
    np.testing.assert_allclose(compiled.with_weights(kept)(u), expected, rtol=0, atol=1e-12)


@pytest.mark.parametrize("precision", ["-DPREISACH_DOUBLE", "-DPREISACH_FLOAT"])
def test_nonsense_of_every_kind_leaves_the_outputs_bounded(precision, tmp_path):
    """Steps, inverse steps and learning in turn; undefined arithmetic would end the process."""
    model = drawn(["rate_smooth", "eddy_currents", "delay", "ripples"])
    compiled = Compiled(model, tmp_path, "-fsanitize=undefined", "-fno-sanitize-recover", precision)
    stage, rng = compiled.with_weights(model.weights), np.random.default_rng(0)
    for k in range(200):
        u = rng.choice([np.nan, np.inf, -1e300, 1e-310, 3.0, *rng.uniform(-2, 8, 10)], 40)
        if k % 3 == 0:
            out = compiled(u)
            stage(u)
        elif k % 3 == 1:
            out = compiled.inverse(u)
            stage(out)
        else:
            z = stage(u)
            out = compiled.adapt(u, np.where(np.abs(u) < 7, z, u))
        assert np.all(np.abs(out) < 1e4)
    assert compiled.library.refused(compiled.state) > 0


def test_the_command_writes_a_folder_that_tests_itself(tmp_path, capsys):
    model = drawn(["creep", "aux:load_N"], levels=5)
    model.save(tmp_path / "model.json")
    out = tmp_path / "controller"
    words = f"export {tmp_path}/model.json --to c --out {out} --rate 1000 --json".split()
    assert run(words) == 0
    assert json.loads(capsys.readouterr().out)["rate_hz"] == 1000.0
    assert sorted(path.name for path in out.iterdir()) == [
        "Makefile", "README.md", "preisach_model.c", "preisach_model.h", "preisach_test.c",
    ]  # fmt: skip
    assert "0.001 s (1000 Hz)" in (out / "README.md").read_text()
    made = subprocess.run(["make", "-C", out], capture_output=True, text=True, check=False)
    assert made.returncode == 0, made.stdout + made.stderr
    assert made.stdout.count("passed") == 2
    wrong = (out / "preisach_test.c").read_text().replace("- expected[k])", "- expected[k] - 0.01)")
    (out / "preisach_test.c").write_text(wrong)
    made = subprocess.run(["make", "-C", out], capture_output=True, text=True, check=False)
    assert made.returncode != 0
    assert "FAILED" in made.stdout


class Own(AddedEffect):
    """An effect that no template knows."""

    name = "own"

    def coefficients(self):
        return (Parameter("amount", "um", -1.0, 1.0),)


def test_what_cannot_be_exported_is_told_in_one_line(tmp_path, capsys):
    model = drawn(["creep"])
    held = {"own": {}}
    chain = Chain(model.plane, (Own(),))  # which has as many coefficients as a drift
    foreign = replace(drawn(["drift"]), chain=chain, values=held, parameters=held)
    with pytest.raises(InputError, match=r"no C code is known for the effect 'own'.*--without own"):
        export_c(foreign, tmp_path / "none")
    slow = drawn(["delay"])
    with pytest.raises(InputError, match=r"samples at 1e.09 Hz.*--without delay"):
        export_c(slow, tmp_path / "none", rate_hz=1e9)
    model.save(tmp_path / "model.json")
    for words, message in (
        (["--to", "c", "--rate", "-5"], "-5.0 Hz: give a positive number"),
        (["--to", "rust"], "--to is 'rust'; give one of c, fmu"),
        (
            ["--to", "c", "--without", "drift"],
            "no effect 'drift' to leave out; give one of the model: creep",
        ),
    ):
        out = ["--out", str(tmp_path / "none")]
        assert run(["export", str(tmp_path / "model.json"), *words, *out]) == 2
        captured = capsys.readouterr()
        assert message in captured.err
        assert captured.err.count("\n") == 1
    assert not (tmp_path / "none").exists()


PLAY = """
import jax.numpy as jnp
import preisach_jax as pj

class Play(pj.InputEffect):
    name = "play"
    gap: float = pj.parameter("{u}", 1e-3, 1.0, log=True)

    def init(self, first):
        return first

    def step(self, state, value, dt):
        moved = jnp.clip(state, value - self.gap, value + self.gap)
        return moved, moved

    def sampled(self, step_s, amounts):
        return {"gap": self.gap}
"""
PLAY_IN_C = """
{% set remembers, operations, calls = 1, 2, 0 %}
{% macro fields() %}
    preisach_real {{ id }};
{% endmacro %}
{% macro law() %}
static real {{ name }}(const preisach_state *s, real value, preisach_effects *next)
{
    real last = s->started ? s->effects.{{ id }} : value;
    next->{{ id }} = limited(last, value - {{ n.gap | real }}, value + {{ n.gap | real }});
    return next->{{ id }};
}
{% endmacro %}
"""


def test_an_effect_of_ones_own_has_its_code_beside_it(tmp_path, monkeypatch):
    (tmp_path / "module_of_a_play.py").write_text(PLAY)
    (tmp_path / "play.c.j2").write_text(PLAY_IN_C)
    monkeypatch.syspath_prepend(tmp_path)
    play = import_module("module_of_a_play").Play()
    plain, u = drawn([]), wild(400, 3)
    chain, values = Chain(plain.plane, (play,)), {"play": {"gap": 0.7}}
    model = replace(plain, chain=chain, values=values, parameters={"play": {}})
    expected = predicted(model, u, [])
    assert np.abs(expected - predicted(plain, u, [])).max() > 0.1
    found = Compiled(model, tmp_path)(u, [])
    np.testing.assert_allclose(found, expected, rtol=0, atol=1e-12 * np.ptp(expected))


def test_an_effect_can_be_left_out(tmp_path):
    model, u, aux = drawn(["creep", "aux:load_N", "drift"]), wild(300, 1), [smooth(300, 2)]
    compiled = Compiled(model, tmp_path, without=["creep", "drift"])
    assert "creep" not in compiled.texts["preisach_model.c"].replace("creep is", "")
    alone = compiled.again(u, aux)
    assert np.abs(alone - compiled(u, [0 * aux[0]])).max() > 1e-4
