"""A Dask cluster gives the answers of one machine; without its workers or its scheduler, that is said."""

import threading
from collections.abc import Callable, Iterator
from concurrent.futures import Future, wait
from pathlib import Path
from typing import Any

import httpx
import pytest

from core.parameters import DEFAULT
from service.compute.cluster import ClusterPool
from service.compute.pool import WorkerCounts
from service.errors import ClusterUnavailableError, WorkerLostError
from tests.service.dask_cluster import Cluster, cluster
from tests.service.engines import POSTGRESQL, using
from tests.service.jobs.support import begun, ended, files, pack
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
def on_cluster(made: Cluster, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Running]:
    """A service on the cluster and on PostgreSQL."""
    with using(POSTGRESQL):
        settings = settings_in(tmp_path_factory.mktemp("running"), scheduler=made.address)
    with serving(settings) as running:
        yield running


@pytest.fixture
def service(made: Cluster, on_cluster: Running) -> Running:
    """It, holding nothing, on two workers that are warm."""
    made.start(2 - len(made.workers))
    wait_until(lambda: len(on_cluster.container.pool.pids()) == 2, seconds=240)
    on_cluster.clear()
    return on_cluster


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
        for number in range(4):
            running.store(small_file(number), f"{number}.off", tags=f"{number % 2}")
        told: list[object] = []
        for number, tag in ((2, "0"), (3, "0"), (20, "1")):
            answer = query(running.client, small_file(number), top_k=4, tag=tag).json()
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


def test_a_pool_that_is_killed_waits_for_nothing(made: Cluster, pool: ClusterPool) -> None:
    napping = [pool.submit(nap, 600) for _ in range(3)]
    pool.kill()
    for each in napping:
        assert isinstance(each.exception(), WorkerLostError)
    with pytest.raises(RuntimeError, match="shut down"):
        pool.submit(add, 1, 1)


def test_a_cluster_that_is_lost_is_said_and_found_again(made: Cluster, pool: ClusterPool) -> None:
    waiting = [pool.submit(nap, 600) for _ in range(3)]
    while made.workers:
        made.kill_worker()
    for each in waiting:
        with pytest.raises(ClusterUnavailableError, match="no workers"):
            each.result(timeout=60)
    assert not pool.ready()
    with pytest.raises(ClusterUnavailableError, match="no workers"):
        pool.submit(add, 1, 1)
    made.kill_scheduler()
    wait_until(lambda: unreachable(pool), seconds=60)
    assert (pool.ready(), pool.counts()) == (False, WorkerCounts(0, 0, 0, 0))
    made.start(1)
    wait_until(pool.ready, seconds=240)
    assert pool.submit(add, 1, 1).result() == 2


def unreachable(pool: ClusterPool) -> bool:
    with pytest.raises(ClusterUnavailableError) as caught:
        pool.submit(add, 1, 1)
    return "cannot be reached" in str(caught.value)


def test_the_work_of_a_lost_worker_goes_to_another(made: Cluster, pool: ClusterPool) -> None:
    napping: list[Future[Any]] = [pool.submit(nap, 2) for _ in range(2)]
    assert pool.counts() == WorkerCounts(0, 2, 0, 0)
    made.kill_worker()
    assert [each.result(timeout=60) for each in napping] == [None, None]
    wait_until(lambda: (len(pool.pids()), pool.counts()) == (1, WorkerCounts(1, 0, 0, 0)), seconds=30)
    made.start(1)
    wait_until(lambda: len(pool.pids()) == 2, seconds=240)


def test_a_worker_that_is_killed_in_the_middle_of_a_bulk_job(made: Cluster, service: Running) -> None:
    members = {f"{number}.off": small_file(number) for number in range(MEMBERS)}
    job_id = begun(service.client, pack(members))
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
    job_id = begun(client, pack({f"{number}.off": small_file(number) for number in range(10, 20)}))
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
