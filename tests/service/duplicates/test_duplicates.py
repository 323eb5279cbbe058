"""Near-identical shapes: planted copies are found, and poses of one body are none."""

import csv
import io
import time
import zipfile
from collections.abc import Sequence
from functools import partial
from typing import Any
from xml.etree import ElementTree

import pytest
from sqlalchemy import delete

from core.arrays import Float32s
from core.embedding import Scores
from core.evaluation.perturbation import subdivide
from core.io import write_mesh
from core.matching.match_records import score_match_records
from core.mesh.mesh import Mesh
from core.parameters import Parameters
from core.registration.similarity import RESIDUAL
from service.client import Client
from service.compute import tasks
from service.duplicates.endpoints import XLSX
from service.duplicates.groups import Counted, Groups, Link
from service.duplicates.schemas import COLUMNS, FORMULA, MOST_IN_CELL, Duplicate, DuplicatesAnswer
from service.search import scoring
from service.shapes.schemas import SHAPE, Shape
from service.storage.tables import DuplicatePairRow, JudgedShapeRow
from tests.gallery import make_person, make_shape
from tests.service.http.test_disconnects import send
from tests.service.support import Running, assert_problem, wait_until, working_in
from tests.service.tasks import nap_instead, napping
from tests.studies.copies import moved, simplified
from tests.studies.machine_parts import Drawing, part

BODIES = ("person-0", "person-1", "person-2", "octopus-0", "octopus-1", "cup-0", "plane-0")
PLANTED = {
    "turned": ("person-0", "same", 1.0, partial(moved, seed=1)),
    "renamed": ("person-1", "same", 1.0, lambda mesh: mesh),
    "mirrored": ("person-2", "mirrored", 1.0, partial(moved, seed=2, mirrored=True)),
    "mirrored-and-larger": ("octopus-0", "mirrored", 3.0, partial(moved, seed=3, scale=3.0, mirrored=True)),
    "smaller": ("octopus-1", "scaled", 0.5, partial(moved, seed=4, scale=0.5)),
    "symmetric": ("cup-0", "same", 1.0, partial(moved, seed=5, mirrored=True)),
    "split": ("plane-0", "same", 1.0, lambda mesh: moved(subdivide(mesh, 0.4, 1), 6)),
    "simplified": ("plane-0", "same", 1.0, lambda mesh: moved(simplified(mesh), 7)),
}
"""Of each copy: the body, what the report calls it, its scale, and how it is made."""


def body(name: str) -> Mesh:
    label, pose = name.split("-")
    return make_person(0, int(pose)) if label == "person" else make_shape(label, int(pose))


@pytest.fixture(scope="module")
def planted(shared: Running) -> Running:
    shared.clear()
    for name in BODIES:
        shared.store(write_mesh(body(name), "off"), f"{name}.off", tags="original")
    for name, (of, _, _, copy) in PLANTED.items():
        shared.store(write_mesh(copy(body(of)), "off"), f"{name}.off", tags="copy")
    while shared.client.get("/duplicates").json()["unjudged"]:
        pass
    return shared


def unjudge(running: Running) -> None:
    """Forget all judgements, and what registration told."""
    running.container.relations.clear()
    with running.container.database.write() as session:
        session.execute(delete(DuplicatePairRow))
        session.execute(delete(JudgedShapeRow))


def test_every_copy_is_found_and_no_pose_is_taken_for_one(planted: Running) -> None:
    with Client(str(planted.client.base_url)) as client:
        answer = client.duplicates(scaled=True)
    assert answer.shapes == len(BODIES) + len(PLANTED)
    found = {(group[0].shape.name, one.shape.name): one for group in answer.groups for one in group[1:]}
    assert set(found) == {(f"{of}.off", f"{name}.off") for name, (of, *_) in PLANTED.items()}
    for name, (of, likeness, scale, _) in PLANTED.items():
        one = found[f"{of}.off", f"{name}.off"]
        assert one.likeness == likeness
        assert one.scale == pytest.approx(scale, rel=0.01)
        assert one.residual <= RESIDUAL
        assert one.cc >= 0.98


