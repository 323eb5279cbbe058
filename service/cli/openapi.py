"""`isoshape openapi`: the document that describes the HTTP interface."""

from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Annotated

import typer

from service import openapi_document as openapi


def command(
    output: Annotated[Path, typer.Option(help="File to write, or - for standard output.")] = Path(
        "openapi/openapi.json"
    ),
) -> None:
    """Write the OpenAPI document of the service."""
    if output == Path("-"):
        with TemporaryDirectory() as folder:
            document = Path(folder) / "openapi.json"
            openapi.write(document)
            typer.echo(document.read_text(encoding="utf-8"), nl=False)
    else:
        output.parent.mkdir(parents=True, exist_ok=True)
        openapi.write(output)
