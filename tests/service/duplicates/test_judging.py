"""Kept pairs: complete, whoever judges and in whatever order, and gone with their shapes."""

import asyncio
import time
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import pytest
from sqlalchemy import select

from core.io import write_mesh
from core.parameters import DEFAULT
from service.cli.archives import reembed
from service.duplicates import judging, repository, service
from service.duplicates.groups import Search
from service.duplicates.judging import ShapeJudge
from service.errors import StorageFullError, WorkerCrashedError
from service.shapes.reembedding import prune_others
from service.storage.checking import check
from service.storage.copying import copy_archive
from service.storage.database import Database
from service.storage.tables import DuplicatePairRow, JudgedShapeRow, NeighboursRow, ShapeRow
from tests.gallery import make_shape
from tests.service.engines import on_postgresql, url_in
from tests.service.pipeline_files import write_parameters
from tests.service.support import (
    Running,
    relate,
    requests_at_work,
    serving,
    settings_in,
    small_file,
    wait_until,
)
from tests.service.tasks import meet
from tests.studies.copies import moved
from tests.studies.duplicates import groups_by_force, parts
from tests.studies.kinship import changed_part

PLANE = make_shape("plane", 0)


def copy_of_plane(seed: int) -> bytes:
    return write_mesh(moved(PLANE, seed), "off")


def ask(running: Running, **params: Any) -> dict[str, Any]:
    """The complete answer of GET /duplicates."""
    for _ in range(100):
        answer = running.client.get("/duplicates", params=params)
        assert answer.status_code == 200, answer.text
        if not answer.json()["unjudged"]:
            return dict(answer.json())
    raise AssertionError("shapes stay unjudged")


def groups(running: Running, **params: Any) -> set[frozenset[str]]:
    """The ids of the shapes of each group."""
    return {frozenset(one["shape"]["id"] for one in group) for group in ask(running, **params)["groups"]}


@pytest.fixture
def running(shared: Running) -> Running:
    """The shared service, holding nothing."""
    shared.clear()
    return shared


def test_the_groups_are_those_of_every_pair_by_force(running: Running) -> None:
    for name, data in parts(10):
        # The two whose surfaces take longest have no copy among the ten.
        if not name.startswith(("bolt", "bracket")):
            running.store(data, name)
    copies, with_variants = groups_by_force(running)
    assert len(copies) >= 2
    assert copies != with_variants
    assert groups(running, scaled=True) == copies
    assert groups(running, scaled=True, variants=True) == with_variants


def test_a_variant_of_a_part_is_not_registered_with_finer_copies_of_it(running: Running) -> None:
    ids = {}
    for kind in ("first", "turned", "finer", "moved"):
        mesh, _ = changed_part("housing", 50_005, 0.1, kind, 1)
        ids[kind] = running.store(write_mesh(mesh, "stl"), f"{kind}.stl")["id"]
        if kind == "finer":
            aligned = ask(running)["aligned"]
    after = ask(running)["aligned"]
    assert groups(running) == {frozenset(ids[kind] for kind in ("first", "turned", "finer"))}
    assert after == aligned + 1


def test_shapes_are_judged_in_the_background(tmp_path: Path) -> None:
    with serving(settings_in(tmp_path, duplicates_in_background=True)) as running:
        for seed in range(3):
            running.store(copy_of_plane(seed), f"{seed}.off")
        running.store(small_file(1), "ball.off")
        wait_until(lambda: running.rows(JudgedShapeRow) == 4, seconds=120)
        aligned = ask(running)["aligned"]
        assert aligned == 2
        (group,) = groups(running)
        assert len(group) == 3
        # Variants are sought once somebody has asked for them.
        assert running.rows(JudgedShapeRow) == 4
        assert groups(running, variants=True) == {group}
        running.store(small_file(2), "another.off")
        wait_until(lambda: running.rows(JudgedShapeRow) == 10, seconds=120)
    # Judgements outlive the service.
    with serving(settings_in(tmp_path)) as running:
        assert groups(running) == {group}
        assert ask(running)["aligned"] == aligned


def test_a_request_that_runs_out_of_time_says_how_many_shapes_remain(running: Running) -> None:
    for seed in range(3):
        running.store(copy_of_plane(seed), f"{seed}.off")
    for seconds, unjudged in ((0.0, 3), (1e-9, 2)):
        answer = running.client.get("/duplicates", params={"judging_seconds": seconds}).json()
        assert (answer["groups"], answer["shapes"], answer["unjudged"]) == ([], 3, unjudged)
    assert len(ask(running)["groups"][0]) == 3


