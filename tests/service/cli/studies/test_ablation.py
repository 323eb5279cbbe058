"""`isoshape ablation`, against `isoshape evaluate`."""

import json
from pathlib import Path

import pytest

from core.evaluation.retrieval_measures import evaluate
from core.parameters import DEFAULT, PAPER
from core.studies.ablation import Row
from service.cli.studies import ablation
from service.cli.studies.ablation import Finding, table
from tests.service.cli.conftest import CLASSES, Run, mesh_bytes

pytestmark = pytest.mark.studies

FEW = (
    Row("alone", "paper", PAPER, "cc"),
    Row("alone", "ranked", PAPER, "combined"),
    Row("together", "all", DEFAULT, "cc"),
)


@pytest.fixture
def few(monkeypatch: pytest.MonkeyPatch) -> list[bool]:
    """Three rows instead of all; whether each call asked for the third block."""
    asked: list[bool] = []

    def rows(*, without: bool) -> tuple[Row, ...]:
        asked.append(without)
        return FEW

    monkeypatch.setattr(ablation, "rows", rows)
    return asked


def test_rows_are_what_evaluate_says(collection: Path, run: Run, few: list[bool]) -> None:
    done = run("ablation", collection, "--limit", 6, "--json", "--without")
    assert done.status == 0
    assert few == [True]
    assert done.stderr.splitlines() == ["1 of 2: paper", "2 of 2: all"]
    found = json.loads(done.stdout)
    assert [(row["collection"], row["block"], row["row"], row["rank_by"]) for row in found] == [
        ("made", row.block, row.title, row.rank_by) for row in FEW
    ]
    assert [row["fingerprint"] for row in found] == [row.parameters.fingerprint for row in FEW]
    assert found[0]["changed"] == {}
    assert found[2]["changed"]["operators"] == ["affinity", "laplace-beltrami"]
    paper = run(
        "evaluate", collection, "--limit", 6, "--setting", "paper", "--rank-by", "all", "--json"
    ).stdout
    by_ranking = {report["rank_by"]: report for report in json.loads(paper)}
    default = json.loads(run("evaluate", collection, "--limit", 6, "--json").stdout)
    for row, report in zip(found, (by_ranking["cc"], by_ranking["combined"], default), strict=True):
        assert {name: row[name] for name in ("nn", "ft", "st", "shapes", "classes")} == {
            name: report[name] for name in ("nn", "ft", "st", "shapes", "classes")
        }


def test_two_folders_are_columns_of_one_table(tmp_path: Path, run: Run, few: list[bool]) -> None:
    for name in ("one", "two"):
        for label in CLASSES[:2]:
            (tmp_path / name / label).mkdir(parents=True)
            for pose in range(2):
                (tmp_path / name / label / f"{pose}.off").write_bytes(mesh_bytes(label, pose))
    (tmp_path / "two" / CLASSES[0] / "bad.off").write_bytes(b"OFF\n")
    done = run("ablation", tmp_path / "one", tmp_path / "two")
    assert done.status == 1
    assert done.stderr.splitlines()[-1] == "isoshape: 2 times a file could not be used"
    lines = done.stdout.splitlines()
    assert lines[0] == ("| `paper`, and each change alone | rank by | one NN | FT | ST | two NN | FT | ST |")
    assert [line.split(" | ")[:2] for line in lines if line.startswith(("| paper", "| +", "| all"))] == [
        ["| paper", "cc"],
        ["| + ranked", "combined"],
        ["| all", "cc"],
    ]
    for line in lines:
        cells = line.strip("|").split("|")
        assert line == "" or len(cells) == 8
        # The same shapes in both folders.
        assert line.startswith("| `") or cells[2:5] == cells[5:8]
    assert few == [False]


def test_a_table_has_its_figures_where_they_belong() -> None:
    labels = ["a", "a", "b", "b"]
    right = [[0, 1, 0, 0], [1, 0, 0, 0], [0, 0, 0, 1], [0, 0, 1, 0]]
    wrong = [[0, 0, 1, 1], [0, 0, 1, 1], [1, 1, 0, 0], [1, 1, 0, 0]]
    good, bad = (evaluate(scores, labels, larger_is_closer=True) for scores in (right, wrong))
    wanted = FEW[:2]
    text = table(
        wanted,
        [
            Finding("x", wanted[0], bad),
            Finding("x", wanted[1], good),
            Finding("y", wanted[0], good),
            Finding("y", wanted[1], bad),
        ],
    )
    assert text.splitlines()[2:] == [
        "| paper | cc | 0.000 | 0.000 | 0.000 | 1.000 | 1.000 | 1.000 |",
        "| + ranked | combined | 1.000 | 1.000 | 1.000 | 0.000 | 0.000 | 0.000 |",
    ]
