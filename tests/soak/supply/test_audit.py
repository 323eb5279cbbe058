"""The verdict of `make audit` on the report of pip-audit."""

import json

import pytest

from tests.soak.supply.audit import judge

GOOD = {"name": "one", "version": "1.0", "vulns": []}
BAD = {
    "name": "two",
    "version": "2.0",
    "vulns": [{"id": "PYSEC-2021-66", "fix_versions": ["2.1", "3.0"]}, {"id": "GHSA-x", "fix_versions": []}],
}
UNKNOWN = {
    "name": "three",
    "skip_reason": "Dependency not found on PyPI and could not be audited: three (3.0)",
}


def audit(*packages):
    return judge(json.dumps({"dependencies": packages, "fixes": []}), "No known vulnerabilities found")


def test_nothing_found():
    assert audit(GOOD, GOOD) == (0, "2 packages, none with a known vulnerability.")


@pytest.mark.parametrize("others", [[], [GOOD], [UNKNOWN]])
def test_a_finding_fails_whatever_else_there_is(others):
    status, said = audit(*others, BAD)
    assert status == 1
    assert said.splitlines()[:2] == [
        "two 2.0: PYSEC-2021-66, repaired in 2.1, 3.0",
        "two 2.0: GHSA-x, repaired in no version",
    ]


def test_a_package_that_could_not_be_looked_up_fails():
    status, said = audit(GOOD, UNKNOWN)
    assert (status, said) == (1, "three: Dependency not found on PyPI and could not be audited: three (3.0)")


@pytest.mark.parametrize("packages", [[UNKNOWN, UNKNOWN], []])
def test_an_index_without_advisories_is_not_taken_for_good_news(packages):
    status, said = audit(*packages)
    assert status == 0
    assert said.startswith("Not audited")


@pytest.mark.parametrize(
    "error",
    [
        "requests.exceptions.ProxyError: HTTPSConnectionPool(host='pypi.org', port=443): Max retries",
        "requests.exceptions.ConnectionError: [Errno -2] Name or service not known",
        "ERROR:pip_audit._cli:Could not connect to PyPI's vulnerability feed",
    ],
)
def test_advisories_that_cannot_be_reached_fail_nothing_and_are_said(error):
    status, said = judge("", f"Traceback (most recent call last):\n  a line\n{error}\n")
    assert status == 0
    assert said == f"Not audited: the advisories cannot be reached. {error}"


@pytest.mark.parametrize("error", ["", "ERROR:pip_audit._cli:invalid requirements input", "KeyError: 'info'"])
def test_any_other_failure_fails(error):
    assert judge("", error)[0] == 1
    assert judge("{}", error)[0] == 1
