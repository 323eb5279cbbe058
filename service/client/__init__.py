"""Clients of the service's HTTP interface, for Python programs and for the command line.

    from service.client import Client

    with Client("http://127.0.0.1:8000") as archive:
        archive.upload("horse.off", tags=["horse"])
        for result in archive.query_file("another.off", top_k=5).results:
            print(result.rank, result.shape.name, result.cc)

`AsyncClient` has the same methods, to be awaited. Both return the models of the service's answers.
"""

from service.client.calls import Filters, Upload
from service.client.clients import AsyncClient, Client
from service.client.requests import (
    PROXY_RETRIES,
    RETRIES,
    ClientError,
    File,
    ProblemError,
    UnexpectedAnswerError,
    UnreachableError,
)

__all__ = [
    "PROXY_RETRIES",
    "RETRIES",
    "AsyncClient",
    "Client",
    "ClientError",
    "File",
    "Filters",
    "ProblemError",
    "UnexpectedAnswerError",
    "UnreachableError",
    "Upload",
    "calls",
    "clients",
]