@pytest.mark.parametrize("scaled", [False, True])
@pytest.mark.parametrize("mirrored", [False, True])
def test_size_counts_unless_told_otherwise_and_hands_count_if_told(
    planted: Running, scaled: bool, mirrored: bool
) -> None:
    asked = {"scaled": True} if scaled else {}
    asked |= {} if mirrored else {"mirrored": False}
    groups = planted.client.get("/duplicates", params=asked).json()["groups"]
    assert {one["shape"]["name"] for group in groups for one in group[1:]} == {
        f"{name}.off"
        for name, (_, likeness, scale, _) in PLANTED.items()
        if (scaled or scale == 1.0) and (mirrored or likeness != "mirrored")
    }


@pytest.mark.parametrize("limit", [0, 1, 2, 1000])
def test_a_limit_leaves_the_first_groups_and_the_number_of_all(planted: Running, limit: int) -> None:
    whole = planted.client.get("/duplicates", params={"scaled": True}).json()
    few = planted.client.get("/duplicates", params={"scaled": True, "limit": limit}).json()
    assert len(whole["groups"]) == whole["total"] > 2
    assert few.pop("groups") == whole.pop("groups")[:limit]
    assert {**few, "milliseconds": None} == {**whole, "milliseconds": None}
    rows = planted.client.get("/duplicates", params={"scaled": True, "limit": limit, "format": "csv"}).text
    assert {int(row["group"]) for row in csv.DictReader(io.StringIO(rows))} == set(
        range(1, 1 + min(limit, whole["total"]))
    )


def test_a_limit_is_no_less_than_0(planted: Running) -> None:
    assert planted.client.get("/duplicates", params={"limit": -1}).status_code == 422


def test_as_csv(planted: Running) -> None:
    answer = planted.client.get("/duplicates", params={"format": "csv", "name": "plane"})
    assert answer.headers["content-type"].startswith("text/csv")
    assert answer.text == ",".join(COLUMNS) + "\r\n"
    whole = planted.client.get("/duplicates", params={"format": "csv", "scaled": True})
    rows = list(csv.DictReader(io.StringIO(whole.text)))
    assert len(rows) == len(BODIES) + len(PLANTED)
    assert {row["name"] for row in rows if row["likeness"] == "mirrored"} == {
        "mirrored.off",
        "mirrored-and-larger.off",
    }


def test_no_cell_is_a_formula() -> None:
    names = [*(f"{sign}HYPERLINK(1)" for sign in FORMULA), "1=2.off"]
    shapes = [Shape.model_validate({**SHAPE, "name": name}) for name in names]
    group = [Duplicate(shape=shape, likeness="same", scale=1.0, cc=1.0, residual=0.0) for shape in shapes]
    answer = DuplicatesAnswer(
        groups=[group], total=1, shapes=len(names), compared=0, aligned=0, milliseconds={}
    )
    rows = csv.DictReader(io.StringIO(answer.csv(), newline=""))
    assert [row["name"] for row in rows] == [*(f"'{name}" for name in names[:-1]), names[-1]]


def test_a_cell_of_a_workbook_has_whole_paths() -> None:
    paths = [f"/models/{number:03}{'x' * 600}.off" for number in range(100)]
    shape = Shape.model_validate(SHAPE)
    one = Duplicate(shape=shape, likeness="same", scale=1.0, cc=1.0, residual=0.0, paths=paths)
    made = DuplicatesAnswer(groups=[[one]], total=1, shapes=1, compared=0, aligned=0, milliseconds={})
    told = cells_of(made.xlsx())[1][-1].split("\n")
    assert told == paths[: len(told)]
    assert len("\n".join(told)) <= MOST_IN_CELL < len("\n".join(paths[: len(told) + 1]))


