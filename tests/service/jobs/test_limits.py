"""The limits of an archive, and of the number of archives."""

import threading

import pytest

from service.storage.tables import JobRow
from tests.service.http.test_disconnects import send as send_part
from tests.service.jobs.support import begun, causes, ended, pack, send
from tests.service.support import Running, assert_problem, module_service, small_file, wait_until

ARCHIVE = 20_000
MEMBER = 5_000


strict = module_service(
    max_upload_bytes=2 * MEMBER,
    max_archive_bytes=ARCHIVE,
    max_archive_files=3,
    max_unpacked_bytes=4 * MEMBER,
    max_unpacked_ratio=2.0,
    max_jobs=4,
)


def test_an_archive_above_the_limit_is_refused(strict: Running) -> None:
    for size in (ARCHIVE + 1, ARCHIVE + 2_000_000):
        problem = assert_problem(send(strict.client, b"x" * size), 413, "body-too-large")
        assert f"at most {ARCHIVE} bytes" in problem["detail"]
    # An archive may be larger than an upload, and an upload no larger than before.
    upload = {"file": ("big.off", b"x" * (2 * MEMBER + 1))}
    assert_problem(strict.client.post("/shapes", files=upload), 413, "body-too-large")


@pytest.mark.parametrize(("many", "size"), [(4, 1), (3, 2 * MEMBER)])
def test_an_archive_of_too_much_fails_and_nothing_of_it_is_stored(
    strict: Running, many: int, size: int
) -> None:
    archive = pack({f"{number}.off": b"x" * size for number in range(many)})
    done = ended(strict.client, begun(strict.client, archive))
    assert done["state"] == "failed"
    assert done["problem"]["type"].endswith(":archive-too-large")
    assert done["counts"]["files"] == 0
    assert strict.client.get("/shapes").json()["total"] == 0


def test_a_file_above_the_limit_is_refused(strict: Running) -> None:
    archive = pack({"large.off": small_file(0) + b"\n" * 2 * MEMBER, "0.off": small_file(0)})
    job_id = begun(strict.client, archive)
    assert ended(strict.client, job_id)["state"] == "done"
    assert causes(strict.client, job_id) == {"large.off": "member-too-large"}


def test_so_many_jobs_and_no_more(strict: Running, held: threading.Event) -> None:
    ids = [begun(strict.client, pack({f"{number}.off": small_file(number)})) for number in (1, 2)]
    before = strict.rows(JobRow)
    assert_problem(send(strict.client, pack({"3.off": small_file(3)})), 503, "busy")
    assert strict.rows(JobRow) == before
    held.set()
    for job_id in ids:
        assert ended(strict.client, job_id)["counts"]["stored"] == 1
    assert ended(strict.client, begun(strict.client, pack({"3.off": small_file(3)})))["state"] == "done"


def test_so_many_archives_at_a_time_are_received(strict: Running) -> None:
    archive = pack({"4.off": small_file(4)})
    body = {"files": {"file": ("x.zip", archive)}}
    arriving = strict.server.config.app.state.runner._arriving
    with send_part(strict, "/jobs", part=0.5, **body), send_part(strict, "/jobs", part=0.5, **body):
        wait_until(lambda: arriving.total() == 2, seconds=60)
        problem = assert_problem(send(strict.client, archive), 503, "busy")
        assert "2 archives of this client are being received" in problem["detail"]
        assert strict.client.get("/jobs").status_code == 200
    wait_until(lambda: send(strict.client, archive).status_code == 202, seconds=60)
