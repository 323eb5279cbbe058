"""Parameters: the fingerprint, JSON and back, and the ranges."""

import json
import pickle
import re

import pytest
from pydantic import ValidationError

from core.errors import ParameterError
from core.parameters import DEFAULT, GROUPS, PAPER, Parameters

VALUES = {
    "mesh": {
        "fill_holes": (0.2, [-0.1, 10.1]),
        "refine_vertices": (2001, [-1, 100001]),
        "decimate_pieces_above": (20000, [-1, 4000]),
        "refine_simplified": (2000, [-1, 100001]),
        "decimate_above": (50000, []),
        "decimate_to": (5000, [499, 8000]),
        "smooth_above": (0.3, [-0.1, 1001.0]),
        "smooth_rounds": (5, [0]),
        "smooth_refined": (False, []),
    },
    "sampling": {
        "degree": (7, [0, 13, True, 6.0, "6", None]),
        "epsilon": (0.02, [0.0, 0.15]),
        "normalise_weights": (False, []),
        "selection": ("random-draw", ["best", 1]),
        "coverage_power": (0.5, [-0.1, 4.1]),
        "seed": (1, [-1, 4611686018427387905]),
        "samples": (101, [11, 10001]),
        "tau": (0.4, [0.0, 1.01, True, "0.3", [0.3]]),
        "sample_cap": (300, [11]),
        "points": (600, [-1, 20001]),
    },
    "spectral": {
        "unfold": (False, [1, "true"]),
        "distances": ("graph", ["straight"]),
        "affinity": ("distance", ["cosine"]),
        "width": (1.6, [0.0, 1000000.0]),
        "operators": (
            ("laplace-beltrami", "affinity"),
            [[], ["affinity", "graph"], "affinity", [1], {"affinity": 1}],
        ),
        "dimensions": (9, [1, 51]),
        "eigenvalue_power": (0.25, [-0.5, 5.0]),
        "taper": (False, []),
        "affinity_values": (21, [101]),
        "laplacian_values": (16, [-1]),
    },
    "matching": {
        "search_samples": (65, [11, 10001]),
        "search_dimensions": (5, [2, 51]),
        "first_dimensions": (4, [1, 7]),
        "sign_starts": (False, []),
        "kept_starts": (4, [0]),
        "start_iterations": (6, [1001]),
        "step_iterations": (4, [0]),
        "stiffness": (10.0, [0.0]),
        "warp_stiffness": (0.02, [1000000000000.0]),
        "pairs": ("nearest", ["all"]),
        "align_samples": (63, [11, 10001]),
        "kept_maps": (3, [0]),
        "align_rounds": (5, [0]),
        "final_rounds": (4, [0]),
        "slide_rounds": (3, [-1, 1001]),
    },
}
"""Of each parameter another value than that of `default`, and values that are refused."""

OTHER = {group: {name: other for name, (other, _) in values.items()} for group, values in VALUES.items()}
EACH = [(group, name, value) for group, values in OTHER.items() for name, value in values.items()]
REFUSED = [
    (group, name, value)
    for group, values in VALUES.items()
    for name, (_, refused) in values.items()
    for value in refused
]


def test_every_parameter_has_another_value_here():
    values = DEFAULT.model_dump(exclude={"name"})
    assert {group: set(OTHER[group]) for group in OTHER} == {group: set(values[group]) for group in values}
    assert tuple(values) == GROUPS


def test_the_fingerprint_is_sixteen_digits_and_leaves_out_the_name():
    for parameters in (DEFAULT, PAPER):
        assert re.fullmatch("[0-9a-f]{16}", parameters.fingerprint)
    assert DEFAULT.with_values(name="mine").fingerprint == DEFAULT.fingerprint


def test_each_parameter_and_the_method_version_change_the_fingerprint(monkeypatch):
    changed = [DEFAULT.with_values(**{group: {name: value}}).fingerprint for group, name, value in EACH]
    assert len({DEFAULT.fingerprint, PAPER.fingerprint, *changed}) == len(EACH) + 2
    monkeypatch.setattr("core.parameters.METHOD_VERSION", 99)
    assert Parameters().fingerprint not in {DEFAULT.fingerprint, *changed}


@pytest.mark.parametrize("parameters", [DEFAULT, PAPER, DEFAULT.with_values(name="other", **OTHER)])
def test_json_and_back(parameters):
    for back in (
        Parameters.from_json(parameters.model_dump_json()),
        Parameters.from_values(json.loads(json.dumps(parameters.model_dump(mode="json")))),
        pickle.loads(pickle.dumps(parameters)),
    ):
        assert back == parameters
        assert back.fingerprint == parameters.fingerprint
    assert list(json.loads(parameters.model_dump_json())) == ["name", *GROUPS]


