"""Folders of meshes with truth, and errors against it."""

import numpy as np
import pytest

from core.io import write_mesh
from service.datasets import DatasetError
from service.evaluation.template_truth import OURS, TimedErrors, read_truth, study_truth, summary
from tests.gallery import make_body


def write_truth(folder, *labels):
    """Write poses of one body, the template of all, with their classes and the truth."""
    body = make_body("pliers", 0, vertices=400)
    rows = ["file,class,template"]
    for pose, label in enumerate(labels):
        (folder / f"{pose}.off").write_bytes(write_mesh(body.posed(pose), "off"))
        for ending, row in ((".vts", 0), (".sym.vts", 1)):
            np.savetxt(folder / f"{pose}{ending}", body.partners(body)[row] + 1, fmt="%d")
        rows.append(f"{pose}.off,{label},pliers")
    (folder / "labels.csv").write_text("\n".join(rows))
    return folder


@pytest.fixture
def folder(tmp_path):
    return write_truth(tmp_path, "near", "near", "far")


def test_pairs_of_one_class_and_of_two(folder):
    files = read_truth(folder)
    assert [(file.path.name, file.label, file.template) for file in files] == [
        ("0.off", "near", "pliers"),
        ("1.off", "near", "pliers"),
        ("2.off", "far", "pliers"),
    ]
    found = study_truth(files, 3, 0, 1, (OURS,))[OURS]
    assert (len(found["same"]), len(found["different"])) == (2, 3)
    for errors in found.values():
        told = summary(errors)
        assert 0.0 <= told["symmetric"]["mean"] <= min(0.06, told["direct"]["mean"])


def test_means_and_medians_over_pairs():
    errors = [TimedErrors(0.1, 0.01, 1.0), TimedErrors(0.2, 0.02, 2.0), TimedErrors(0.6, 0.09, 6.0)]
    told = summary(errors)
    assert told["pairs"] == 3
    assert told["direct"] == pytest.approx({"mean": 0.3, "median": 0.2})
    assert told["symmetric"] == pytest.approx({"mean": 0.04, "median": 0.02})
    assert told["seconds"] == pytest.approx({"mean": 3.0, "median": 2.0})


@pytest.mark.parametrize(
    ("name", "text", "message"),
    [
        ("labels.csv", "file\n0.off\n", "the columns file and class"),
        ("labels.csv", "file,class\n9.off,a\n", "9.vts"),
        ("0.vts", "1\nx\n", "0.vts"),
        ("0.sym.vts", "1\n", "different lengths"),
        ("1.vts", "1\n", "different lengths"),
    ],
)
def test_a_fault_of_the_folder_is_named(folder, name, text, message):
    (folder / name).write_text(text)
    if name == "1.vts":
        (folder / "1.sym.vts").unlink()
    with pytest.raises(DatasetError, match=message):
        study_truth(read_truth(folder), 9, 0, 1, (OURS,))