def test_a_workbook_has_the_rows_of_the_csv(planted: Running) -> None:
    wanted = {"scaled": True, "format": "xlsx"}
    answer = planted.client.get("/duplicates", params=wanted)
    assert (answer.headers["content-type"], answer.headers["cache-control"]) == (XLSX, "no-store")
    shape = Shape.model_validate({**SHAPE, "name": "=1+2"})
    named = Duplicate(shape=shape, likeness="same", scale=0.5, cc=1.0, residual=0.0, decision="different")
    made = DuplicatesAnswer(groups=[[named]], total=1, shapes=1, compared=0, aligned=0, milliseconds={})
    cells = ["1", shape.id, "=1+2", "same", "0.5", "1", "0", "", "different"]
    assert cells_of(made.xlsx()) == [list(COLUMNS), cells[:7] + cells[8:]]
    rows = csv.reader(io.StringIO(planted.client.get("/duplicates", params={**wanted, "format": "csv"}).text))
    texts = [[cell for cell in row if cell] for row in rows]
    for row, other in zip(cells_of(answer.content), texts, strict=True):
        assert row[:4] == other[:4]


def cells_of(workbook: bytes) -> list[list[str]]:
    """The cells of a workbook that are not empty, as ECMA-376 has them. No cell is a formula."""
    main = "{http://schemas.openxmlformats.org/spreadsheetml/2006/main}"
    with zipfile.ZipFile(io.BytesIO(workbook)) as parts:
        strings = ElementTree.fromstring(parts.read("xl/sharedStrings.xml"))
        sheet = ElementTree.fromstring(parts.read("xl/worksheets/sheet1.xml"))
    texts = [string.findtext(f"{main}t", "") for string in strings]
    assert sheet.find(f".//{main}f") is None
    return [
        [
            texts[int(value)] if cell.get("t") == "s" else value
            for cell in row
            if (value := cell.findtext(f"{main}v"))
        ]
        for row in sheet.iter(f"{main}row")
    ]


def test_the_work_of_a_client_that_goes_away_is_stopped(
    planted: Running, monkeypatch: pytest.MonkeyPatch
) -> None:
    work, compared = planted.container.queue, []
    unjudge(planted)

    def slowly(query: Float32s, rows: Sequence[Float32s], parameters: Parameters) -> Scores:
        compared.append(len(rows))
        time.sleep(0.1)
        return score_match_records(query, rows, parameters)

    with monkeypatch.context() as patch:
        patch.setattr(scoring, "score_match_records", slowly)
        with send(planted, "/duplicates", method="GET"):
            wait_until(lambda: compared, seconds=60)
        wait_until(lambda: not work.inside, seconds=5)
        time.sleep(0.5)
        known = len(compared)
        time.sleep(0.5)
        assert len(compared) == known < len(BODIES) + len(PLANTED)
    unjudge(planted)
    with monkeypatch.context() as patch:
        patch.setattr(tasks, "registered", nap_instead)
        with send(planted, "/duplicates", method="GET"):
            wait_until(lambda: napping(planted.container.pool), seconds=60)
        wait_until(
            lambda: not work.inside and not any(slot.busy for slot in planted.container.pool._slots),
            seconds=30,
        )


def test_filters_and_bounds(planted: Running) -> None:
    client = planted.client
    originals = client.get("/duplicates", params={"tag": "original"}).json()
    assert (originals["groups"], originals["shapes"]) == ([], len(BODIES))
    whole = client.get("/duplicates", params={"name": "symmetric"}).json()
    assert (whole["groups"], whole["shapes"]) == ([], 1)
    for wrong in ({"max_residual": 0.0}, {"format": "xml"}, {"colour": "red"}):
        assert_problem(client.get("/duplicates", params=wrong), 422, "bad-request-fields")


def test_stricter_limits_choose_among_the_kept_pairs(planted: Running) -> None:
    def pairs(**limits: float) -> dict[str, float]:
        groups = planted.client.get("/duplicates", params={"scaled": True, **limits}).json()["groups"]
        return {one["shape"]["name"]: one["residual"] for group in groups for one in group[1:]}

    everything = pairs()
    few = {name: residual for name, residual in everything.items() if residual <= 1e-4}
    assert 0 < len(few) < len(everything)
    assert pairs(max_residual=1e-4) == few


def test_a_limit_looser_than_that_of_the_kept_pairs_is_refused_with_the_bound(planted: Running) -> None:
    answer = planted.client.get("/duplicates", params={"max_residual": 0.004})
    problem = assert_problem(answer, 422, "bad-request-fields")
    assert [error["field"] for error in problem["errors"]] == ["max_residual"]
    assert "0.003" in problem["detail"]


