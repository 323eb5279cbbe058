"""The calls on collections."""

from service.client.calls import Call, nothing, parsed, segment
from service.collections.schemas import Collection, Collections


def collections() -> Call[Collections]:
    """List the collections that the key may use, by name, each with the number of its shapes."""
    return Call("GET", "/collections", parsed(Collections))


def create_collection(name: str) -> Call[Collection]:
    """Create a collection, unless it exists."""
    return Call("PUT", f"/collections/{segment(name)}", parsed(Collection))


def delete_collection(name: str) -> Call[None]:
    """Delete a collection that has no shapes."""
    return Call("DELETE", f"/collections/{segment(name)}", nothing)
