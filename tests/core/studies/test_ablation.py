"""The settings between `paper` and `default`."""

import pytest

from core.parameters import DEFAULT, PAPER, Parameters
from core.studies import ablation
from core.studies.ablation import LAST, NAMED, changes, rows, values_of


def differing(first: Parameters, second: Parameters) -> set[str]:
    one, other = values_of(first), values_of(second)
    return {name for name in one if one[name] != other[name]}


def test_the_changes_part_the_whole_difference() -> None:
    listed = [name for change in changes() for name in change.fields]
    assert len(listed) == len(set(listed))
    assert differing(PAPER, DEFAULT) <= set(listed)
    for change in changes():
        if change is LAST[0]:
            continue
        assert differing(PAPER, DEFAULT) & set(change.fields), f"{change.title}: nothing changes"


def test_a_parameter_that_no_row_names_is_one_more_row(monkeypatch: pytest.MonkeyPatch) -> None:
    left_out = next(change for change in NAMED if change.fields == ("stiffness",))
    monkeypatch.setattr(ablation, "NAMED", tuple(change for change in NAMED if change is not left_out))
    last = changes()[-1 - len(LAST)]
    assert "stiffness" in last.fields
    assert "stiffness" in last.title
    together = [row for row in rows() if row.block == "together"]
    assert together[-1].parameters.fingerprint == DEFAULT.fingerprint


def test_alone_is_the_paper_but_for_one_change() -> None:
    alone = [row for row in rows() if row.block == "alone"]
    assert [row.title for row in alone] == ["paper", *(change.title for change in changes())]
    assert alone[0].parameters == alone[-1].parameters == PAPER
    assert [row.rank_by for row in alone] == ["cc"] * (len(alone) - len(LAST)) + ["combined"] * len(LAST)
    for row, change in zip(alone[1:], changes(), strict=True):
        changed = differing(row.parameters, PAPER)
        assert changed == differing(PAPER, DEFAULT) & set(change.fields)
        assert not differing(row.parameters, DEFAULT) & set(change.fields)


def test_together_goes_from_the_paper_to_the_default() -> None:
    together = [row for row in rows() if row.block == "together"]
    assert together[0].parameters == PAPER
    for before, after, change in zip(together, together[1:], changes(), strict=False):
        assert differing(before.parameters, after.parameters) == differing(PAPER, DEFAULT) & set(
            change.fields
        )
    assert [row.rank_by for row in together[-2:]] == ["cc", "combined"]
    assert together[-2].parameters == together[-1].parameters
    assert together[-1].parameters.fingerprint == DEFAULT.fingerprint


def test_without_is_the_default_but_for_one_change() -> None:
    assert not [row for row in rows() if row.block == "without"]
    without = [row for row in rows(without=True) if row.block == "without"]
    for rank_by in ("cc", "combined"):
        whole, *others = [row for row in without if row.rank_by == rank_by]
        steps = [change for change in changes() if change.rank_by == rank_by and change.fields]
        assert whole.parameters == DEFAULT
        for row, change in zip(others, steps, strict=True):
            assert differing(row.parameters, DEFAULT) == differing(PAPER, DEFAULT) & set(change.fields)


def test_every_row_is_what_its_file_of_parameters_gives_back() -> None:
    for row in rows(without=True):
        read = Parameters.from_json(row.parameters.to_json())
        assert read.with_values(name=row.parameters.name) == row.parameters
