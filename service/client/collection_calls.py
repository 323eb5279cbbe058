"""What is sent about collections themselves."""

from service.client.calls import Call, nothing, parsed, segment
from service.collections.schemas import Collection, Collections


def collections() -> Call[Collections]:
    """The collections that the key may use, by name, each with the number of its shapes."""
    return Call("GET", "/collections", parsed(Collections))


def create_collection(name: str) -> Call[Collection]:
    """Have a collection of this name, whether it was there before or not."""
    return Call("PUT", f"/collections/{segment(name)}", parsed(Collection))


def delete_collection(name: str) -> Call[None]:
    """Delete a collection that has no shapes."""
    return Call("DELETE", f"/collections/{segment(name)}", nothing)
