"""A bulk job of a real collection, with broken files among the good ones, by services that are killed."""

import signal
from pathlib import Path

import pytest

from tests.service.jobs.support import begun, has_stored
from tests.service.processes import server
from tests.service.support import wait_until
from tests.soak.collections.folders import sample
from tests.soak.kill.test_jobs import assert_all_there, broken, mixed

# Two cores take about two minutes, and a busy machine longer.
SECONDS = 1800


@pytest.mark.parametrize("killed", [False, True])
def test_all_are_stored_and_the_broken_ones_named(tmp_path: Path, killed: bool) -> None:
    good = {f"{label}/{path.name}": path.read_bytes() for path, label in sample("psb")}
    bad = broken(next(iter(good.values())))
    with server(tmp_path) as (process, client):
        job_id = begun(client, mixed(good, bad))
        if not killed:
            assert_all_there(client, tmp_path, job_id, good, bad, SECONDS)
            return
        wait_until(lambda: has_stored(client, job_id, len(good) // 3), seconds=SECONDS)
        process.send_signal(signal.SIGKILL)
        process.wait()
    with server(tmp_path) as (_, client):
        assert_all_there(client, tmp_path, job_id, good, bad, SECONDS)
