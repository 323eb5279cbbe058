"""A report of an answer: its pictures are drawn from what the service shows of each shape."""

from collections.abc import Callable, Mapping
from hashlib import sha256

from service.client import Client
from service.report.page import Found, Report, page
from service.report.pictures import Preview, alone, matched
from service.search.schemas import QueryAnswer, Result


def report(
    client: Client,
    file: tuple[str, bytes],
    options: Mapping[str, object],
    answer: QueryAnswer,
    drawn: Callable[[], object],
) -> str:
    """The page that shows a query and its answer.

    Parameters
    ----------
    client : Client
        Of the service that answered.
    file : pair of str and bytes
        What it was asked with: a name, and a mesh.
    options : mapping
        How, by the names of the interface.
    answer : QueryAnswer
        With correspondences.
    drawn : callable
        Told whenever a result is drawn.

    Raises
    ------
    ClientError
        A shape is gone, or the service is.
    ValueError
        The answer has no correspondences.
    """
    name, data = file
    # The service has read it, whatever this process reads: the ending alone says what is up.
    query = Preview.of(client.preview_file(file), name.rpartition(".")[2].lower())

    def found(result: Result) -> Found:
        if result.correspondence is None:
            raise ValueError("the answer has no correspondences")
        shape = Preview.of(client.preview(result.shape.id), result.shape.format)
        pictures = matched(query, shape, result.correspondence)
        drawn()
        return Found(result, *pictures)

    made = Report(
        name=name,
        sha256=sha256(data).hexdigest(),
        picture=alone(query),
        options=options,
        answer=answer,
        found=tuple(found(result) for result in answer.results),
        version=client.version(),
    )
    return page(made)
