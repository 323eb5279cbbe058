"""A PostgreSQL server that is stopped, with its clients cut off, while clients of the service write."""

from pathlib import Path

from tests.service.engines import on_postgresql
from tests.service.storage.test_postgresql import assert_survived


@on_postgresql
def test_a_server_that_goes_away_under_load(tmp_path: Path) -> None:
    assert_survived(tmp_path, "fast")
