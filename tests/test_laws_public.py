"""Each public name has a law: a property tried on many values, or against an oracle."""

import ast
from functools import cache
from pathlib import Path

import pytest

import preisach_jax as pj

LAWS = {
    "AdaptiveFilter": "laws.a_filter_that_knows_the_weights_keeps_them",
    "AddedEffect": "laws_model.twice_the_coefficients_are_twice_the_output",
    "Compensation": "compensation.limits_and_slew_are_kept_and_rows_that_they_cost_are_told",
    "Cycle": "magnets.cycles_inside_others_lose_what_the_everett_function_says",
    "Design": "design.the_plan_keeps_to_the_record",
    "Diagnosis": "diagnosis.json_holds_what_the_contract_names",
    "Effect": "laws_model.an_effect_is_its_settings_and_its_parameters_are_in_their_bounds",
    "Exploration": "exploration.an_added_effect_lowers_the_error_and_the_way_back_is_whole",
    "Fit": "laws_fit.stated_errors_are_those_of_the_prediction",
    "FleetResult": "fleet.any_reader_opens_the_arrays_of_a_fleet",
    "HysteresisEffect": "hysteresis_effects.states_follow_thresholds_that_have_moved_outward",
    "InputEffect": "effects.effects_on_a_signal_are_causal",
    "InputError": "found_by_fuzzing.damaged_files_are_read_or_refused",
    "Look": "look.planted_spikes_stuck_and_clipped_stretches_are_found",
    "Loop": "compensation_online.a_system_of_python_control_closes_the_loop",
    "Loss": "magnets.an_ellipse_loses_its_area_in_any_units",
    "Model": "laws_model.a_saved_model_predicts_the_same_to_the_last_bit",
    "OnlineFilter": "online.any_samples_give_what_the_jitted_step_gives",
    "OnlineInverse": "compensation_online.the_drive_of_one_sample_after_the_other_gives_the_course",
    "OutputEffect": "effects.effects_on_a_signal_are_linear",
    "Parameter": "laws_model.an_effect_is_its_settings_and_its_parameters_are_in_their_bounds",
    "coefficient": "laws_model.an_effect_is_its_settings_and_its_parameters_are_in_their_bounds",
    "parameter": "laws_model.an_effect_is_its_settings_and_its_parameters_are_in_their_bounds",
    "ParameterEstimate": "laws_fit.units_change_numbers_and_nothing_else",
    "Plane": "laws.the_everett_function_gives_the_area_of_the_triangle_switched",
    "PrecisionWarning": "filter.single_precision_is_said_where_it_takes_digits_that_matter",
    "Prediction": "laws_model.a_saved_model_predicts_the_same_to_the_last_bit",
    "Record": "laws_record.files_give_a_record_back",
    "RecursiveLeastSquares": "recursion.the_estimates_are_those_of_the_batch",
    "SensorEffect": "hysteresis_effects.a_bent_reading_solves_the_map",
    "Signals": "laws_model.what_comes_later_changes_nothing_before",
    "SparseForm": "form.json_has_one_key_more_and_nothing_else_changes",
    "Survey": "laws_model.an_effect_is_its_settings_and_its_parameters_are_in_their_bounds",
    "Sweep": "sweep.chunks_of_seeds_join_to_the_whole_to_the_last_bit",
    "WeightEffect": "effects.ageing_ends_at_the_loss",
    "compare_recursions": "recursion.least_squares_replays_what_one_pass_of_the_filter_does_not",
    "compensate": "compensation.a_course_comes_back_through_every_effect",
    "design": "design.the_candidate_with_the_greatest_least_separation_is_chosen",
    "diagnose": "diagnosis.same_record_same_outcome_on_any_number_of_threads",
    "effects": "laws_model.every_effect_but_two_is_in_a_chain",
    "explore": "exploration.the_same_clicks_give_the_same_numbers_whether_ranked_or_not",
    "find_form": "form.the_pursuit_takes_what_least_squares_takes",
    "fit": "laws_fit.the_model_predicts_its_own_record_as_well_as_is_stated",
    "fleet_to_folder": "fleet.a_fleet_goes_on_in_its_folder",
    "look": "look.turns_and_rates_are_those_that_were_played",
    "loss_per_cycle": "magnets.an_ellipse_loses_its_area_in_any_units",
    "run_fleet": "fleet.each_record_gives_what_it_gives_alone",
    "simulate": "laws.the_output_is_that_of_hysterons_one_by_one",
    "simulate_loop": "compensation_online.a_system_of_python_control_closes_the_loop",
    "simulate_stage": "plant.refining_the_path_changes_nothing",
    "sweep": "sweep.a_sweep_is_the_filter_run_one_by_one",
}
"""File and test by public name, without the `test_` of both."""


@cache
def functions_in(file):
    tree = ast.parse((Path(__file__).parent / f"test_{file}.py").read_text(encoding="utf-8"))
    return {node.name for node in ast.walk(tree) if isinstance(node, ast.FunctionDef)}


@pytest.mark.parametrize("name", pj.__all__)
def test_every_public_name_has_a_law(name):
    assert name in LAWS, f"say in LAWS which test holds {name} to a law, and write one if none does"
    file, test = LAWS[name].split(".")
    assert f"test_{test}" in functions_in(file)
