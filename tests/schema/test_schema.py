"""What the OpenAPI document promises is what the service does, by requests generated from the document."""

from collections import defaultdict
from collections.abc import Iterator
from typing import Any

import pytest
import schemathesis
from hypothesis import HealthCheck, Phase, settings
from schemathesis import Case, CheckContext, CheckFunction, Response
from schemathesis.checks import load_all_checks
from schemathesis.specs.openapi.checks import negative_data_rejection, positive_data_acceptance

from service.access.keys import digest_of
from service.openapi import document
from service.problems import TYPE_PREFIX
from tests.schema import meshes
from tests.service.support import Running, serving, settings_in, small_file

pytestmark = pytest.mark.schema

KEY = "a-key-for-the-tests-of-the-document"
# Their text fields follow rules that a schema does not tell: see `service.shapes.fields`.
WITH_TEXT = {
    *("POST /shapes", "GET /shapes", "PATCH /shapes/{shape_id}", "POST /query"),
    *("POST /jobs", "GET /jobs", "GET /jobs/{job_id}/files"),
}
# In it everything is text: any may be a tag, and true is written in many ways.
FORM = "multipart/form-data"
QUIET = settings(
    max_examples=25,
    derandomize=True,
    deadline=None,
    database=None,
    phases=[Phase.explicit, Phase.generate],
    suppress_health_check=list(HealthCheck),
)


def _schema(without: str | None = None) -> schemathesis.BaseSchema:
    described = document()
    if without is not None:
        described["paths"] = {
            path: operations
            for path, operations in described["paths"].items()
            if not path.startswith(without)
        }
    meshes.mark_files(described)
    meshes.forget_repetitions(described)
    schema = schemathesis.openapi.from_dict(described)
    # A key that is made up is refused, which tests nothing else.
    schema.config.generation.update(with_security_parameters=False)
    return schema


load_all_checks()
meshes.register()
SCHEMA = _schema()


@schemathesis.check
def refused_field_by_field(_context: CheckContext, response: Response, case: Case) -> bool | None:
    """Where text breaks a rule that the schema does not tell, the answer names the field."""
    if case.operation.label in WITH_TEXT and response.status_code == 422:
        problem = response.json()
        if problem["type"] == f"{TYPE_PREFIX}bad-request-fields":
            assert problem["errors"]
    return None


@pytest.fixture(scope="module")
def running(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Running]:
    """A service that holds two shapes, with a key."""
    folder = tmp_path_factory.mktemp("schema")
    with serving(settings_in(folder, api_keys=(digest_of(KEY),), rate_limit=0), key=KEY) as running:
        for format, data in (("off", small_file(0)), ("stl", small_file(1, "stl"))):
            running.store(data, f"stored.{format}")
        yield running


@SCHEMA.parametrize()
@QUIET
def test_every_operation(case: Case, running: Running) -> None:
    with meshes.NamingSession() as session:
        case.call_and_validate(
            base_url=str(running.client.base_url).rstrip("/"),
            session=session,
            headers={"Authorization": f"Bearer {KEY}"},
            excluded_checks=_beyond_the_schema(case),
        )


def _beyond_the_schema(case: Case) -> list[CheckFunction]:
    """The checks that take the schema for all there is to know of what an operation takes."""
    excluded: list[CheckFunction] = []
    if case.operation.label in WITH_TEXT:
        excluded.append(positive_data_acceptance)
    if case.media_type == FORM:
        excluded.append(negative_data_rejection)
    return excluded


def test_what_was_stored_is_what_links_lead_to(running: Running) -> None:
    """Sequences of requests along the links: upload, then read, change, query and delete."""
    base_url = str(running.client.base_url).rstrip("/")

    # Jobs go on by themselves, so that no sequence of requests about them is answered alike twice.
    class Workflow(_schema(without="/jobs").as_state_machine()):  # type: ignore[misc]
        def get_call_kwargs(self, case: Case) -> dict[str, Any]:
            return {
                "base_url": base_url,
                "session": meshes.NamingSession(),
                "headers": {"Authorization": f"Bearer {KEY}"},
            }

        def validate_response(
            self, response: Response, case: Case, additional_checks: Any = None, **sent: Any
        ) -> None:
            case.validate_response(
                response,
                additional_checks=additional_checks,
                excluded_checks=_beyond_the_schema(case),
                transport_kwargs=sent,
                recorder=self.recorder,
            )

        def after_call(self, response: Response, case: Case) -> None:
            super().after_call(response, case)
            reached[case.operation.label].add(response.status_code)

    reached: dict[str, set[int]] = defaultdict(set)
    Workflow.run(settings=settings(QUIET, max_examples=20, stateful_step_count=12))
    assert reached["POST /shapes"] >= {201}
    for label in ("GET /shapes/{shape_id}", "PATCH /shapes/{shape_id}", "GET /shapes/{shape_id}/embedding"):
        assert reached[label] >= {200}, label
    assert reached["DELETE /shapes/{shape_id}"] >= {204}
    assert reached["POST /query"] >= {200}
