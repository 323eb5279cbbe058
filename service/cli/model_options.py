"""The options of a command that are the fields of a model."""

import inspect
from collections.abc import Callable, Collection
from functools import wraps
from typing import Annotated, Any, Literal, get_args, get_origin

import typer
from annotated_types import Ge, Gt, Le
from pydantic import BaseModel
from pydantic.fields import FieldInfo


def with_options(
    model: type[BaseModel], without: Collection[str] = (), **defaults: object
) -> Callable[[Callable[..., None]], Callable[..., None]]:
    """Return a decorator that gives a command an option for each field of a model, but for those `without`.

    An option has the name, type, bounds and description of its field, and its default or that of `defaults`.
    The command receives the options that are set, as a dict `options`.
    """
    fields = {name: field for name, field in model.model_fields.items() if name not in without}
    made = [_option(name, field, defaults.get(name)) for name, field in fields.items()]

    def decorate(command: Callable[..., None]) -> Callable[..., None]:
        signature = inspect.signature(command)
        own = [parameter for name, parameter in signature.parameters.items() if name != "options"]

        @wraps(command)
        def wrapped(**arguments: Any) -> None:  # noqa: ANN401
            given = {name: arguments.pop(name) for name in fields}
            options = {name: value for name, value in given.items() if value not in (None, [])}
            command(**arguments, options=options)

        parameters = sorted([*own, *made], key=lambda parameter: parameter.kind)
        wrapped.__dict__["__signature__"] = signature.replace(parameters=parameters)
        wrapped.__annotations__ = {parameter.name: parameter.annotation for parameter in parameters}
        return wrapped

    return decorate


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