def test_scale_and_mirroring_are_those_along_the_links() -> None:
    groups = Groups()
    groups.join(Link(2, 3, 0.99, 0.001, 2.0, mirrored=True))
    groups.join(Link(1, 3, 0.98, 0.002, 4.0, mirrored=True))
    groups.join(Link(7, 9, 1.0, 0.0, 1.0, mirrored=False))
    assert groups.joined(1, 2)
    assert not groups.joined(1, 9)
    first, second = groups.members({1, 2, 3, 7, 9, 11}, Counted(scaled=True))
    assert [(one.shape, one.likeness, one.scale) for one in first] == [
        (1, "same", 1.0),
        (2, "scaled", 2.0),
        (3, "mirrored", 4.0),
    ]
    assert [one.shape for one in second] == [7, 9]
    # A shape that is not shown still joins the others.
    (through,) = groups.members({1, 2, 9}, Counted(scaled=True))
    assert [(one.shape, one.likeness, one.scale) for one in through] == [(1, "same", 1.0), (2, "scaled", 2.0)]


def test_the_columns_name_the_numbers_of_the_pair_of_a_shape() -> None:
    """The second shape is found by its pair with the third, and its size is that over the first."""
    groups = Groups()
    groups.join(Link(1, 3, 0.98, 0.002, 4.0, mirrored=False))
    groups.join(Link(2, 3, 0.99, 0.001, 2.0, mirrored=False))
    ((_, second, _),) = groups.members({1, 2, 3}, Counted(scaled=True))
    shape = Shape.model_validate({**SHAPE})
    numbers = {"scale": second.scale, "cc": second.cc, "residual": second.residual}
    group = [Duplicate(shape=shape, likeness=second.likeness, **numbers)]
    made = DuplicatesAnswer(groups=[group], total=1, shapes=1, compared=0, aligned=0, milliseconds={})
    (row,) = csv.DictReader(io.StringIO(made.csv(), newline=""))
    assert (row["scale"], row["pair_cc"], row["pair_residual"]) == ("2.0", "0.99", "0.001")


def test_a_group_of_copies_falls_apart_by_size_and_hand() -> None:
    """Two sizes, two hands: only the oldest of each size is compared with the first."""
    groups = Groups()
    for shape, scale, mirrored in ((3, 2.0, False), (4, 1.01, False), (5, 1.0, True), (6, 2.0, True)):
        groups.join(Link(1, shape, 1.0, 0.0, scale, mirrored))
    groups.join(Link(2, 6, 1.0, 0.0, 1.0, mirrored=True))

    def found(**counted: bool) -> list[list[tuple[int, str]]]:
        members = groups.members({1, 2, 3, 4, 5, 6}, Counted(**counted))
        return [[(one.shape, one.likeness) for one in group] for group in members]

    assert found() == [
        [(1, "same"), (4, "same"), (5, "mirrored")],
        [(2, "same"), (3, "same"), (6, "mirrored")],
    ]
    assert found(mirrored=False) == [[(1, "same"), (4, "same")], [(2, "same"), (3, "same")]]
    (hand, other) = found(scaled=True, mirrored=False)
    assert [shape for shape, _ in hand] == [1, 2, 3, 4]
    assert other == [(5, "same"), (6, "scaled")]
    assert len(*found(scaled=True)) == 6


def difference(before: int, after: int) -> dict[str, Any]:
    """A difference of variants by its numbers of through holes."""
    here = (10.0, 5.0, 3.0)
    corners = {"point": here, "low": here, "high": here, "sides": (here, here)}
    return {**corners, "distance": 2.0, "volume": 0.5, "area": 1.0, "through_holes": (before, after)}


