"""How each effect is shown: the axis that tells it, where its record comes from, what to look for.

The pages of the effects take the captions from here, and `pictures.py` the axes.
"""

from __future__ import annotations

from dataclasses import dataclass

STAGE = (
    "`pj.simulate_stage(seed={seed}, seconds={seconds:g}, effects=({name!r},), rate_hz={rate:g})`"
)


@dataclass(frozen=True)
class Telling:
    """How the residual of one hidden effect is shown.

    Attributes:
        axis: what the second panel shows; a function of `pictures.py`.
        look: what to look for, in a sentence or two.
        seed: of the simulated stage.
        seconds, rate_hz: length and sampling rate of its record.
        made: how the record was made, where it was not by `simulate_stage`.
    """

    axis: str
    look: str
    seed: int = 3
    seconds: float = 16.0
    rate_hz: float = 1000.0
    made: str = ""

    def source(self, name: str) -> str:
        """How the record was made, in words or as a call."""
        if self.made:
            return self.made
        hidden = name.removesuffix(":COL")
        call = STAGE.format(name=hidden, seed=self.seed, seconds=self.seconds, rate=self.rate_hz)
        return f"The stage is simulated: {call}."


COLUMNS = {"aux:COL": "aux:load_N", "gain:COL": "gain:temp_C", "cross:COL": "cross:y_V"}
"""Effects of a column as they are named in the simulated stage."""


TELLING = {
    "creep": Telling(
        "since_rest",
        "Below, each line is a hold: the residual goes on in the direction of the last "
        "move, by about as much in each decade of time. The greater the move before, the "
        "steeper the line.",
    ),
    "operator_creep": Telling(
        "since_rest_by_move",
        "Tails after large moves, and hardly any after small ones; those of linear creep "
        "would be in proportion to the move.",
        made="This stage is synthetic: the simulated stage hides nothing, and the sum of 48 "
        "elementary creep operators (8 thresholds, 6 time constants) is added to its output, "
        "integrated in small steps by code that the library does not use.",
    ),
    "reptation": Telling(
        "loop_number",
        "One minor loop, repeated after a great move, shifts less and less from turn to turn; "
        "holds between the turns shift nothing.",
        made="This stage is synthetic: 1,152 relays one by one, whose states fade to the middle "
        "with the path of the input where the input does not hold them, beside a reversible part.",
    ),
    "input_lag": Telling(
        "input_rate",
        "A residual in proportion to the rate of the input, of one sign on the way up and "
        "of the other on the way down. Where the input is slow most of the time, free "
        "weights have taken up the mean of it, so that the slope is reversed there.",
    ),
    "slew_limit": Telling(
        "behind_a_step",
        "The residual is zero until the input moves faster than the limit; it grows while "
        "the input is ahead, and ends abruptly where the ramp of the greatest slope "
        "arrives.",
        seconds=10.0,
        rate_hz=2000.0,
    ),
    "input_quantisation": Telling(
        "few_steps_of_input",
        "A sawtooth with the period of one step of the input on a slow ramp.",
        made="The stage is simulated with a slow ramp at the end of its drive: "
        "`pj.simulate_stage(seed=3, drive=..., effects=('input_quantisation',), rate_hz=1000, "
        "noise_um=0.002)`.",
    ),
    "rate_dependence": Telling(
        "along_the_move",
        "In the direction of the move, the residual falls with a power of the speed below or near "
        "one; a lag would fall in proportion.",
    ),
    "eddy_currents": Telling(
        "output_rate",
        "A residual that goes with the speed of the *output*: greatest where the loop is steep.",
        made="This stage is synthetic: a core of 30 bent plays, of which the field inside is found "
        "by bisection at each instant of a finer raster.",
    ),
    "moving": Telling(
        "output_by_branch",
        "Nothing: the weights absorb this feedback whole, and the model that has it is no "
        "better. That is why it is tried on request only. With a stronger feedback, loops "
        "of equal swing are too high at some outputs and too low at others, and unlike on "
        "the two branches.",
    ),
    "output_lag": Telling(
        "output_rate",
        "A residual in proportion to the rate of the output. Where the input is slow most "
        "of the time, free weights have taken up the mean of it, so that the slope is "
        "reversed there. On this axis a delay looks the same; a multisine tells them apart.",
    ),
    "delay": Telling(
        "output_rate",
        "A residual in proportion to the rate of the output. Where the input is slow most "
        "of the time, free weights have taken up the mean of it, so that the slope is "
        "reversed there. On this axis a lag of the output looks the same; a multisine tells "
        "them apart.",
    ),
    "resonance": Telling(
        "behind_a_step",
        "Ringing at one frequency behind each corner of the input (dotted), which dies away "
        "at rest.",
        seconds=10.0,
        rate_hz=2000.0,
    ),
    "restoring_force": Telling(
        "behind_a_step",
        "Ringing behind each corner of the input (dotted), as behind a resonance, but slower "
        "while it is great: the spring yields, and takes energy away with each swing.",
        seconds=12.0,
    ),
    "drift": Telling(
        "input_early_and_late",
        "A shift that hardly depends on the input: the residual of the first quarter of the "
        "record lies on one side of zero, that of the last on the other.",
    ),
    "hum": Telling(
        "lines",
        "Lines in the spectrum of the residual at the mains frequency and its multiples. They are "
        "as high at rest as in motion.",
    ),
    "ageing": Telling(
        "output_early_and_late",
        "A residual that grows with the output, with opposite slopes early and late, and "
        "none where the output is zero.",
    ),
    "output_nonlinearity": Telling(
        "worst_second",
        "Nearly nothing: the density absorbs a bent sensor, all but a few nanometres in "
        "minor loops. Below, the second in which most is left: loops of equal swing "
        "(dotted) at rising bias.",
    ),
    "output_quantisation": Telling(
        "few_steps_of_output",
        "Parallel lines: readings come again exactly, and the residual of the plain model "
        "is spread evenly over one step. The model that knows the steps predicts the "
        "reading itself, which is right, or wrong by a whole step.",
    ),
    "aux:COL": Telling(
        "auxiliary",
        "A residual that follows the auxiliary column, whatever the input does; weights have taken "
        "up a part of it, which bends the line.",
    ),
    "viscosity": Telling(
        "input_rate",
        "A residual in the direction of motion, greatest at speed and zero at rest and where the "
        "input turns. Weights have taken up what belongs to the usual rate.",
    ),
    "excess_loss": Telling(
        "input_rate",
        "A residual of the field that grows with the rate of the induction, ever more slowly. "
        "Weights have taken up what belongs to the usual rate, so that the slope is reversed where "
        "the rate is low.",
        made="The core is simulated: `preisach_jax.plant.magnets.simulate_magnet(seed=2, "
        "effects=('excess_loss',))`, whose input is the induction and whose output is the field.",
    ),
    "gain:COL": Telling(
        "output_cold_and_warm",
        "A residual that grows with the output, with opposite slopes at low and at high values of "
        "the auxiliary column, and that fades where the output is zero.",
    ),
    "cross:COL": Telling(
        "auxiliary",
        "A residual that follows the other axis: a cloud about a line, as wide as the mode "
        "between the axes amplifies and delays what is fast.",
    ),
    "leakage": Telling(
        "since_rest",
        "Below, each line is a hold: the residual goes back towards the middle of the loop, "
        "against moves away from there, in proportion to the time at first.",
    ),
    "log_rate": Telling(
        "along_the_move",
        "In the direction of the move, the residual falls by a constant for each decade of the "
        "speed: steeply at low speeds, and hardly at high ones.",
    ),
}
