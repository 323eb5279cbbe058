"""The service keeps the promises of the OpenAPI document, by requests generated from the document."""

import re
from collections import defaultdict
from collections.abc import Iterator
from copy import deepcopy
from datetime import timedelta
from typing import Any

import pytest
import schemathesis
from hypothesis import HealthCheck, Phase, seed, settings
from schemathesis import Case, CheckFunction, Response
from schemathesis.checks import load_all_checks
from schemathesis.specs.openapi.checks import (
    negative_data_rejection,
    positive_data_acceptance,
    use_after_free,
)
from sqlalchemy import delete

from service.app import openapi_document
from service.auth.keys import digest_of
from service.http.problem_document import TYPE_PREFIX
from service.shapes.service import purge_old
from service.storage.tables import IdempotencyKeyRow, JobRow
from tests.service.support import Running, serving, settings_in, small_file, wait_until
from tests.soak.schema import meshes

KEY = "a-key-for-the-tests-of-the-document"
EXCLUDED = re.compile(
    r"^(format|paint): (\S+ needs dense=true|html (has no dense|shows stored) .*)$"
    r"|^(landmarks|transfer): .*needs? (format=json|dense=true).*$"
    r"|^cursor: the cursor belongs to a list in another order than sort=\w+$"
)
"""Formats and colours of a comparison that only a dense correspondence, or only stored shapes, can have; and
cursors of another order."""

# Text that people write follows rules that a schema does not tell: see `service.shapes.fields`. Ids that
# differ in blanks are one. Points lie on a surface.
WRITTEN = {
    *("q", "name", "tag", "tags", "metadata", "area", "volume", "length", "landmarks", "transfer"),
    *("shapes", "shape", "deleted", "keep", "decided_by", "reason"),
    *("add_tags", "remove_tags", "set_metadata", "remove_metadata", "collection", "path", "rules"),
}
# In it everything is text: any may be a tag, and true is written in many ways.
FORM = "multipart/form-data"
QUIET = settings(
    max_examples=25,
    deadline=None,
    database=None,
    phases=[Phase.explicit, Phase.generate],
    suppress_health_check=list(HealthCheck),
)
# Sequences of requests are drawn until the links have led to each of these, in so many rounds at most.
BY_LINKS = {
    "GET /shapes/{shape_id}": 200,
    "PATCH /shapes/{shape_id}": 200,
    "GET /shapes/{shape_id}/embedding": 200,
    "DELETE /shapes/{shape_id}": 204,
    "POST /query": 200,
    "GET /shapes/{shape_id}/similar": 200,
    "GET /jobs/{job_id}": 200,
    "GET /jobs/{job_id}/files": 200,
    "GET /jobs/{job_id}/events": 200,
}
ROUNDS = 10
SEQUENCES = 20


def _schema() -> schemathesis.BaseSchema:
    describe = deepcopy(DESCRIBED)
    meshes.narrow(describe)
    schema = schemathesis.openapi.from_dict(describe)
    # A key that is made up is refused, which tests nothing else.
    schema.config.generation.update(with_security_parameters=False)
    # The links are those that are declared. By their names alone, a shape that is stored could be restored.
    schema.config.phases.stateful.inference.algorithms = []
    # As 404 and 409 do, it tells of what is stored: no request is wrong by itself that has another ETag.
    accepted = schema.config.checks.positive_data_acceptance
    accepted.expected_statuses = [*accepted.expected_statuses, "412"]
    # Too large a body is refused before it is read.
    rejected = schema.config.checks.negative_data_rejection
    rejected.expected_statuses = [*rejected.expected_statuses, "413"]
    return schema


DESCRIBED = openapi_document()
load_all_checks()
meshes.register()
SCHEMA = _schema()


@pytest.fixture(scope="module")
def running(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Running]:
    """A service that holds two shapes, with a key."""
    folder = tmp_path_factory.mktemp("schema")
    # More jobs than are made here: what is refused for want of room is answered otherwise each time.
    limits = {"rate_limit": 0, "max_jobs": 10_000, "undo_days": 1}
    with serving(settings_in(folder, api_keys=(digest_of(KEY),), **limits), key=KEY) as running:
        _begin(running)
        yield running


@SCHEMA.parametrize()
@QUIET
def test_every_operation(case: Case, running: Running) -> None:
    with meshes.NamingSession() as session:
        response = case.call(session=session, **_sent_to(running))
    case.validate_response(response, excluded_checks=_beyond_the_schema(case, response))


def _sent_to(running: Running) -> dict[str, Any]:
    """The options of every request; on a busy machine ten seconds, which are the default, are few."""
    address = str(running.client.base_url).rstrip("/")
    return {"base_url": address, "headers": {"Authorization": f"Bearer {KEY}"}, "timeout": 120}