def test_a_variant_has_the_difference_along_its_link_or_that_of_its_copy() -> None:
    groups = Groups()
    groups.join(Link(1, 4, 0.9, 0.001, 1.0, mirrored=False, variant=True, difference=difference(3, 4)))
    groups.join(Link(3, 4, 1.0, 0.0, 1.0, mirrored=False))
    # The pair of the first with this shape is not kept.
    groups.join(Link(2, 3, 0.9, 0.001, 1.0, mirrored=False, variant=True, difference=difference(5, 4)))
    (group,) = groups.members({1, 2, 3, 4}, Counted())
    assert [(one.shape, one.likeness, one.compared_with) for one in group] == [
        (1, "same", None),
        (2, "variant", 3),
        (3, "variant", 1),
        (4, "variant", 1),
    ]
    texts = [one.difference.text for one in group if one.difference is not None]
    holes = ["5 through holes instead of 4", *["4 through holes instead of 3"] * 2]
    assert [text.partition(",")[0] for text in texts] == holes
    assert texts[0].endswith("100 % more volume")


def test_a_copy_has_the_difference_of_a_variant_in_its_own_size() -> None:
    groups = Groups()
    groups.join(Link(1, 4, 0.9, 0.001, 2.0, mirrored=False, variant=True, difference=difference(3, 4)))
    groups.join(Link(3, 4, 1.0, 0.0, 0.5, mirrored=False))
    (group,) = groups.members({1, 3}, Counted(scaled=True))
    (variant,) = (one.difference for one in group if one.difference is not None)
    # The coordinates are those of the first.
    assert (variant.scale, group[1].scale) == (4.0, 4.0)
    assert (variant.low, variant.distance) == ((10.0, 5.0, 3.0), 2.0)
    assert variant.text.startswith("at equal size: 4 through holes instead of 3, at (10, 5, 3), in a box")


@pytest.mark.parametrize("shown", [{1, 2, 3, 5}, {1, 3, 5}])
def test_a_copy_has_no_coordinates_of_the_shape_between(shown: set[int]) -> None:
    """The fifth shape is a copy of the second, which is a variant of the third; the third is older."""
    groups = Groups()
    groups.join(Link(1, 3, 1.0, 0.0, 1.0, mirrored=False))
    groups.join(Link(2, 3, 0.9, 0.001, 0.5, mirrored=False, variant=True, difference=difference(5, 4)))
    groups.join(Link(2, 5, 1.0, 0.0, 3.0, mirrored=False))
    (group,) = groups.members(shown, Counted(scaled=True))
    told = {one.shape: one.difference for one in group if one.difference is not None}
    if second := told.get(2):
        assert (second.scale, second.point, second.distance) == (2.0, (10.0, 5.0, 3.0), 2.0)
    fifth = told[5]
    assert (group[-1].compared_with, group[-1].scale, fifth.scale) == (3, 6.0, 6.0)
    assert (fifth.point, fifth.low, fifth.high) == (None, None, None)
    # The third shape is half as large as the second.
    assert (fifth.distance, fifth.sides) == (1.0, ((5.0, 2.5, 1.5),) * 2)
    assert fifth.text == "at equal size: 5 through holes instead of 4; 100 % more volume"


def test_a_variant_of_a_group_says_what_differs(planted: Running) -> None:
    with working_in(planted, "plates") as plates:
        for number, change in enumerate(("hole", None, None)):
            mesh = part("plate", Drawing(8, 0.1, 0.3 * number, change))
            plates.store(write_mesh(moved(mesh, number), "stl"), f"{number}.stl")
        (group,) = plates.client.get("/duplicates", params={"variants": True}).json()["groups"]
        first, *others = group
        compared = {"first": first["shape"]["id"], "second": others[0]["shape"]["id"]}
        told = plates.client.post("/compare", json=compared).json()["difference"]
        table = plates.client.get("/duplicates", params={"variants": True, "format": "csv"}).text
        plates.clear()
    assert planted.client.delete("/collections/plates").status_code == 204
    assert first["difference"] is None
    assert told["text"].startswith("3 through holes instead of 4, at (")
    assert others[0]["difference"] == told
    for one in others:
        assert (one["likeness"], one["compared_with"]) == ("variant", first["shape"]["id"])
        assert one["difference"]["text"].startswith("3 through holes instead of 4, at (")
    rows = list(csv.DictReader(io.StringIO(table, newline="")))
    assert [row["difference"] for row in rows] == ["", *(one["difference"]["text"] for one in others)]
