"""A wall clock that is set back a day: order, pages, times, jobs, sessions and rates stay right."""

import time
from datetime import UTC, datetime, timedelta, tzinfo

import pytest
from sqlalchemy import update

from service.auth.keys import digest_of
from service.collection import DEFAULT_COLLECTION
from service.jobs import repository as job_repository
from service.jobs import service as jobs
from service.shapes import endpoints, repository
from service.shapes import service as shapes
from service.storage.tables import JobRow
from tests.service.jobs.support import ended, pack
from tests.service.support import Running, assert_problem, module_service, query, small_file, upload

KEY, OTHER = "isoshape_one-key", "isoshape_other-key"
RATE = 60
DAY = timedelta(days=1)


class DayBefore(datetime):
    """The same clock, a day behind."""

    @classmethod
    def now(cls, tz: tzinfo | None = None) -> datetime:  # type: ignore[override]
        return datetime.now(tz) - DAY


clocked = module_service(
    key=KEY, api_keys=(digest_of(KEY), digest_of(OTHER)), rate_limit=RATE, log_level="info"
)


def set_back(patch: pytest.MonkeyPatch) -> None:
    """Have every wall clock in the service a day behind. The monotonic clock is never set."""
    real = time.time
    for module in (repository, shapes, endpoints, jobs, job_repository):
        patch.setattr(module, "datetime", DayBefore)
    patch.setattr(time, "time", lambda: real() - DAY.total_seconds())


def test_order_and_pages_go_by_what_was_stored_first(
    clocked: Running, monkeypatch: pytest.MonkeyPatch
) -> None:
    client = clocked.client
    first = clocked.store(small_file(0), "0.off")
    second = clocked.store(small_file(1), "1.off")
    page = client.get("/shapes", params={"limit": 1}).json()
    assert [shape["id"] for shape in page["shapes"]] == [first["id"]]
    with monkeypatch.context() as patch:
        set_back(patch)
        third = clocked.store(small_file(2), "2.off")
        assert datetime.now(UTC) - datetime.fromisoformat(third["created_at"]) > timedelta(hours=23)
        page = client.get("/shapes", params={"limit": 5, "cursor": page["next_cursor"]}).json()
        assert [shape["id"] for shape in page["shapes"]] == [second["id"], third["id"]]
        assert page["next_cursor"] is None
        answer = query(client, small_file(2), top_k=1, exclude_self="false").json()
        assert answer["results"][0]["shape"]["id"] == third["id"]
        assert answer["compared"] == 3
        assert all(milliseconds >= 0 for milliseconds in answer["milliseconds"].values())

        changed = client.patch(f"/shapes/{first['id']}", json={"tags": ["changed"]}).json()
        assert changed["tags"] == ["changed"]
        assert changed["updated_at"] == first["updated_at"]
    changed = client.patch(f"/shapes/{first['id']}", json={"tags": ["again"]}).json()
    assert changed["updated_at"] > first["updated_at"]
    assert client.get(f"/shapes/{third['id']}").json() == third
    again = upload(client, small_file(2), "2.off")
    assert (again.status_code, again.json()["id"]) == (200, third["id"])
    for shape in (first, second, third):
        assert client.delete(f"/shapes/{shape['id']}").status_code == 204


def test_a_job_is_done(clocked: Running, monkeypatch: pytest.MonkeyPatch) -> None:
    """And so is that of a service which died before the clock was set back: its lease ends tomorrow."""
    client, database = clocked.client, clocked.container.database
    archive = pack({"7.off": small_file(7)})
    path = jobs.Jobs(database, clocked.container.settings).archive_path("left")
    path.parent.mkdir(exist_ok=True)
    path.write_bytes(archive)
    with database.write() as session:
        now = datetime.now(UTC)
        values = {"client": "", "archive": "left.zip", "size": len(archive), "tags": [], "meta": {}}
        job = job_repository.add(session, "left", DEFAULT_COLLECTION.number, values)
        left = update(JobRow).where(JobRow.number == job.number).values(runner="died", leased_until=now + DAY)
        session.execute(left)
    with monkeypatch.context() as patch:
        set_back(patch)
        told = client.post("/jobs", files={"file": ("new.zip", pack({"8.off": small_file(8)}))})
        assert told.status_code == 202
        for shown in client.get("/jobs").json()["jobs"]:
            done = ended(client, shown["id"])
            assert (done["state"], done["counts"]["stored"]) == ("done", 1)
    # Jobs of two clients run side by side, and either may end first.
    assert {shape["name"] for shape in client.get("/shapes").json()["shapes"]} == {"7.off", "8.off"}
    clocked.clear()


def test_a_session_lasts(clocked: Running, monkeypatch: pytest.MonkeyPatch) -> None:
    cookie = clocked.client.post("/session").headers["set-cookie"].split(";")[0]
    # The client asks the same clock how old a cookie is: it is sent by hand.
    clocked.client.cookies.clear()

    def access() -> object:
        request = clocked.client.build_request("GET", "/session", headers={"cookie": cookie})
        del request.headers["authorization"]
        return clocked.client.send(request).json()

    signed_in = {"access": "full", "signed_in": True}
    assert access() == signed_in
    with monkeypatch.context() as patch:
        set_back(patch)
        assert access() == signed_in
    assert access() == signed_in


def test_a_rate_stays_what_it_is(clocked: Running, monkeypatch: pytest.MonkeyPatch) -> None:
    headers = {"authorization": f"Bearer {OTHER}"}
    with monkeypatch.context() as patch:
        for _ in range(RATE // 2):
            assert clocked.client.get("/shapes", headers=headers).status_code == 200
        set_back(patch)
        statuses = [clocked.client.get("/shapes", headers=headers).status_code for _ in range(2 * RATE)]
        assert statuses[0] == 200
        assert 429 in statuses
        answer = clocked.client.get("/shapes", headers=headers)
        assert_problem(answer, 429, "rate-limit")
        assert 1 <= int(answer.headers["retry-after"]) <= 2