def _beyond_the_schema(case: Case, response: Response) -> list[CheckFunction]:
    """The checks that take the schema for all there is to know of what an operation takes."""
    refused_words = response.status_code == 422 and _beyond_words(response.json())
    # A sound body beside a header that is not is called sound as a whole.
    parts = () if case.meta is None else case.meta.components.values()
    sound_in_part = any(part.mode.is_negative for part in parts) or _breaks_a_pattern(case)
    excluded = [positive_data_acceptance] if refused_words or sound_in_part else []
    return [*excluded, negative_data_rejection] if case.media_type == FORM else excluded


def _breaks_a_pattern(case: Case) -> bool:
    """Whether a header is drawn that its pattern forbids: among several that may be left out, it is `0`."""
    describe = DESCRIBED["paths"][case.operation.path][case.operation.method.lower()]
    sent = {name.lower(): value for name, value in (case.headers or {}).items()}
    return any(
        re.search(each["schema"]["pattern"], sent[each["name"].lower()]) is None
        for each in describe.get("parameters", [])
        if each["in"] == "header" and "pattern" in each["schema"] and each["name"].lower() in sent
    )


def _beyond_words(problem: dict[str, Any]) -> bool:
    """Whether a request was refused for text that people write, ranges among it, a key of another request, or
    two fields that exclude one another, or a folder of the machine."""
    if problem["type"] in {f"{TYPE_PREFIX}idempotency-key-reused", f"{TYPE_PREFIX}source-refused"}:
        return True
    if EXCLUDED.search(problem["detail"]):
        return True
    faults = [fault["field"] for fault in problem.get("errors", [])]
    return bool(faults) and all(WRITTEN.intersection(field.split(".")) for field in faults)


def test_links_lead_to_stored_shapes(running: Running, request: pytest.FixtureRequest) -> None:
    """Sequences of requests along the links: upload, then read, change, query and delete."""
    first = int(request.config.getoption("hypothesis_seed") or 0) * ROUNDS
    reached: dict[str, set[int]] = defaultdict(set)

    class Workflow(SCHEMA.as_state_machine()):  # type: ignore[misc]
        def setup(self) -> None:
            """Every sequence begins alike."""
            _begin(running)
            self.restored: set[str] = set()

        def beyond_the_sequence(self, case: Case) -> list[CheckFunction]:
            """A shape that was deleted and then restored is there, which the check does not know."""
            return [use_after_free] if self.restored.intersection(case.path_parameters.values()) else []

        def before_call(self, case: Case) -> None:
            """Jobs go on by themselves: what is no question about one is asked when they have ended."""
            if not case.operation.path.startswith("/jobs") or case.operation.method != "get":
                wait_until(lambda: _ended(running), seconds=60)

        def get_call_kwargs(self, case: Case) -> dict[str, Any]:
            return {"session": meshes.NamingSession(), **_sent_to(running)}

        def validate_response(
            self, response: Response, case: Case, additional_checks: Any = None, **sent: Any
        ) -> None:
            case.validate_response(
                response,
                additional_checks=additional_checks,
                excluded_checks=_beyond_the_schema(case, response) + self.beyond_the_sequence(case),
                transport_kwargs=sent,
                recorder=self.recorder,
            )

        def after_call(self, response: Response, case: Case) -> None:
            super().after_call(response, case)
            if case.operation.label == "POST /shapes/{shape_id}/restore" and response.status_code == 200:
                self.restored.add(case.path_parameters["shape_id"])
            elif case.operation.label == "DELETE /shapes/{shape_id}" and response.status_code == 204:
                self.restored.discard(case.path_parameters["shape_id"])
            reached[case.operation.label].add(response.status_code)

    for each in range(first, first + ROUNDS):
        seed(each)(Workflow).run(settings=settings(QUIET, max_examples=SEQUENCES, stateful_step_count=12))
        if all(status in reached[label] for label, status in BY_LINKS.items()):
            return
    pytest.fail(f"in {ROUNDS * SEQUENCES} sequences nothing led to all of {BY_LINKS}: {dict(reached)}")


def _begin(running: Running) -> None:
    """Two shapes, and nothing of what was before."""
    wait_until(lambda: _ended(running), seconds=60)
    running.clear()
    with running.container.database.write() as session:
        for table in (JobRow, IdempotencyKeyRow):
            session.execute(delete(table))
    purge_old(running.container.database, timedelta(0))
    for format, data in (("off", small_file(0)), ("stl", small_file(1, "stl"))):
        running.store(data, f"stored.{format}")


def _ended(running: Running) -> bool:
    jobs = running.client.get("/jobs", params={"limit": 500}).json()["jobs"]
    return all(job["state"] not in {"waiting", "running"} for job in jobs)
