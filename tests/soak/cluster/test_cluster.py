"""A Dask cluster that loses workers and its scheduler: the service says so, and goes on."""

import threading
from collections.abc import Callable
from concurrent.futures import Future
from typing import Any

import httpx

from service.compute.cluster import ClusterPool
from service.compute.pool import WorkerCounts
from tests.service.clusters import made, on_cluster, pool, service
from tests.service.dask_cluster import Cluster
from tests.service.jobs.support import begun, ended, files, pack
from tests.service.support import Running, assert_problem, query, small_file, upload, wait_until
from tests.service.tasks import nap

__all__ = ["made", "on_cluster", "pool", "service"]

MEMBERS = 16


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
