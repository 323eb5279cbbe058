"""A service whose workers are those of a Dask cluster: the same answers, and nothing lost with any of it."""

import asyncio
import os
import threading
from collections.abc import Callable, Iterator
from concurrent.futures import Future, wait
from pathlib import Path
from typing import Any

import httpx
import numpy as np
import pytest

from core.matching.match_records import match_record, score_match_records
from core.parameters import DEFAULT
from core.serialization import embedding_from_bytes
from service.compute.cluster import ClusterPool
from service.compute.workers import RemoteWorkers
from service.errors import ClusterUnavailableError, WorkerLostError
from service.search import cluster_scoring as spread
from service.search.cluster_scoring import cluster_scores
from service.search.repository import embedding_records
from tests.service.dask_cluster import Cluster, cluster
from tests.service.engines import POSTGRESQL, using
from tests.service.jobs.packing import pack
from tests.service.jobs.support import begun, ended, files
from tests.service.support import (
    Running,
    assert_problem,
    query,
    serving,
    settings_in,
    small_file,
    upload,
    wait_until,
)
from tests.service.tasks import add, nap

MEMBERS = 16


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Cluster]:
    with cluster(tmp_path_factory.mktemp("cluster")) as made:
        yield made


@pytest.fixture
def pool(made: Cluster) -> Iterator[ClusterPool]:
    """Two workers that are warm, whatever an earlier test did to them."""
    made.start(2 - len(made.workers))
    with ClusterPool(made.address, parameters=DEFAULT, seconds=60) as pool:
        wait_until(lambda: len(pool.pids()) == 2, seconds=240)
        yield pool


@pytest.fixture(scope="module")
def running(made: Cluster, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Running]:
    """A service on the cluster and on PostgreSQL."""
    with using(POSTGRESQL):
        settings = settings_in(tmp_path_factory.mktemp("running"), scheduler=made.address)
    with serving(settings) as running:
        yield running


@pytest.fixture
def service(made: Cluster, running: Running) -> Running:
    """It, holding nothing, on two workers that are warm."""
    made.start(2 - len(made.workers))
    wait_until(lambda: len(running.container.pool.pids()) == 2, seconds=240)
    running.clear()
    return running


def test_the_work_and_the_keys_of_a_lost_worker_go_to_another(made: Cluster, pool: ClusterPool) -> None:
    keys = np.repeat(np.arange(400), 2)
    owners = pool.owners(keys)
    assert (owners[::2] == owners[1::2]).all()
    addresses, shares = np.unique(owners, return_counts=True)
    assert len(addresses) == 2
    assert shares.min() >= 0.4 * len(keys)
    pids = dict(zip(addresses, (pool.submit_to(each, os.getpid).result() for each in addresses), strict=True))
    assert sorted(pids.values()) == sorted(pool.pids())
    napping: list[Future[Any]] = [pool.submit(nap, 2) for _ in range(2)]
    assert (pool.idle(), pool.busy(), pool.waiting()) == (0, 2, 0)
    made.kill_worker(pids[addresses[0]])
    # Whoever knows of the loss later is answered all the same.
    assert pool.submit_to(str(addresses[0]), os.getpid).result(timeout=60) == pids[addresses[1]]
    assert [each.result(timeout=60) for each in napping] == [None, None]
    wait_until(lambda: (len(pool.pids()), pool.idle(), pool.busy()) == (1, 1, 0), seconds=30)
    assert set(pool.owners(keys)) == {addresses[1]}
    made.start(1)
    wait_until(lambda: len(pool.pids()) == 2, seconds=240)
    stayed = pool.owners(keys) == addresses[1]
    assert 0.4 * len(keys) <= stayed.sum() <= 0.6 * len(keys)


def test_what_a_call_in_a_worker_raises_is_raised_here(pool: ClusterPool) -> None:
    owner = str(pool.owners(np.zeros(1, dtype=np.int64))[0])
    with pytest.raises(TypeError):
        pool.submit_to(owner, add, 1, "one").result(timeout=60)


def test_a_pool_that_is_killed_waits_for_nothing(made: Cluster, pool: ClusterPool) -> None:
    napping = [pool.submit(nap, 600) for _ in range(3)]
    pool.kill()
    for each in napping:
        assert isinstance(each.exception(), WorkerLostError)
    with pytest.raises(RuntimeError, match="shut down"):
        pool.submit(add, 1, 1)


def test_leaving_the_block_finishes_what_was_given(made: Cluster, pool: ClusterPool) -> None:
    with ClusterPool(made.address, parameters=DEFAULT, seconds=60) as other:
        wait_until(other.ready, seconds=60)
        given = [other.submit(add, i, 1) for i in range(5)]
    done, _ = wait(given, timeout=0)
    assert [each.result() for each in given if each in done] == [1, 2, 3, 4, 5]


def test_answers_are_those_of_one_machine(service: Running, tmp_path: Path) -> None:
    """PostgreSQL and Dask against SQLite and processes here."""
    (tmp_path / "alone").mkdir()

    def answers(running: Running) -> list[object]:
        for number in range(8):
            running.store(small_file(number), f"{number}.off", tags=f"{number % 2}")
        told: list[object] = []
        for number, tag in ((2, "0"), (3, "0"), (20, "1")):
            answer = query(running.client, small_file(number), top_k=8, tag=tag).json()
            for result in answer["results"]:
                result["shape"] = result["shape"]["name"]
            told.append({**answer, "milliseconds": 0})
        first = running.client.get("/shapes").json()["shapes"][0]
        told += [
            first["facts"],
            first["sha256"],
            running.client.get(f"/shapes/{first['id']}/thumbnail.png").content,
        ]
        return told

    with serving(settings_in(tmp_path / "alone")) as alone:
        assert answers(service) == answers(alone)


