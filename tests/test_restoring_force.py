"""A hysteresis inside mechanics: its motion, its laws, its model, and when a diagnosis names it."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp

import preisach_jax as pj
from preisach_jax.compensation.online import OnlineInverse
from preisach_jax.diagnosis.comparison import compare
from preisach_jax.effects.restoring_force import BOUC_WEN, PREISACH, RestoringForce
from preisach_jax.errors import InputError
from preisach_jax.export.description import describe
from preisach_jax.mechanics import along, at_rest, body_of
from preisach_jax.operator.plane import Plane
from preisach_jax.report import write_comparison, write_report

RATE = 250.0
MASS, DAMPING, SPRING, HYSTERETIC, BETA, GAMMA = 2.0, 4.0, 5e3, 5e3, 0.6, -0.3
OF_THE_BODY = {
    "stiffness": SPRING + HYSTERETIC,
    "f_hz": np.sqrt((SPRING + HYSTERETIC) / MASS) / (2 * np.pi),
}
YIELDS = 0.01
NOISE = 2e-5
ROWS = 1200
TIME = np.arange(ROWS) / RATE


def multisine(count, seed=0, low=2.0, high=25.0, rms=20.0):
    """A period of a random-phase multisine, and the same as a function of time."""
    rng = np.random.default_rng(seed)
    period = count / RATE
    lines = np.arange(int(low * period), int(high * period)) / period
    phase = rng.uniform(0, 2 * np.pi, len(lines))
    size = rms * np.sqrt(2 / len(lines))
    return lambda t: size * np.cos(2 * np.pi * np.multiply.outer(t, lines) + phase).sum(axis=-1)


FORCE = multisine(ROWS)


def bouc_wen(time, force):
    """Displacement from rest, by SciPy."""

    def slope(t, state):
        z, v, h = state
        bent = BETA * abs(v) * abs(h) * np.sign(h) + GAMMA * v * abs(h)
        rest = force(t) - DAMPING * v - SPRING * z - HYSTERETIC * YIELDS * h
        return v, rest / MASS, (v - bent) / YIELDS

    # The slope jumps where the motion turns: steps stay short.
    found = solve_ivp(
        slope, (time[0], time[-1]), (0.0, 0.0, 0.0), "RK45", time, rtol=1e-7, atol=1e-9,
        max_step=1 / RATE,
    )  # fmt: skip
    return found.y[0]


def plays(time, force, fine=4):
    """Displacement of a body on Jenkins elements, spring and dry slider in row, in small steps."""
    slide = np.array([1.0, 2.0, 4.0, 8.0]) * 1e-3
    stiff = np.array([1.5e3, 1.5e3, 1e3, 1e3])
    step = 1 / (RATE * fine)
    place = np.zeros(4)
    z = v = 0.0
    path = []
    for n in range(len(time) * fine):
        if n % fine == 0:
            path.append(z)
        middle = z + 0.5 * step * v
        place = np.clip(place, middle - slide, middle + slide)
        spring = SPRING * middle + stiff @ (middle - place)
        pull = float(force(time[0] + (n + 0.5) * step))
        v += step * (pull - spring - DAMPING * v) / (MASS + 0.5 * step * DAMPING)
        z += step * v
    return np.array(path)


def record_of(output, force):
    noise = NOISE * np.random.default_rng(1).normal(size=ROWS)
    return pj.Record.from_arrays(
        TIME, force(TIME), output + noise, units={"input": "N", "output": "m"}, name="body"
    )


@pytest.fixture(scope="module")
def body():
    record = record_of(bouc_wen(TIME, FORCE), FORCE)
    return record, pj.fit(record, effects=(RestoringForce(law=BOUC_WEN),), levels=5)


# --- the motion ---


def test_the_motion_is_that_of_scipy(x64):
    expected = bouc_wen(TIME, FORCE)
    values = OF_THE_BODY | {"share": 0.5, "beta": BETA, "gamma": GAMMA, "n": 1.0}
    values["zeta"] = DAMPING / (2 * np.sqrt(values["stiffness"] * MASS))
    effect = RestoringForce(law=BOUC_WEN, range_z=YIELDS)
    plane = Plane(5, -0.1, 0.1)
    own = body_of(effect, values, plane, np.zeros(plane.cells))
    got, _ = along(own, at_rest(effect, plane), TIME, FORCE(TIME), values["f_hz"])
    assert np.abs(got - expected).max() < 1e-4 * np.ptp(expected)


# --- both laws from records ---


def test_a_bouc_wen_law_is_found_down_to_the_noise(body):
    record, fit = body
    assert fit.rms_validation < 1.1 * NOISE
    found = fit.model.values["restoring_force"]
    assert found["stiffness"] == pytest.approx(OF_THE_BODY["stiffness"], rel=0.02)
    assert found["f_hz"] == pytest.approx(OF_THE_BODY["f_hz"], rel=0.01)
    assert found["share"] == pytest.approx(0.5, abs=0.05)
    # The law is measured in half the range of the record.
    scale = YIELDS / (np.ptp(record.output) / 2)
    assert found["beta"] * scale == pytest.approx(BETA, rel=0.1)
    assert found["gamma"] * scale == pytest.approx(GAMMA, rel=0.2)


def test_new_records_are_predicted_from_rest_and_in_the_steady_state(body):
    _, fit = body
    force = multisine(ROWS, seed=8)
    both = bouc_wen(np.arange(2 * ROWS) / RATE, force)
    steady = pj.Record.from_arrays(TIME, force(TIME), both[ROWS:])
    spread = np.std(both)
    assert np.std(fit.predict(steady).output - steady.output) < 0.01 * spread
    time, place = TIME[:-77], both[: ROWS - 77]  # a part of a period
    open_ended = pj.Record.from_arrays(time, force(time), place)
    assert np.std(fit.predict(open_ended).output - place) < 0.01 * spread


def test_an_operator_takes_what_closed_loops_leave():
    record = record_of(plays(TIME, FORCE), FORCE)
    fit = pj.fit(record, effects=(RestoringForce(law=PREISACH),), levels=5)
    late = [np.pad(record.input, (k, 0))[:ROWS] for k in range(100)]
    of_linear = np.linalg.lstsq(np.transpose(late), record.output, rcond=None)[0] @ late
    assert fit.rms_validation < 0.25 * np.std(record.output - of_linear)


# --- the model ---


def test_a_saved_model_predicts_the_same_and_what_it_cannot_do_is_refused(body, tmp_path):
    record, fit = body
    fit.save(tmp_path / "m.json")
    again = pj.Model.load(tmp_path / "m.json")
    np.testing.assert_array_equal(again.predict(record).output, fit.predict(record).output)
    assert "Bouc-Wen law" in fit.summary()
    far = pj.Record.from_arrays(record.time, 20 * record.input, record.output)
    for use, says in (
        (lambda: describe(fit.model), "inside mechanics"),
        (lambda: OnlineInverse(fit.model, RATE, limits=(-1.0, 1.0)), "inside mechanics"),
        (lambda: pj.compensate(fit.model, record), "inside mechanics"),
        (lambda: fit.predict(far), "knows it up to"),
    ):
        with pytest.raises(InputError, match=says):
            use()


def test_what_cannot_be_fitted_is_refused():
    record = record_of(FORCE(TIME) ** 3, FORCE)
    for records, effects, says in (
        (record, ("restoring_force",), "no mass on a spring"),
        (record, ("restoring_force", "creep"), "fitted alone"),
        ([record, record_of(FORCE(TIME), FORCE)], ("restoring_force",), "one record"),
    ):
        with pytest.raises(InputError, match=says):
            pj.fit(records, effects=effects, levels=5)
    with pytest.raises(InputError, match="the law of"):
        RestoringForce(law="dahl")


# --- the diagnosis ---


def test_it_is_named_where_it_is_hidden_and_reported(body, tmp_path):
    record, _ = body
    found = pj.diagnose(record, ("resonance", "restoring_force"), levels=5)
    assert found.effects == ("restoring_force",)
    assert found.verdict == "explained"
    assert [rung.effects for rung in found.ladder] == [(), ("restoring_force",)]
    (finding,) = found.findings
    fallen = 1 - (finding.rms_after / finding.rms_before) ** 2
    assert finding.evidence["gain"] == pytest.approx(fallen, abs=0.01)
    write_report(found, tmp_path / "report")
    assert "restoring_force" in (tmp_path / "report" / "report.html").read_text()
    # The plane of a displacement has no axes of the input to be drawn on.
    assert not (tmp_path / "report" / "density.svg").exists()
    compared = compare(found.model, record)
    assert compared.fit_percent > 95
    write_comparison(compared, tmp_path / "comparison")
    assert (tmp_path / "comparison" / "report.html").exists()
