"""Parameters: the fingerprint, JSON and back, and the ranges."""

import hashlib
import json
import pickle
import re
import subprocess
import sys

import pytest
from pydantic import ValidationError

from core.errors import ParameterError
from core.parameters import DEFAULT, METHOD_VERSION, PAPER, Parameters
from core.parameters.parameters import FLAT_KEYS, GROUPS
from tests.core.parameters.earlier_parameters import BEFORE_ORIENTATION, BEFORE_SMALLER_SURFACES, BEFORE_VIEWS

OTHER = {
    "fill_holes": 0.2,
    "refine_vertices": 2001,
    "decimate_pieces_above": 20_000,
    "refine_simplified": 2000,
    "decimate_above": 50_000,
    "decimate_to": 5_000,
    "smooth_above": 0.3,
    "smooth_rounds": 5,
    "degree": 7,
    "epsilon": 0.02,
    "normalise_weights": False,
    "selection": "random-draw",
    "coverage_power": 0.5,
    "seed": 1,
    "samples": 101,
    "tau": 0.4,
    "sample_cap": 300,
    "points": 600,
    "unfold": False,
    "distances": "graph",
    "affinity": "distance",
    "width": 1.6,
    "operators": ("laplace-beltrami", "affinity"),
    "dimensions": 9,
    "eigenvalue_power": 0.25,
    "taper": False,
    "search_samples": 65,
    "search_dimensions": 5,
    "first_dimensions": 4,
    "sign_starts": False,
    "kept_starts": 4,
    "start_iterations": 6,
    "step_iterations": 4,
    "stiffness": 10.0,
    "warp_stiffness": 0.02,
    "pairs": "nearest",
    "align_samples": 63,
    "kept_maps": 3,
    "align_rounds": 5,
    "final_rounds": 4,
    "slide_rounds": 3,
    "affinity_values": 21,
    "laplacian_values": 16,
    "form": False,
    "patches": False,
    "smooth_refined": False,
    "match_threshold": 0.8,
    "views": False,
    "orientation": False,
}

OUT_OF_RANGE = [
    ("fill_holes", -0.1),
    ("fill_holes", 10.1),
    ("refine_vertices", -1),
    ("refine_vertices", 100_001),
    ("decimate_to", 499),
    ("decimate_to", 8_000),
    ("decimate_pieces_above", -1),
    ("decimate_pieces_above", 4_000),
    ("refine_simplified", -1),
    ("refine_simplified", 100_001),
    ("smooth_above", -0.1),
    ("smooth_above", 1001.0),
    ("smooth_rounds", 0),
    ("degree", 0),
    ("degree", 13),
    ("epsilon", 0.0),
    ("epsilon", 0.15),
    ("coverage_power", -0.1),
    ("coverage_power", 4.1),
    ("seed", -1),
    ("seed", 2**62 + 1),
    ("samples", 11),
    ("samples", 10_001),
    ("tau", 0.0),
    ("tau", 1.01),
    ("sample_cap", 11),
    ("points", -1),
    ("points", 20_001),
    ("width", 0.0),
    ("width", 1e6),
    ("dimensions", 1),
    ("dimensions", 51),
    ("eigenvalue_power", -0.5),
    ("eigenvalue_power", 5.0),
    ("search_samples", 11),
    ("search_samples", 10_001),
    ("search_dimensions", 2),
    ("search_dimensions", 51),
    ("first_dimensions", 1),
    ("first_dimensions", 7),
    ("kept_starts", 0),
    ("start_iterations", 1001),
    ("step_iterations", 0),
    ("align_samples", 11),
    ("align_samples", 10_001),
    ("kept_maps", 0),
    ("align_rounds", 0),
    ("final_rounds", 0),
    ("slide_rounds", -1),
    ("slide_rounds", 1001),
    ("stiffness", 0.0),
    ("warp_stiffness", 1e12),
    ("affinity_values", 101),
    ("laplacian_values", -1),
    ("match_threshold", 1.5),
    ("selection", "best"),
    ("distances", "straight"),
    ("affinity", "cosine"),
    ("pairs", "all"),
    ("operators", []),
    ("operators", ["affinity", "graph"]),
]

WRONG_TYPES = [
    ("name", 3),
    ("degree", True),
    ("degree", 6.0),
    ("degree", "6"),
    ("degree", None),
    ("tau", True),
    ("tau", "0.3"),
    ("tau", [0.3]),
    ("unfold", 1),
    ("unfold", "true"),
    ("selection", 1),
    ("operators", "affinity"),
    ("operators", [1]),
    ("operators", {"affinity": 1}),
]


def test_every_field_but_the_name_has_another_value_here():
    assert set(OTHER) == set(FLAT_KEYS.values()) == DEFAULT.flat().keys() - {"name"}


def test_a_fingerprint_is_sixteen_hexadecimal_digits():
    for parameters in (DEFAULT, PAPER):
        assert re.fullmatch("[0-9a-f]{16}", parameters.fingerprint)


def test_the_name_is_no_part_of_the_fingerprint():
    assert DEFAULT.with_values(name="mine").fingerprint == DEFAULT.fingerprint


