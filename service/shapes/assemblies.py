"""Assemblies: a file in; the distinct parts of its mesh, as new shapes, out."""

from service.compute.reader_answers import PartFile
from service.container import Container
from service.errors import BadRequestFieldsError, FieldFault
from service.shapes.fields import NAME_CHARACTERS, clean_metadata, clean_name
from service.shapes.records import NewShape

ASSEMBLY, PATH, INSTANCES = "assembly", "assembly_path", "instances"
"""Keys of a part's metadata: the name of the whole shape, the names from the root of the assembly to the
first instance of the part, and the number of instances."""

# The format that parts are written in, which states its unit.
_PART_FORMAT = "3mf"
_PATH_CHARACTERS = 1_000


async def parts_of(container: Container, whole: NewShape) -> list[NewShape]:
    """Read each distinct part of a file in a worker; return an empty list for a file without parts.

    A part is a 3MF in its own frame, with the tags and the metadata of the whole, and with `ASSEMBLY`, `PATH`
    and `INSTANCES`.

    Raises
    ------
    BadRequestFieldsError
        The metadata have a key of the parts, or no room for them.
    MeshError
        The file cannot be read.
    """
    reserved = sorted({ASSEMBLY, PATH, INSTANCES} & whole.metadata.keys())
    if reserved:
        raise BadRequestFieldsError(
            FieldFault("metadata", f"with split=parts, the service sets {', '.join(reserved)}")
        )
    parts = await container.queue.parts(whole.data, whole.format)
    return [_shape_of(whole, part, number) for number, part in enumerate(parts, start=1)]


def _shape_of(whole: NewShape, part: PartFile, number: int) -> NewShape:
    """Return a part as a new shape, with its assembly before its name."""
    part_name = part.name or f"part {number}"
    path = "/".join(part.path)
    about = {ASSEMBLY: whole.name, PATH: path[-_PATH_CHARACTERS:], INSTANCES: part.instances}
    try:
        metadata = clean_metadata({**whole.metadata, **about})
    except ValueError as error:
        fault = FieldFault("metadata", f"with the metadata of the part {part_name!r}: {error}")
        raise BadRequestFieldsError(fault) from error
    name = clean_name(f"{whole.name[: NAME_CHARACTERS - len(part_name) - 1]}/{part_name}")
    return NewShape(part.data, _PART_FORMAT, whole.collection, name, whole.tags, metadata, is_part=True)
