"""The OpenAPI document: the file, the live schema, and the answers that are really given."""

import json
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

from core.io import FORMATS
from service.http.problem_document import MEDIA_TYPE, Problem
from service.search.compare_schemas import CompareAnswer
from service.search.schemas import QueryAnswer
from service.settings import PREFIX
from service.shapes.schemas import EmbeddingArrays, Shape, ShapePage
from service.system.schemas import Health, Readiness, Version
from tests.service.support import Running, document, operations, pipeline_in_use

FILE = Path(__file__).parents[3] / "openapi" / "openapi.json"
MODELS = (Problem, CompareAnswer, QueryAnswer, EmbeddingArrays, Shape, ShapePage, Health, Readiness, Version)
OPERATIONS = [
    pytest.param(operation, id=f"{method} {path}") for (method, path), operation in operations().items()
]


def test_the_file_is_the_live_schema(shared: Running) -> None:
    assert json.loads(FILE.read_text()) == document()
    assert shared.client.get("/openapi.json").json() == document()


def test_writing_it_gives_the_same_bytes_in_another_process() -> None:
    script = "import service.app as o; print(o.openapi_text(), end='')"
    written = subprocess.run(
        [sys.executable, "-c", script],
        env={"PYTHONPATH": ":".join(sys.path), "PYTHONHASHSEED": "7", PREFIX + "PORT": "1"},
        check=True,
        capture_output=True,
    ).stdout
    assert written == FILE.read_bytes()


@pytest.mark.parametrize("operation", OPERATIONS)
def test_every_operation_is_described(operation: dict[str, Any]) -> None:
    assert operation["summary"]
    assert operation["description"]
    assert operation["tags"]
    assert all(parameter.get("description") for parameter in operation.get("parameters", []))
    for status, response in operation["responses"].items():
        assert response["description"], status
        if int(status) >= 400:
            assert set(response["content"]) == {MEDIA_TYPE}
            assert response["content"][MEDIA_TYPE]["schema"] == {"$ref": "#/components/schemas/Problem"}
            for example in response["content"][MEDIA_TYPE]["examples"].values():
                assert Problem.model_validate(example["value"]).status == int(status)


@pytest.mark.parametrize("model", MODELS)
def test_examples_are_what_their_model_says(model: Any) -> None:
    extra = model.model_config.get("json_schema_extra") or {}
    if "example" in extra:
        given = model.model_validate(extra["example"])
        assert set(extra["example"]) <= set(model.model_fields)
        assert model.model_validate_json(given.model_dump_json()) == given
    names = {name for name, field in model.model_fields.items() if field.is_required()}
    assert names == set(model.model_json_schema().get("required", []))


def test_references_lead_somewhere() -> None:
    whole = document()

    def walk(value: Any) -> None:
        if isinstance(value, dict):
            if "$ref" in value:
                assert value["$ref"].removeprefix("#/components/schemas/") in whole["components"]["schemas"]
            for inner in value.values():
                walk(inner)
        elif isinstance(value, list):
            for inner in value:
                walk(inner)

    walk(whole)
    assert "HTTPValidationError" not in whole["components"]["schemas"]


def test_the_service_tells_of_itself(shared: Running) -> None:
    assert shared.client.get("/healthz").json() == {"status": "ok"}
    assert shared.client.get("/readyz").json() == {"status": "ready"}
    told = shared.client.get("/version").json()
    assert told["pipeline"] == "default"
    assert told["fingerprint"] == pipeline_in_use(shared).fingerprint
    assert told["version"] == document()["info"]["version"]
    formats = {known["name"]: known for known in told["formats"]}
    assert list(formats) == list(FORMATS)
    assert formats["step"]["endings"] == ["step", "stp"]
    assert (formats["step"]["read"], formats["step"]["written"]) == (FORMATS["step"].is_read, False)
    assert (formats["off"]["read"], formats["off"]["written"]) == (True, True)


def test_operations_have_ids_of_their_own_and_say_what_they_answer() -> None:
    ids = [operation["operationId"] for operation in operations().values()]
    assert len(set(ids)) == len(ids)
    ready = document()["paths"]["/readyz"]["get"]["responses"]["200"]
    assert ready["content"]["application/json"]["schema"] == {"$ref": "#/components/schemas/Readiness"}