@pytest.mark.parametrize("field", OTHER)
def test_each_other_field_changes_the_fingerprint(field):
    assert DEFAULT.with_values(**{field: OTHER[field]}).fingerprint != DEFAULT.fingerprint


def test_fingerprints_of_all_these_differ():
    changed = [DEFAULT.with_values(**{field: value}).fingerprint for field, value in OTHER.items()]
    assert len({DEFAULT.fingerprint, PAPER.fingerprint, *changed}) == len(OTHER) + 2


def test_another_process_has_the_same_fingerprints():
    code = "from core.parameters import *; print(DEFAULT.fingerprint, PAPER.fingerprint)"
    for seed in ("1", "2"):
        out = subprocess.run(
            [sys.executable, "-c", code],
            env={"PYTHONHASHSEED": seed, "PYTHONPATH": ":".join(sys.path)},
            capture_output=True,
            text=True,
            check=True,
        ).stdout
        assert out.split() == [DEFAULT.fingerprint, PAPER.fingerprint]


@pytest.mark.parametrize("parameters", [DEFAULT, PAPER, DEFAULT.with_values(name="other", **OTHER)])
def test_json_and_back(parameters):
    back = Parameters.from_json(parameters.to_json())
    assert back == parameters
    assert back.fingerprint == parameters.fingerprint


def test_json_names_every_parameter_in_its_group():
    written = json.loads(DEFAULT.to_json())
    assert list(written) == ["name", *GROUPS]
    assert [name for group in GROUPS for name in written[group]] == list(FLAT_KEYS)


def test_files_of_flat_keys_and_of_groups_give_the_same_parameters():
    flat = {"name": "few", "form": False, "patches": False, "samples": 60, "operators": ["affinity"]}
    grouped = {
        "name": "few",
        "ranking": {"global_descriptors": False, "spin_images": False},
        "sampling": {"samples": 60},
        "spectral": {"operators": ["affinity"]},
    }
    mixed = {**grouped, "samples": 60}
    del mixed["sampling"]
    few = Parameters.from_json(json.dumps(flat))
    assert few == Parameters.from_json(json.dumps(grouped)) == Parameters.from_json(json.dumps(mixed))
    assert not few.ranking.spin_images
    assert few.sampling.samples == 60
    assert few.fingerprint != DEFAULT.fingerprint


@pytest.mark.parametrize("parameters", [DEFAULT, PAPER, DEFAULT.with_values(name="other", **OTHER)])
def test_flat_keys_and_back(parameters):
    stored = json.loads(json.dumps(parameters.flat()))
    assert Parameters.from_values(stored) == parameters
    assert Parameters.from_values(stored).fingerprint == parameters.fingerprint


def test_fingerprints_are_those_that_archives_hold():
    assert (DEFAULT.fingerprint, PAPER.fingerprint) == ("031027b8ecd7080c", "96d291f5f86ee06d")
    assert BEFORE_SMALLER_SURFACES.fingerprint == "c9065d54299484e4"
    assert BEFORE_ORIENTATION.fingerprint == "b305565604f61fe5"
    assert BEFORE_VIEWS.fingerprint == "2d613f0cec486b3d"


@pytest.mark.parametrize(
    "values",
    [
        {"fill_holes": 0.0},
        {"decimate_pieces_above": 0},
        {"refine_simplified": 0},
        {"smooth_refined": False},
        {"patches": False},
        {"views": False},
        {"orientation": False},
    ],
)
def test_a_parameter_that_stands_for_the_method_before_it_is_not_in_the_fingerprint(values):
    flat = DEFAULT.with_values(**values).flat()
    text = json.dumps(
        {"method": METHOD_VERSION} | {key: flat[key] for key in flat if key != "name" and key not in values},
        sort_keys=True,
    )
    wanted = hashlib.sha256(text.encode()).hexdigest()[:16]
    assert DEFAULT.with_values(**values).fingerprint == wanted


@pytest.mark.parametrize(
    ("values", "message"),
    [
        ({"samples": 60, "sampling": {"samples": 60}}, "samples is given more than once"),
        ({"patches": True, "spin_images": True}, "spin_images is given more than once"),
        ({"mesh": 3}, "mesh: input should be a valid dictionary"),
        ({"mesh": 3, "fill_holes": 0.1}, "mesh: input should be a valid dictionary"),
        ({"mesh": {"samples": 60}}, "unknown parameter 'mesh.samples'"),
        ({"ranking": {"patches": False}}, "unknown parameter 'ranking.patches'"),
        ({"degree": 13, "tau": 2.0}, "sampling.degree: .* 12; sampling.tau: .* 1"),
        ({"operators": ["affinity", "graph"]}, "spectral.operators.1: input should be 'affinity' or"),
    ],
)
def test_an_error_names_the_parameter_and_the_cause(values, message):
    with pytest.raises(ParameterError, match=message):
        Parameters.from_json(json.dumps(values))


