"""A service whose workers are a Dask cluster gives the same answers; a lost cluster is said."""

from concurrent.futures import wait
from pathlib import Path

import pytest

from core.parameters import DEFAULT
from service.compute.cluster import ClusterPool
from service.compute.pool import WorkerCounts
from service.errors import ClusterUnavailableError, WorkerLostError
from tests.service.clusters import made, on_cluster, pool, service
from tests.service.dask_cluster import Cluster
from tests.service.support import Running, query, serving, settings_in, small_file, wait_until
from tests.service.tasks import add, nap

__all__ = ["made", "on_cluster", "pool", "service"]


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
