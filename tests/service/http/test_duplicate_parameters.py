"""Parameters that are given twice, read off the document: only lists may be."""

import pytest

from service.openapi_document import document
from tests.service.support import Running, assert_problem

PARAMETERS = [
    pytest.param(method, path, parameter, id=f"{method} {path} {parameter['name']}")
    for path, operations in document()["paths"].items()
    for method, operation in operations.items()
    for parameter in operation.get("parameters", [])
    if parameter["in"] == "query"
]


def test_there_are_lists_and_others() -> None:
    lists = {each.values[2]["name"] for each in PARAMETERS if each.values[2]["schema"].get("type") == "array"}
    assert lists == {"tag", "metadata", "exclude"}
    assert len(PARAMETERS) > 2 * len(lists)


@pytest.mark.parametrize(("method", "path", "parameter"), PARAMETERS)
def test_only_a_list_may_be_given_twice(shared: Running, method: str, path: str, parameter: dict) -> None:
    address = path.replace("{shape_id}", "none").replace("{job_id}", "none")
    name, value = parameter["name"], "a=b"
    answer = shared.client.request(method, address, params=[(name, value), (name, value)])
    faults = answer.json().get("errors", [])
    if parameter["schema"].get("type") == "array":
        assert faults == []
    else:
        assert_problem(answer, 422, "bad-request-fields")
        assert faults == [{"field": name, "message": "given more than once"}]
    # What the document does not know is nobody's fault here.
    assert shared.client.get("/healthz", params=[("x", "1"), ("x", "1")]).status_code == 200