def test_parameters_are_frozen_and_hashable():
    assert len({DEFAULT, PAPER, Parameters.from_values(PAPER.flat())}) == 2
    with pytest.raises(ValidationError, match="frozen"):
        DEFAULT.mesh.fill_holes = 0.5


def test_parameters_survive_the_way_to_another_process():
    assert pickle.loads(pickle.dumps(PAPER)) == PAPER


def test_fields_that_are_not_named_are_the_defaults():
    assert Parameters.from_json("{}") == DEFAULT
    assert Parameters.from_json('{"degree": 4, "name": "four"}') == DEFAULT.with_values(degree=4, name="four")


def test_a_whole_number_is_read_as_a_float_where_one_is_wanted():
    whole = Parameters.from_json('{"tau": 1, "width": 2}')
    assert whole == Parameters.from_json('{"tau": 1.0, "width": 2.0}')
    assert whole.fingerprint == Parameters.from_json('{"tau": 1.0, "width": 2.0}').fingerprint


@pytest.mark.parametrize(
    ("field", "whole"),
    [("tau", 1), ("width", 2), ("coverage_power", 0), ("stiffness", 100), ("match_threshold", -1)],
)
def test_a_whole_number_and_the_same_as_a_float_have_one_fingerprint(field, whole):
    one, other = (DEFAULT.with_values(**{field: value}) for value in (whole, float(whole)))
    assert one.fingerprint == other.fingerprint
    assert one.to_json() == other.to_json()


def test_a_whole_number_past_all_floats_is_refused():
    with pytest.raises(ParameterError, match=r"matching\.stiffness: input should be a valid number"):
        DEFAULT.with_values(stiffness=10**400)


@pytest.mark.parametrize("text", ["", "{", "degree: 4", '{"degree": }', "\x00"])
def test_text_that_is_not_json_is_refused(text):
    with pytest.raises(ParameterError, match="not JSON"):
        Parameters.from_json(text)


@pytest.mark.parametrize("text", ["[]", '[{"degree": 4}]', "3", "null", '"degree"', "true"])
def test_json_that_is_no_object_is_refused(text):
    with pytest.raises(ParameterError, match="JSON object"):
        Parameters.from_json(text)


@pytest.mark.parametrize("name", ["degrees", "", "fingerprint", "__class__", "from_json"])
def test_an_unknown_name_is_refused_and_the_known_are_told(name):
    with pytest.raises(ParameterError, match=r"unknown parameter .*known are name, fill_holes"):
        Parameters.from_json(json.dumps({name: 1}))


@pytest.mark.parametrize(("field", "value"), WRONG_TYPES)
def test_a_wrong_type_is_refused(field, value):
    with pytest.raises(ParameterError, match=field):
        Parameters.from_json(json.dumps({field: value}))


@pytest.mark.parametrize(("field", "value"), OUT_OF_RANGE)
def test_a_value_out_of_range_is_refused(field, value):
    with pytest.raises(ParameterError, match=field):
        Parameters.from_json(json.dumps({field: value}))
    with pytest.raises(ParameterError, match=field):
        DEFAULT.with_values(**{field: value})


FLOATS = [key for key, value in DEFAULT.flat().items() if isinstance(value, float)]


@pytest.mark.parametrize("field", FLOATS)
@pytest.mark.parametrize("value", ["NaN", "Infinity", "-Infinity"])
def test_a_value_that_is_not_a_number_is_refused(field, value):
    with pytest.raises(ParameterError):
        Parameters.from_json(f'{{"{field}": {value}}}')


def test_a_signature_must_hold_something():
    with pytest.raises(ParameterError, match="both be 0"):
        DEFAULT.with_values(affinity_values=0, laplacian_values=0)


def test_limits_themselves_are_allowed():
    DEFAULT.with_values(degree=12, tau=1.0, samples=12, search_samples=12, match_threshold=-1.0, seed=2**62)
    DEFAULT.with_values(decimate_above=0, decimate_to=0, sample_cap=12, affinity_values=0)
    DEFAULT.with_values(points=0, slide_rounds=0)
    DEFAULT.with_values(sign_starts=False, dimensions=20, first_dimensions=20, search_dimensions=0)


def test_many_first_dimensions_need_that_no_signs_are_tried():
    with pytest.raises(ParameterError, match="first_dimensions"):
        DEFAULT.with_values(sign_starts=True, dimensions=20, first_dimensions=20, search_dimensions=20)


def test_both_named_settings_are_valid_and_named():
    assert (DEFAULT.name, PAPER.name) == ("default", "paper")
    for parameters in (DEFAULT, PAPER):
        assert Parameters.from_values(parameters.flat()) == parameters


@pytest.mark.parametrize(
    "text", ['{"tau": 1' + "0" * 400 + "}", '{"seed": ' + "1" * 5000 + "}", "[" * 100000]
)
def test_monstrous_json_is_refused(text: str) -> None:
    with pytest.raises(ParameterError):
        Parameters.from_json(text)


def test_an_operator_is_named_once() -> None:
    with pytest.raises(ParameterError, match="differ"):
        DEFAULT.with_values(operators=("affinity", "affinity"))
