"""`isoshape table2`, against `isoshape evaluate` and against figures that are known."""

import json
import sys
from pathlib import Path

import numpy as np
import pytest

from core.evaluation.classification import ALL_CATEGORIES, METHODS, TABLE_2
from core.evaluation.retrieval_measures import Evaluation, evaluate
from service.cli.evaluation.table2 import BASELINES, compared, means, table
from tests.service.cli.conftest import Run


def figures(right: dict[str, bool]) -> Evaluation:
    """Two shapes a class, each of which finds the other first, or finds it last."""
    labels = [label for label in right for _ in range(2)]
    fellows = np.array([[a == b for b in labels] for a in labels])
    towards = np.array([1.0 if right[label] else -1.0 for label in labels])
    return evaluate(fellows * towards[:, None], labels, larger_is_closer=True)


def test_the_best_of_each_row_of_the_papers_table() -> None:
    best = [max(METHODS, key=row.accuracy.__getitem__) for row in TABLE_2]
    assert best == ["ours", "ours", "ours", "Parts", "ours", "MDS"]
    assert all(tuple(row.accuracy) == METHODS for row in TABLE_2)
    assert min(min(row.accuracy.values()) for row in TABLE_2) > 60.0
    assert max(max(row.accuracy.values()) for row in TABLE_2) < 90.0


def test_lines_are_the_papers_categories_then_the_other_classes() -> None:
    right = {"Zebra": True, "Cup": False, "Ant": True, "human": True}
    lines = compared({"cc": figures(right), "combined": figures(dict.fromkeys(right, True))})
    assert [(line.label, line.category.title if line.category else None) for line in lines] == [
        ("human", "Humans"),
        ("Cup", "Cups"),
        ("Ant", None),
        ("Zebra", None),
    ]
    assert [line.here["cc"] for line in lines] == [100.0, 0.0, 100.0, 100.0]
    assert means(lines) == {"cc": 75.0, "combined": 100.0}


def test_the_table_has_the_papers_columns_beside_ours() -> None:
    right = {"Human": True, "Cup": False, "Ant": True}
    headings, rows = table(compared({"cc": figures(right), "combined": figures(dict.fromkeys(right, True))}))
    assert headings == [
        *("category", "paper: ours", "paper: MDS", "paper: ICP", "paper: Parts", "paper: TPS-RPM"),
        *("here: cc", "here: combined"),
    ]
    assert rows == [
        ["Humans", "86.75", "83.69", "84.69", "86.45", "86.51", "100.0", "100.0"],
        ["Cups", "66.87", "67.38", "65.41", "60.24", "66.97", "0.0", "100.0"],
        ["mean of these 2", "76.81", "75.53", "75.05", "73.34", "76.74", "50.0", "100.0"],
        ["Ant", "", "", "", "", "", "100.0", "100.0"],
        ["mean of all 3 classes", "88.5 (of 16)", "", "", "", "", "66.7", "100.0"],
    ]


@pytest.mark.studies
def test_accuracies_are_those_of_evaluate(collection: Path, run: Run) -> None:
    done = run("table2", collection, "--limit", 6, "--json")
    assert (done.status, done.stderr) == (0, "")
    found = json.loads(done.stdout)
    assert (found["collection"], found["setting"], found["shapes"]) == ("made", "default", 6)
    assert found["mean"]["paper"] == ALL_CATEGORIES
    assert [row["class"] for row in found["classes"]] == ["cup", "octopus", "pliers"]
    assert found["classes"][0]["paper"] == dict(TABLE_2[-1].accuracy)
    evaluated = ("evaluate", collection, "--limit", 6, "--json")
    rankings = json.loads(run(*evaluated, "--rank-by", "all").stdout)
    reports = {report["rank_by"]: report for report in rankings if report["rank_by"] in {"cc", "combined"}}
    for method in BASELINES:
        reports[method] = json.loads(run(*evaluated, "--method", method).stdout)
    assert len(reports) == 5
    for name, report in reports.items():
        for row in found["classes"]:
            assert row["here"][name] == pytest.approx(100.0 * report["per_class"][row["class"]]["nn"])
        assert found["mean"]["here"][name] == pytest.approx(
            np.mean([100.0 * one["nn"] for one in report["per_class"].values()])
        )


def test_without_baselines_no_other_library_is_needed(
    collection: Path, run: Run, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, "lapy", None)
    asked = run("table2", collection)
    assert (asked.status, asked.stdout) == (2, "")
    assert "pip install isoshape[peers]" in asked.stderr
    done = run("table2", collection, "--no-baselines", "--limit", 4, "--setting", "paper")
    assert (done.status, done.stderr) == (0, "")
    assert "ShapeDNA" not in done.stdout
    assert "octopus" in done.stdout