def test_rows_are_kept_by_workers_and_made_again_where_one_is_lost(
    made: Cluster, service: Running, monkeypatch: pytest.MonkeyPatch
) -> None:
    for number in range(6):
        service.store(small_file(number), f"{number}.off")
    parts, pool = service.container, service.container.pool
    assert isinstance(pool, RemoteWorkers)
    with parts.database.read() as session:
        active_pipeline = parts.pipelines.current(session)
        entries = active_pipeline.index.current(session)
        records = embedding_records(session, entries.embeddings.tolist())
    numbers = np.array(sorted(records))
    rows = [match_record(embedding_from_bytes(records[number]), DEFAULT) for number in numbers.tolist()]
    truth = score_match_records(rows[0], rows, DEFAULT)

    def assert_found(order: list[int]) -> None:
        found = asyncio.run(cluster_scores(parts, pool, active_pipeline, rows[0], numbers[order]))
        np.testing.assert_array_equal(found, np.stack([truth.cc, truth.ssd, truth.sim])[:, order])

    monkeypatch.setattr(spread, "TOGETHER", 1)
    assert_found([0, 1, 2, 3, 4, 5])
    with monkeypatch.context() as patch:
        patch.delattr(spread, "_read")
        assert_found([5, 0, 3])
    made.kill_worker()
    assert_found([0, 1, 2, 3, 4, 5])
    gone = asyncio.run(cluster_scores(parts, pool, active_pipeline, rows[0], numbers[-1:] + 1))
    assert np.isnan(gone).all()


def test_a_worker_that_is_killed_in_the_middle_of_a_bulk_job(made: Cluster, service: Running) -> None:
    members = {f"{number}.off": small_file(number) for number in range(MEMBERS)}
    job_id = begun(service.client, pack(members, "zip"))
    wait_until(lambda: service.client.get("/shapes").json()["total"] >= 4, seconds=240)
    made.kill_worker()
    ended(service.client, job_id)
    told = files(service.client, job_id)
    assert {each["path"]: each["outcome"] for each in told} == dict.fromkeys(members, "stored")
    shapes = service.client.get("/shapes", params={"limit": 500}).json()["shapes"]
    assert sorted(shape["name"] for shape in shapes) == sorted(members)


def test_a_scheduler_that_is_away(made: Cluster, service: Running) -> None:
    client = service.client
    service.store(small_file(1), "kept.off")
    job_id = begun(client, pack({f"{number}.off": small_file(number) for number in range(10, 20)}, "zip"))
    outcomes: list[httpx.Response] = []
    sent: list[Callable[[], httpx.Response]] = [
        lambda: upload(client, small_file(2), "new.off"),
        lambda: query(client, small_file(3)),
    ]
    made.kill_scheduler()
    wait_until(lambda: client.get("/readyz").status_code == 503, seconds=30)
    threads = [threading.Thread(target=lambda send=send: outcomes.append(send())) for send in sent]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert len(outcomes) == 2
    for answer in outcomes:
        assert_problem(answer, 503, "cluster-unavailable")
    assert client.get("/shapes").status_code == 200
    assert client.get("/healthz").status_code == 200
    made.start(1)
    wait_until(lambda: client.get("/readyz").status_code == 200, seconds=240)
    assert [send().status_code for send in sent] == [201, 200]
    assert ended(client, job_id)["counts"]["stored"] == 10


def test_a_cluster_without_workers_says_so_and_goes_on_when_one_comes(
    made: Cluster, pool: ClusterPool
) -> None:
    waiting = [pool.submit(nap, 600) for _ in range(3)]
    while made.workers:
        made.kill_worker()
    for each in waiting:
        with pytest.raises(ClusterUnavailableError, match="no workers"):
            each.result(timeout=60)
    assert not pool.ready()
    with pytest.raises(ClusterUnavailableError, match="no workers"):
        pool.submit(add, 1, 1)
    with pytest.raises(ClusterUnavailableError, match="no workers"):
        pool.owners(np.zeros(1, dtype=np.int64))
    made.start(1)
    wait_until(pool.ready, seconds=240)
    assert pool.submit(add, 1, 1).result() == 2


def test_a_scheduler_that_is_lost_is_said_and_found_again(made: Cluster, pool: ClusterPool) -> None:
    waiting = [pool.submit(nap, 600) for _ in range(3)]
    made.kill_scheduler()
    for each in waiting:
        with pytest.raises(ClusterUnavailableError, match="scheduler"):
            each.result(timeout=60)
    assert (pool.ready(), pool.idle(), pool.busy(), pool.starting(), pool.waiting()) == (False, 0, 0, 0, 0)
    with pytest.raises(ClusterUnavailableError, match="cannot be reached"):
        pool.submit(add, 1, 1)
    made.start(1)
    wait_until(pool.ready, seconds=240)
    assert pool.submit(add, 1, 1).result() == 2
