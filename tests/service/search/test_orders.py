"""The order of the results: named by the query or the service, and told by the answer."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from core.io import write_mesh
from service.search import answer
from service.search.records import MatchedCandidates
from service.search.schemas import RankBy
from tests.gallery import make_shape
from tests.service.support import Running, query, serving, settings_in

CUP = write_mesh(make_shape("cup", 0), "off")


def stock(service: Running) -> None:
    service.store(CUP, "copy.off")
    for label in ("octopus", "pliers"):
        service.store(write_mesh(make_shape(label, 0), "off"), f"{label}.off")


def names(found: dict[str, Any]) -> list[str]:
    return [result["shape"]["name"] for result in found["results"]]


def test_a_service_has_an_order_of_its_own(tmp_path: Path) -> None:
    with serving(settings_in(tmp_path, rank_by="ssd")) as service:
        stock(service)
        assert service.client.get("/version").json()["rank_by"] == "ssd"
        found = query(service.client, CUP).json()
        assert found["ranked_by"] == "ssd"
        assert names(found) == names(query(service.client, CUP, rank_by="ssd").json())
        assert [result["ssd"] for result in found["results"]] == sorted(r["ssd"] for r in found["results"])
        assert query(service.client, CUP, rank_by="cc").json()["ranked_by"] == "cc"
        shape_id = found["results"][0]["shape"]["id"]
        for options, order in ({}, "ssd"), ({"partial": True}, "part_distance"), ({"rank_by": "sim"}, "sim"):
            similar = service.client.get(f"/shapes/{shape_id}/similar", params=options).json()
            assert similar["ranked_by"] == order


def test_an_order_with_a_better_first_result_is_told(
    service: Running, monkeypatch: pytest.MonkeyPatch
) -> None:
    stock(service)
    assert service.client.get("/version").json()["rank_by"] == "cc"
    told = query(service.client, CUP).json()
    assert (told["ranked_by"], names(told)[0], told["warnings"]) == ("cc", "copy.off", [])
    ranked = answer.ranked

    def worst_first(matched: MatchedCandidates, by: RankBy) -> np.ndarray:
        return ranked(matched, by)[::-1] if by == "cc" else ranked(matched, by)

    monkeypatch.setattr(answer, "ranked", worst_first)
    for top_k in (1, 3):
        told = query(service.client, CUP, top_k=top_k).json()
        first = told["results"][0]
        assert first["shape"]["name"] != "copy.off"
        (warning,) = told["warnings"]
        assert warning.startswith("rank_by=combined has a better first result: 'copy.off' (Same part)")
        assert repr(first["shape"]["name"]) in warning
    assert query(service.client, CUP, min_cc=0.9999, top_k=1).json()["warnings"] == []
    assert query(service.client, CUP, rank_by="combined").json()["warnings"] == []
