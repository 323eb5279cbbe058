"""Parameters that stand in an address more often than the document says."""

from collections import Counter

from fastapi import Request

from service.errors import BadRequestFieldsError, FieldFault


async def refuse_duplicate_parameters(request: Request) -> None:
    """Refuse a parameter that is given more than once and is no list: the framework would take the last.

    Raises
    ------
    BadRequestFieldsError
    """
    counts = Counter(name for name, _ in request.query_params.multi_items())
    repeated = {name for name, count in counts.items() if count > 1}
    if repeated:
        route = getattr(request.scope.get("route"), "path", "")
        operation = request.app.openapi()["paths"].get(route, {}).get(request.method.lower(), {})
        once = {
            parameter["name"]
            for parameter in operation.get("parameters", [])
            if parameter["in"] == "query" and parameter["schema"].get("type") != "array"
        }
        if repeated & once:
            faults = [FieldFault(name, "given more than once") for name in sorted(repeated & once)]
            raise BadRequestFieldsError(*faults)
