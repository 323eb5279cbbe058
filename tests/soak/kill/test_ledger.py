"""The judge of the kill cycles: it sees a write that is lost, torn, or back from the dead."""

import hashlib
from typing import Any

import pytest

from tests.soak.kill.ledger import Ledger, Sent


def sent(name: str) -> Sent:
    return Sent(name, name.encode(), "tag", {"number": 1})


def shape(name: str, **other: Any) -> dict[str, Any]:
    """The record of a shape that was stored as it was sent."""
    return {
        "id": f"id of {name}",
        "name": name,
        "tags": ["tag"],
        "metadata": {"number": 1},
        "bytes": len(name),
        "sha256": hashlib.sha256(name.encode()).hexdigest(),
        "embedded": True,
        **other,
    }


@pytest.fixture
def ledger() -> Ledger:
    """Two uploads and a deletion were acknowledged; an upload and a deletion were not."""
    ledger = Ledger()
    for name in ("deleted", "going", "stored", "unknown"):
        ledger.send(sent(name))
    for name in ("deleted", "going", "stored"):
        ledger.stored(name, f"id of {name}")
    assert ledger.take(0) == "id of deleted"
    ledger.deleted("id of deleted")
    assert ledger.take(0) == "id of going"
    assert ledger.acknowledged == 4
    return ledger


@pytest.mark.parametrize(
    "there", [{"stored"}, {"stored", "going"}, {"stored", "unknown"}, {"stored", "going", "unknown"}]
)
def test_a_shape_without_acknowledgement_may_be_there_or_not(ledger: Ledger, there: set[str]) -> None:
    assert ledger.settle([shape(name) for name in there]) == []
    assert ledger.found == ("unknown" in there)
    # From then on it is known.
    assert ledger.settle([shape(name) for name in there]) == []
    assert len(ledger.settle([])) == len(there)


def test_a_shape_is_taken_only_while_there_are_enough(ledger: Ledger) -> None:
    assert ledger.take(1) is None
    assert ledger.take(0) == "id of stored"
    assert ledger.take(0) is None


@pytest.mark.parametrize(
    ("shapes", "fault"),
    [
        ([], "stored, acknowledged, is lost"),
        ([shape("stored"), shape("deleted")], "deleted is there again"),
        ([shape("stored"), shape("never")], "never is there and was never sent"),
        ([shape("stored", tags=[])], "stored is torn: tags"),
        ([shape("stored", metadata={})], "stored is torn: metadata"),
        ([shape("stored", bytes=1)], "stored is torn: bytes"),
        ([shape("stored", sha256="0")], "stored is torn: sha256"),
        ([shape("stored", embedded=False)], "stored is torn: embedded"),
        ([shape("stored"), shape("unknown", tags=[])], "unknown is torn: tags"),
        ([shape("stored"), shape("unknown"), shape("unknown", id="2")], "unknown is there 2 times"),
    ],
)
def test_every_fault_is_seen(ledger: Ledger, shapes: list[dict[str, Any]], fault: str) -> None:
    (found,) = ledger.settle(shapes)
    assert found.startswith(fault)
