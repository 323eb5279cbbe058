"""Plates of several parts in one file, over HTTP."""

import re
from io import StringIO
from typing import Any

import pytest
from rich.console import Console

from core.io import write_mesh
from core.mesh.mesh import Mesh
from service.cli.query import print_answer
from service.search.schemas import QueryAnswer
from service.storage.tables import PieceRow
from tests.service.engines import on_both
from tests.service.support import Running, query
from tests.studies.machine_parts import Drawing, part
from tests.studies.print_plates import joined, mirror_image, plate

pytestmark = on_both

BRACKET = part("bracket", Drawing(5, 0.3))
FINER = part("bracket", Drawing(5, 0.1, 0.4))
SHAFT = part("shaft", Drawing(2, 0.5))
STORED = {
    "pair": plate([BRACKET, BRACKET]),
    "six": plate([BRACKET] * 6),
    "mixed": plate([FINER, SHAFT, mirror_image(BRACKET), SHAFT, FINER]),
    "unlike": plate([part("bracket", Drawing(6, 0.3))] * 4),
    "bracket": BRACKET,
    "shaft": SHAFT,
    "another shaft": part("shaft", Drawing(3, 0.5)),
}
TAGS = {name: "plate" if name in ("pair", "six", "mixed") else "other" for name in STORED}


def file_of(mesh: Mesh) -> bytes:
    return write_mesh(mesh, "stl")


@pytest.fixture(scope="module")
def stocked(shared: Running) -> dict[str, str]:
    shared.clear()
    return {
        name: shared.store(file_of(mesh), f"{name}.stl", tags=TAGS[name])["id"]
        for name, mesh in STORED.items()
    }


def likenesses(results: list[dict[str, Any]]) -> dict[str, tuple[str, str | None]]:
    """The likeness and the words of each result, in their order."""
    return {
        each["shape"]["name"][:-4]: (each["likeness"], each["instances"] and each["instances"]["text"])
        for each in results
    }


CONTAINING = {
    "six": ("part_of", "Contains it 6 times"),
    "mixed": ("part_of", "Contains it 2 times, its mirror image once"),
    "pair": ("part_of", "Contains it 2 times"),
}


@pytest.mark.parametrize("rank_by", ["cc", "combined"])
def test_plates_are_found_for_a_part(shared: Running, stocked: dict[str, str], rank_by: str) -> None:
    """Copies alone have so high a CC: the plates are further shapes, those with more instances first."""
    asked = {"rank_by": rank_by, "min_cc": 0.9999, "top_k": 3}
    answer = query(shared.client, file_of(BRACKET), "query.stl", **asked).json()
    assert likenesses(answer["results"]) == {"bracket": ("same", None)}
    assert list(likenesses(answer["parts"]).items()) == list(CONTAINING.items())
    assert [each["rank"] for each in answer["parts"]] == [2, 3, 4]
    of_stored = shared.client.get(f"/shapes/{stocked['bracket']}/similar", params=asked).json()
    assert (of_stored["results"], of_stored["matched"]) == ([], True)
    assert list(likenesses(of_stored["parts"])) == list(CONTAINING)
    two = query(shared.client, file_of(BRACKET), "query.stl", **{**asked, "top_k": 2}).json()
    assert list(likenesses(two["parts"])) == list(CONTAINING)[:2]


def test_filters_hold_for_plates_too(shared: Running, stocked: dict[str, str]) -> None:
    asked = {"min_cc": 0.9999, "tag": "plate", "exclude": stocked["six"]}
    answer = query(shared.client, file_of(BRACKET), "query.stl", **asked).json()
    assert list(likenesses(answer["parts"])) == ["mixed", "pair"]


def test_parts_are_found_for_a_plate(shared: Running, stocked: dict[str, str]) -> None:
    again = joined([STORED["mixed"]])
    answer = query(shared.client, file_of(again), "query.stl", min_cc=0.9999).json()
    assert likenesses(answer["results"]) == {"mixed": ("same", None)}
    assert likenesses(answer["parts"]) == {
        "bracket": ("part_of", "Part of it, 2 times, its mirror image once"),
        "shaft": ("part_of", "Part of it, 2 times"),
    }


def test_pieces_of_nearly_one_size_count_once(shared: Running, stocked: dict[str, str]) -> None:
    """The plate has three shafts, and two pieces of which the bracket may be an instance."""
    larger = Mesh(1.005 * BRACKET.vertices, BRACKET.faces)
    asked = {"min_cc": 0.9999, "top_k": 1}
    answer = query(shared.client, file_of(plate([BRACKET, larger, *[SHAFT] * 3])), "query.stl", **asked)
    assert list(likenesses(answer.json()["parts"])) == ["shaft"]


def test_a_plate_among_the_results_has_the_same_words(shared: Running, stocked: dict[str, str]) -> None:
    answer = query(shared.client, file_of(BRACKET), "query.stl", top_k=20).json()
    assert answer["parts"] == []
    told = likenesses(answer["results"])
    assert {name: told[name] for name in CONTAINING} == CONTAINING
    assert "part_of" not in {told[name][0] for name in ("unlike", "shaft", "another shaft", "bracket")}


def test_the_table_of_the_command_has_the_plates(shared: Running, stocked: dict[str, str]) -> None:
    answer = query(shared.client, file_of(BRACKET), "query.stl", min_cc=0.9999, top_k=2).json()
    printed = StringIO()
    print_answer(Console(file=printed, width=200), QueryAnswer.model_validate(answer))
    lines = [line.strip() for line in printed.getvalue().splitlines() if line.strip()]
    rows = [re.split(" {2,}", line)[:3] for line in lines[-3:]]
    assert rows == [
        ["1", "bracket.stl", "Same part"],
        ["2", "six.stl", "Contains it 6 times"],
        ["3", "mixed.stl", "Contains it 2 times, its mirror image once"],
    ]


def test_a_comparison_says_which_is_part_of_which(shared: Running, stocked: dict[str, str]) -> None:
    for first, second, text in (
        ("bracket", "six", "Contains it 6 times"),
        ("six", "bracket", "Part of it, 6 times"),
        ("shaft", "mixed", "Contains it 2 times"),
    ):
        compared = shared.client.post(
            "/compare", json={"first": stocked[first], "second": stocked[second]}
        ).json()
        assert (compared["likeness"], compared["instances"]["text"]) == ("part_of", text)
    compared = shared.client.post(
        "/compare", json={"first": stocked["bracket"], "second": stocked["unlike"]}
    ).json()
    assert (compared["likeness"] == "part_of", compared["instances"]) == (False, None)


def test_pieces_are_erased_with_their_embedding(shared: Running, stocked: dict[str, str]) -> None:
    rows = shared.rows(PieceRow)
    stored = shared.store(file_of(plate([SHAFT, BRACKET, SHAFT])), "three.stl")
    assert shared.rows(PieceRow) == rows + 2
    shared.client.delete(f"/shapes/{stored['id']}", params={"permanent": "true"})
    assert shared.rows(PieceRow) == rows