def test_a_request_waits_for_a_shape_that_another_one_judges(
    running: Running, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Clients ask again while fewer shapes remain."""
    for seed in range(2):
        running.store(copy_of_plane(seed), f"{seed}.off")
    judge = ShapeJudge.judge

    async def slowly(self: ShapeJudge) -> None:
        await asyncio.sleep(1.0)
        await judge(self)

    monkeypatch.setattr(ShapeJudge, "judge", slowly)
    monkeypatch.setattr(service, "JUDGING_SECONDS", 0.0)
    with ThreadPoolExecutor(3) as pool:
        answers = list(pool.map(lambda _: running.client.get("/duplicates").json(), range(3)))
    assert max(answer["unjudged"] for answer in answers) <= 1


def test_copies_of_a_deleted_copy_stay_in_one_group(running: Running) -> None:
    shapes = [running.store(copy_of_plane(seed), f"{seed}.off") for seed in range(4)]
    assert running.rows(DuplicatePairRow) == 0
    assert len(*groups(running)) == 4
    pairs = running.rows(DuplicatePairRow)
    assert pairs == 3
    running.client.delete(f"/shapes/{shapes[0]['id']}")
    assert running.rows(DuplicatePairRow) < pairs
    assert groups(running) == {frozenset(shape["id"] for shape in shapes[1:])}
    for shape in shapes[1:3]:
        running.client.delete(f"/shapes/{shape['id']}")
    assert groups(running) == set()
    assert running.rows(DuplicatePairRow) == 0
    assert running.rows(JudgedShapeRow) == 1


def test_a_restored_shape_is_judged_again(tmp_path: Path) -> None:
    with serving(settings_in(tmp_path, undo_days=1.0)) as running:
        shapes = [running.store(copy_of_plane(seed), f"{seed}.off") for seed in range(2)]
        before = groups(running)
        assert len(*before) == 2
        running.client.delete(f"/shapes/{shapes[0]['id']}")
        assert groups(running) == set()
        assert running.client.post(f"/shapes/{shapes[0]['id']}/restore").status_code == 200
        assert groups(running) == before


def test_a_shape_with_another_file_is_judged_again(running: Running) -> None:
    first = running.store(copy_of_plane(0), "first.off")
    other = running.store(small_file(1), "other.off")
    assert groups(running) == set()
    files = {"file": ("other.off", copy_of_plane(1))}
    assert running.client.put(f"/shapes/{other['id']}/file", files=files).status_code == 200
    assert groups(running) == {frozenset({first["id"], other["id"]})}
    files = {"file": ("other.off", small_file(2))}
    assert running.client.put(f"/shapes/{other['id']}/file", files=files).status_code == 200
    assert groups(running) == set()


def test_a_pair_judged_by_two_services_at_once_is_not_missed(
    running: Running, monkeypatch: pytest.MonkeyPatch
) -> None:
    shapes = [running.store(copy_of_plane(seed), f"{seed}.off") for seed in range(2)]
    compare = ShapeJudge._compare
    judged: list[int] = []

    async def compare_while_the_other_is_judged(self: ShapeJudge, view: Any) -> None:
        await compare(self, view)
        if not judged:
            with running.container.database.write() as session:
                judged.extend(session.scalars(select(ShapeRow.number).where(ShapeRow.number != self.shape)))
                search = Search(DEFAULT.fingerprint, variants=False)
                repository.write(session, search, judged[0], [], compared=0, aligned=0)

    with running.container.database.read() as session:
        first, other = session.scalars(select(ShapeRow.number).order_by(ShapeRow.number))
    # Only the other service judges the second shape.
    running.container.judging.add((other, False))
    monkeypatch.setattr(ShapeJudge, "_compare", compare_while_the_other_is_judged)
    assert groups(running) == {frozenset(shape["id"] for shape in shapes)}
    assert judged == [other] != [first]
    assert ask(running)["compared"] == 1


def test_another_pipeline_has_judgements_of_its_own(tmp_path: Path) -> None:
    settings = settings_in(tmp_path)
    with serving(settings) as running:
        for seed in range(2):
            running.store(copy_of_plane(seed), f"{seed}.off")
        before = groups(running)
        relate(running)
        assert running.rows(NeighboursRow) == 2
    few = write_parameters(tmp_path)
    outcome, _ = reembed(settings, few)
    assert outcome.active
    with serving(settings_in(tmp_path, pipeline=str(tmp_path / "few.json"))) as running:
        assert groups(running) == before
        assert running.rows(JudgedShapeRow) == 4
        prune_others(running.container.database, few.fingerprint)
        assert running.rows(JudgedShapeRow) == 2
        assert running.rows(DuplicatePairRow) == 1
        assert running.rows(NeighboursRow) == 0


def test_copies_and_checks_of_an_archive_hold_the_pairs(tmp_path: Path) -> None:
    with serving(settings_in(tmp_path)) as running:
        for seed in range(2):
            running.store(copy_of_plane(seed), f"{seed}.off")
        assert len(*groups(running)) == 2
    source = Database(url_in(tmp_path), lock_seconds=1)
    path = tmp_path / "copy.sqlite3"
    target = Database(f"sqlite:///{path}", lock_seconds=1)
    copy_archive(source, target, lambda *_: None)
    with source.read() as one, target.read() as other:
        for table in (DuplicatePairRow, JudgedShapeRow):
            rows = [session.execute(select(table.__table__)).all() for session in (one, other)]
            assert rows[0] == rows[1] != []
    source.close()
    target.close()
    assert check(path, lock_seconds=1).faults == []


def test_a_shape_that_the_index_does_not_have_ends_the_judging(
    running: Running, monkeypatch: pytest.MonkeyPatch
) -> None:
    looks = []

    def unjudged(*_: object, **__: object) -> list[tuple[int, int]]:
        looks.append([(1, 999)])
        return looks[-1]

    monkeypatch.setattr(repository, "unjudged", unjudged)
    assert running.client.get("/duplicates").status_code == 200
    assert len(looks) == 2


def test_a_pair_that_ends_a_worker_costs_that_pair(running: Running, monkeypatch: pytest.MonkeyPatch) -> None:
    async def crashes(*_: object, **__: object) -> None:
        raise WorkerCrashedError("the worker process broke down over the work")

    for seed in (1, 2):
        running.store(copy_of_plane(seed), f"{seed}.off")
    with monkeypatch.context() as patch:
        patch.setattr(judging, "find_copy", crashes)
        found = ask(running)
    assert (found["groups"], found["aligned"]) == ([], 1)


def test_variants_have_all_copies_among_them(running: Running) -> None:
    """More copies than candidates of variants."""
    for seed in range(20):
        running.store(copy_of_plane(seed), f"{seed}.off")
    (group,) = groups(running, variants="true")
    assert len(group) == 20


def test_an_archive_that_cannot_be_written_to_has_its_pairs_read(
    running: Running, monkeypatch: pytest.MonkeyPatch
) -> None:
    def full(*_: object, **_named: object) -> None:
        raise StorageFullError("the disk is full")

    for seed in (1, 2):
        running.store(copy_of_plane(seed), f"{seed}.off")
    assert len(groups(running)) == 1
    running.store(copy_of_plane(3), "3.off")
    monkeypatch.setattr(repository, "write", full)
    answer = running.client.get("/duplicates").json()
    assert (len(answer["groups"]), answer["unjudged"]) == (1, 1)


@pytest.fixture
def short_pauses(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(service, "LOOK_SECONDS", 0.1)
    monkeypatch.setattr(service, "BUSY_SECONDS", 0.05)


@pytest.mark.usefixtures("short_pauses")
def test_requests_and_tasks_come_before_the_background(tmp_path: Path) -> None:
    with serving(settings_in(tmp_path, workers=2, duplicates_in_background=True)) as running:
        container = running.container
        try:
            with requests_at_work(running, 1):
                for seed in range(2):
                    running.store(copy_of_plane(seed), f"{seed}.off")
                wait_until(container.comparing_is_ready.is_set, seconds=60)
                time.sleep(1.0)
                assert running.rows(JudgedShapeRow) == 0
                task = container.pool.submit(meet, str(tmp_path / "task"), str(tmp_path / "end"))
                wait_until((tmp_path / "task").exists, seconds=60)
            time.sleep(1.0)
            assert running.rows(JudgedShapeRow) == 0
        finally:
            (tmp_path / "end").touch()
        task.result(60)
        wait_until(lambda: running.rows(JudgedShapeRow) == 2, seconds=60)


@on_postgresql
@pytest.mark.usefixtures("short_pauses")
def test_signatures_in_the_database_are_not_read_for_the_background(tmp_path: Path, engine: str) -> None:
    settings = settings_in(tmp_path, signatures="database", duplicates_in_background=True)
    with serving(settings) as running:
        running.store(copy_of_plane(0))
        wait_until(running.container.comparing_is_ready.is_set, seconds=60)
        time.sleep(1.0)
        assert running.rows(JudgedShapeRow) == 0
