"""The SQL of the search for near-identical shapes."""

from collections.abc import Mapping
from typing import Any

from sqlalchemy import select

from service.shapes.records import ShapeFilter
from service.shapes.repository import matching
from service.storage.database import ReadSession
from service.storage.tables import ShapeRow


def facts(session: ReadSession, wanted: ShapeFilter) -> dict[int, Mapping[str, Any]]:
    """The facts of the shapes that match a filter, by number."""
    query = select(ShapeRow.number, ShapeRow.facts).where(ShapeRow.number.in_(matching(wanted)))
    return {row.number: row.facts for row in session.execute(query)}
