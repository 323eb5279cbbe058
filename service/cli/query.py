"""`isoshape query`: the stored shapes most similar to a file."""

import inspect
from collections.abc import Callable
from functools import wraps
from pathlib import Path
from typing import Annotated, Any, Literal, get_args, get_origin

import typer
from annotated_types import Ge, Gt, Le
from pydantic.fields import FieldInfo
from rich.console import Console
from rich.table import Table

from service.cli.service_address import Collection, Key, Url, service_at
from service.client import Client
from service.console import output, progress, say, table
from service.search.schemas import (
    CC_OF_PAIRS,
    QueryAnswer,
    SearchOptions,
    likeness_in_words,
    score_in_words,
)
from service.shapes.schemas import box_in_words, number_in_words, volume_in_words

UNOFFERED = {"correspondences", "embedding"}
"""Options of a search that the command does not have."""


def with_search_options(command: Callable[..., None]) -> Callable[..., None]:
    """Give a command an option for each field of `SearchOptions`: its name, type, bounds and description.

    The command receives the options that are set, as a dict `options`; what the user leaves out has the
    default of the model, but for the ranking.
    """
    fields = {name: field for name, field in SearchOptions.model_fields.items() if name not in UNOFFERED}
    signature = inspect.signature(command)
    own = [parameter for name, parameter in signature.parameters.items() if name != "options"]
    made = [_option(name, field, "combined" if name == "rank_by" else None) for name, field in fields.items()]

    @wraps(command)
    def wrapped(**arguments: Any) -> None:  # noqa: ANN401
        given = {name: arguments.pop(name) for name in fields}
        options = {name: value for name, value in given.items() if value not in (None, [])}
        command(**arguments, options=options)

    parameters = sorted([*own, *made], key=lambda parameter: parameter.kind)
    wrapped.__dict__["__signature__"] = signature.replace(parameters=parameters)
    wrapped.__annotations__ = {parameter.name: parameter.annotation for parameter in parameters}
    return wrapped


def _option(name: str, field: FieldInfo, default: object) -> inspect.Parameter:
    """Return a parameter of a command from a field; None stands for a list or a value that is left out."""
    kind = _plain_type(field.annotation)
    bounds: dict[str, Any] = {}
    for bound in field.metadata:
        if isinstance(bound, Ge | Gt):
            bounds["min"] = bound.ge if isinstance(bound, Ge) else bound.gt
        elif isinstance(bound, Le):
            bounds["max"] = bound.le
    if kind is bool:
        option = typer.Option(f"--{name.replace('_', '-')}", help=field.description)
        annotation, default = Annotated[bool, option], False
    else:
        annotation = Annotated[kind | None, typer.Option(help=field.description, **bounds)]
        default = default or field.get_default() or None
    return inspect.Parameter(name, inspect.Parameter.KEYWORD_ONLY, annotation=annotation, default=default)


def _plain_type(annotation: Any) -> Any:  # noqa: ANN401
    """Return the type of a field without None and without what only the model checks."""
    if get_origin(annotation) is Literal:
        return annotation
    if get_origin(annotation) is Annotated:
        return _plain_type(get_args(annotation)[0])
    if get_origin(annotation) is list:
        return list[str]
    types = [each for each in get_args(annotation) if each is not type(None)]
    return _plain_type(types[0]) if types else annotation


# Correspondences are asked for the page; the JSON leaves them out.
UNASKED = {"results": {"__all__": {"correspondence"}}}


@with_search_options
def query_command(
    file: Annotated[Path, typer.Argument(metavar="FILE", help="A mesh file.")],
    *,
    as_json: Annotated[bool, typer.Option("--json", help="Print the answer of the service as JSON.")] = False,
    html: Annotated[
        Path | None,
        typer.Option(help="Also write a page with pictures of corresponding points to this file."),
    ] = None,
    url: Url = None,
    key: Key = None,
    collection: Collection = None,
    options: dict[str, Any],
) -> None:
    """Find the stored shapes most similar to a mesh file."""
    mesh = (file.name, file.read_bytes())
    with service_at(url, key, collection) as client:
        answer = client.query_file(mesh, **options, correspondences=html is not None)
        if html is not None:
            write_report(client, mesh, options, answer, html)
    if as_json:
        typer.echo(answer.model_dump_json(exclude_none=True, exclude=UNASKED))
    else:
        print_answer(output(), answer)
        times = ", ".join(f"{stage} {time:.0f}" for stage, time in answer.milliseconds.items())
        for warning in answer.warnings:
            say(f"{file}: {warning}")
        order = "part distance" if options["partial"] else options["rank_by"]
        compared = f"{answer.compared} of {answer.stored} stored shapes compared"
        if answer.results:
            say(CC_OF_PAIRS)
        say(f"{compared}; sorted by {order}; milliseconds: {times}")


def write_report(
    client: Client, mesh: tuple[str, bytes], options: dict[str, Any], answer: QueryAnswer, path: Path
) -> None:
    """Write the page of an answer, in UTF-8 on every system."""
    # Here, so that a query without a page does not wait for the imports of drawing.
    from service.report import report  # noqa: PLC0415

    with progress() as bar:
        task = bar.add_task("drawing", total=len(answer.results))
        text = report(client, mesh, options, answer, lambda: bar.advance(task))
    path.write_bytes(text.encode())


def print_answer(console: Console, answer: QueryAnswer) -> None:
    """Print the results as a table."""
    if not answer.compared:
        console.print("no stored shape could be compared")
        return
    if not answer.results:
        console.print("no compared shape has so high a cc")
        return
    columns = [">rank", "name", "likeness", "tags", ">cc", ">ssd", ">sim", ">combined"]
    partial = any(result.part_distance is not None for result in answer.results)
    if partial:
        columns.append(">part distance")
    results = table(*columns, fold=("name", "likeness", "tags"))
    for result in answer.results:
        part_distance = [] if result.part_distance is None else [f"{result.part_distance:.4f}"]
        results.add_row(
            str(result.rank),
            result.shape.name,
            likeness_in_words(result.likeness, result.scale),
            ", ".join(result.shape.tags),
            score_in_words(result.cc),
            f"{result.ssd:.4f}",
            f"{result.sim:.4f}",
            f"{result.combined:.3f}",
            *part_distance,
        )
    console.print(results)
    console.print(_sizes(answer))
    if not (answer.matched or partial or any(result.likeness != "weak" for result in answer.results)):
        console.print("No result is similar: the best cc is below the pipeline's threshold.")


def _sizes(answer: QueryAnswer) -> Table:
    """Return the sizes of the results."""
    sizes = table(">rank", "unit", "length × width × height", ">area", ">volume", ">size over query")
    for result in answer.results:
        facts, ratio = result.shape.facts, result.size_ratio
        sizes.add_row(
            str(result.rank),
            result.shape.unit or "not stated",
            box_in_words(facts),
            number_in_words(facts.area),
            volume_in_words(facts),
            "" if ratio is None else number_in_words(ratio),
        )
    return sizes
