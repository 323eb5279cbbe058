"""`isoshape correspondence`, against the study of each body."""

import json
from dataclasses import asdict

import pytest

from core.evaluation.correspondence_errors import study_body, study_individuals
from core.parameters import DEFAULT
from service.cli.evaluation import correspondence
from tests.service.evaluation.test_template_truth import write_truth

pytestmark = pytest.mark.studies


@pytest.fixture(scope="module")
def expected():
    return study_body("pliers", 0, 2, DEFAULT)


def test_the_object_and_the_table(run, expected):
    options = ("--only", "pliers", "--poses", 2)
    done = run("correspondence", *options, "--json", "--check")
    assert (done.status, done.stderr) == (0, "")
    found = json.loads(done.stdout)
    assert found["classes"]["pliers"]["bodies"] == [json.loads(json.dumps(asdict(expected)))]
    assert found["mean"] == found["classes"]["pliers"]["mean"] == pytest.approx(expected.mean("vertices"))
    done = run("correspondence", *options)
    assert f"{expected.mean('vertices'):.3f}" in done.stdout
    assert f"{expected.mean('samples'):.3f}" in done.stdout


def test_a_class_over_the_limit_fails_the_check(run, monkeypatch):
    monkeypatch.setattr(correspondence, "MOST_ERROR", -1.0)
    done = run("correspondence", "--only", "pliers", "--poses", 2, "--check")
    assert done.status == 1
    assert "above -1.0 for pliers" in done.stderr


def test_individuals_are_matched_with_each_other(run):
    done = run("correspondence", "--only", "hand", "--individuals", "--bodies", 2, "--json")
    assert (done.status, done.stderr) == (0, "")
    expected = study_individuals("hand", 2, DEFAULT)
    assert json.loads(done.stdout)["classes"]["hand"]["bodies"] == [json.loads(json.dumps(asdict(expected)))]


@pytest.mark.parametrize("options", [(), ("--bodies", 2, "--remeshed")])
def test_individuals_need_a_second_body_and_have_meshes_of_their_own(run, options):
    done = run("correspondence", "--individuals", *options)
    assert done.status == 2
    assert "--bodies of at least 2" in done.stderr


def test_an_unknown_class(run):
    done = run("correspondence", "--only", "unicorn")
    assert done.status == 2
    assert "unicorn" in done.stderr


@pytest.fixture
def folder(tmp_path):
    return write_truth(tmp_path, "pliers", "pliers")


def test_a_folder_with_truth_beside_pyfmaps(run, folder):
    done = run("correspondence", "--truth", folder, "--pairs", 1, "--seed", 1, "--peers", "--json")
    assert (done.status, done.stderr) == (0, "")
    found = json.loads(done.stdout)
    assert set(found) == {"same", "different", "pyfmaps", "pyfmaps_oriented"}
    for kinds in (found, found["pyfmaps"], found["pyfmaps_oriented"]):
        assert kinds["different"] is None
        assert kinds["same"]["pairs"] == 1
        assert 0.0 <= kinds["same"]["symmetric"]["mean"] <= kinds["same"]["direct"]["mean"]
        assert kinds["same"]["seconds"]["mean"] > 0.0
    assert found["same"]["symmetric"]["mean"] <= 0.06
    done = run("correspondence", "--truth", folder, "--pairs", 1, "--seed", 1)
    assert f"{found['same']['direct']['median']:.3f}" in done.stdout


def test_a_folder_without_truth(run, tmp_path):
    done = run("correspondence", "--truth", tmp_path)
    assert done.status != 0
    assert "labels.csv" in done.stderr


def test_peers_that_are_not_installed(run, folder, monkeypatch):
    monkeypatch.setattr(correspondence, "find_spec", lambda _: None)
    done = run("correspondence", "--truth", folder, "--peers")
    assert done.status == 2
    assert "pip install isoshape[peers]" in done.stderr
