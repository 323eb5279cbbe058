"""Fixtures: a Dask cluster, a pool of its workers, and a service that works on them."""

from collections.abc import Iterator

import pytest

from core.parameters import DEFAULT
from service.compute.cluster import ClusterPool
from tests.service.dask_cluster import Cluster, cluster
from tests.service.engines import POSTGRESQL, using
from tests.service.support import Running, serving, settings_in, wait_until


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