def test_values_that_are_not_named_stay():
    assert Parameters.from_json("{}") == DEFAULT
    few = Parameters.from_json('{"sampling": {"degree": 4}, "name": "four"}')
    assert few == DEFAULT.with_values(sampling={"degree": 4}, name="four")
    assert few.with_values(sampling={"tau": 0.4}).sampling.degree == 4
    assert few.with_values(sampling={"degree": 6}, name="default") == DEFAULT


def test_parameters_are_frozen_and_hashable():
    assert len({DEFAULT, PAPER, Parameters.from_json(PAPER.model_dump_json())}) == 2
    with pytest.raises(ValidationError, match="frozen"):
        DEFAULT.mesh.fill_holes = 0.5


@pytest.mark.parametrize(
    ("values", "message"),
    [
        ({"mesh": 3}, "mesh: input should be a valid dictionary"),
        ({"mesh": {"samples": 60}}, r"unknown parameter 'mesh.samples'; known are fill_holes, .*"),
        ({"samples": 60}, "unknown parameter 'samples'; known are name, mesh, sampling, .*"),
        ({"from_json": 1}, "unknown parameter 'from_json'"),
        ({"": 1}, "unknown parameter ''"),
        ({"name": 3}, "name: input should be a valid string"),
        ({"sampling": {"degree": 13, "tau": 2.0}}, "sampling.degree: .* 12; sampling.tau: .* 1"),
        ({"spectral": {"operators": ["affinity", "graph"]}}, "spectral.operators.1: input should be .*"),
        ({"spectral": {"operators": ["affinity", "affinity"]}}, "operators must differ"),
        ({"spectral": {"affinity_values": 0, "laplacian_values": 0}}, "must not both be 0"),
    ],
)
def test_an_error_names_the_parameter_and_the_cause(values, message):
    with pytest.raises(ParameterError, match=message):
        Parameters.from_json(json.dumps(values))
    with pytest.raises(ParameterError, match=message):
        DEFAULT.with_values(**values)


@pytest.mark.parametrize(
    ("group", "name", "whole"),
    [("sampling", "tau", 1), ("spectral", "width", 2), ("sampling", "coverage_power", 0)],
)
def test_a_whole_number_and_the_same_as_a_float_have_one_fingerprint(group, name, whole):
    first, second = (DEFAULT.with_values(**{group: {name: value}}) for value in (whole, float(whole)))
    assert first.fingerprint == second.fingerprint
    assert first.model_dump_json() == second.model_dump_json()
    assert Parameters.from_json(json.dumps({group: {name: whole}})) == first


def test_a_whole_number_past_all_floats_is_refused():
    with pytest.raises(ParameterError, match=r"matching\.stiffness: input should be a valid number"):
        DEFAULT.with_values(matching={"stiffness": 10**400})


@pytest.mark.parametrize(
    ("text", "message"),
    [
        *((text, "not JSON") for text in ("", "{", "degree: 4", '{"degree": }', "\x00", "[" * 100_000)),
        *((text, "JSON object") for text in ("[]", '[{"degree": 4}]', "3", "null", '"degree"', "true")),
        ('{"sampling": {"seed": ' + "1" * 5000 + "}}", "not JSON: .*digits"),
        *(
            (f'{{"sampling": {{"tau": {value}}}}}', "tau")
            for value in ("NaN", "Infinity", "-Infinity", "1" + "0" * 400)
        ),
    ],
)
def test_text_that_is_no_json_object_and_a_number_that_is_not_finite_are_refused(text, message):
    with pytest.raises(ParameterError, match=message):
        Parameters.from_json(text)


@pytest.mark.parametrize(("group", "name", "value"), REFUSED)
def test_a_wrong_type_or_a_value_out_of_range_is_refused(group, name, value):
    with pytest.raises(ParameterError, match=name):
        Parameters.from_json(json.dumps({group: {name: value}}))
    with pytest.raises(ParameterError, match=name):
        DEFAULT.with_values(**{group: {name: value}})


def test_limits_themselves_are_allowed():
    DEFAULT.with_values(
        sampling={"degree": 12, "tau": 1.0, "samples": 12, "seed": 2**62},
        matching={"search_samples": 12, "slide_rounds": 0},
    )
    DEFAULT.with_values(
        mesh={"decimate_above": 0, "decimate_to": 0},
        sampling={"sample_cap": 12, "points": 0},
        spectral={"affinity_values": 0},
    )


def test_many_first_dimensions_need_that_no_signs_are_tried():
    many = {"first_dimensions": 20, "search_dimensions": 20}
    with pytest.raises(ParameterError, match="first_dimensions"):
        DEFAULT.with_values(spectral={"dimensions": 20}, matching={"sign_starts": True, **many})
    DEFAULT.with_values(spectral={"dimensions": 20}, matching={"sign_starts": False, **many})
