"""The report of an answer, with pictures drawn from the previews of the service."""

from collections.abc import Callable, Mapping
from hashlib import sha256

from service.client import Client
from service.report.page import MatchReport, PicturedResult, page
from service.report.pictures import Preview, alone, matched
from service.search.schemas import QueryAnswer, Result


def report(
    client: Client,
    file: tuple[str, bytes],
    options: Mapping[str, object],
    answer: QueryAnswer,
    drawn: Callable[[], object],
) -> str:
    """Return the page that shows a query and its answer.

    Parameters
    ----------
    client : Client
        The client of the service that answered.
    file : pair of str and bytes
        The name and the bytes of the query.
    options : mapping
        The options of the query, by the names of the HTTP fields.
    answer : QueryAnswer
        With correspondences.
    drawn : callable
        Called after each result is drawn.

    Raises
    ------
    ClientError
        A shape or the service is gone.
    ValueError
        The answer has no correspondences.
    """
    name, data = file
    # The service has read the file; its ending tells which axis is up.
    query = Preview.of(client.preview_file(file), name.rpartition(".")[2].lower())

    def found(result: Result) -> PicturedResult:
        if result.correspondence is None:
            raise ValueError("the answer has no correspondences")
        shape = Preview.of(client.preview(result.shape.id), result.shape.format)
        pictures = matched(query, shape, result.correspondence)
        drawn()
        return PicturedResult(result, *pictures)

    made = MatchReport(
        name=name,
        sha256=sha256(data).hexdigest(),
        picture=alone(query),
        options=options,
        answer=answer,
        found=tuple(found(result) for result in answer.results),
        version=client.version(),
    )
    return page(made)
