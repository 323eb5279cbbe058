"""`isoshape correspondence`, against the study of each body."""

import json
from dataclasses import asdict

import pytest

from core.parameters import DEFAULT
from core.studies.correspondence import study_body
from service.cli.studies import correspondence


@pytest.fixture(scope="module")
def expected():
    return study_body("pliers", 0, 2, DEFAULT)


def test_the_object_and_the_table(run, expected):
    options = ("--only", "pliers", "--poses", 2)
    done = run("correspondence", *options, "--json", "--check")
    assert (done.status, done.stderr) == (0, "")
    found = json.loads(done.stdout)
    assert found["classes"]["pliers"]["bodies"] == [json.loads(json.dumps(asdict(expected)))]
    assert found["mean"] == found["classes"]["pliers"]["mean"] == pytest.approx(expected.vertices)
    done = run("correspondence", *options)
    assert f"{expected.vertices:.3f}" in done.stdout
    assert f"{expected.samples:.3f}" in done.stdout


def test_a_class_over_the_limit_fails_the_check(run, monkeypatch):
    monkeypatch.setattr(correspondence, "MOST_ERROR", -1.0)
    done = run("correspondence", "--only", "pliers", "--poses", 2, "--check")
    assert done.status == 1
    assert "above -1.0 for pliers" in done.stderr


def test_an_unknown_class(run):
    done = run("correspondence", "--only", "unicorn")
    assert done.status == 2
    assert "unicorn" in done.stderr
