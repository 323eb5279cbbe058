"""The SQL of facets: counts of the shapes that pass a filter, by tag, format, length and collection."""

from collections import Counter
from collections.abc import Collection as Several
from collections.abc import Iterable
from dataclasses import replace
from math import floor, inf, log10, nextafter

from sqlalchemy import func, select

from service.shapes.facets import Count, Facets, LengthBand
from service.shapes.records import ShapeFilter
from service.shapes.repository import LENGTH, conditions, matching
from service.storage.database import ReadSession
from service.storage.tables import NOT_DELETED, CollectionRow, ShapeRow, TagRow


def facets(
    session: ReadSession, shapes: ShapeFilter, names: Several[str] | None, tag_text: str, limit: int
) -> Facets:
    """Count the shapes that pass a filter.

    Parameters
    ----------
    session : ReadSession
    shapes : ShapeFilter
    names : collection of str or None
        The collections that are counted; None for all.
    tag_text : str
        Only tags that contain this text are counted; upper and lower case are equal.
    limit : int
        The largest number of tags.
    """
    number, text = func.count(), tag_text.casefold()
    of_tags = select(TagRow.tag, number).where(TagRow.shape_number.in_(matching(shapes))).group_by(TagRow.tag)
    tags = _by_count((tag, count) for tag, count in session.execute(of_tags) if text in tag.casefold())
    of_any_format = ShapeRow.number.in_(matching(replace(shapes, file_format=None)))
    of_formats = select(ShapeRow.format, number).where(of_any_format).group_by(ShapeRow.format)
    of_any_length = ShapeRow.number.in_(matching(replace(shapes, length=None)))
    of_collections = (
        select(CollectionRow.name, func.count(ShapeRow.number))
        .outerjoin(
            ShapeRow, (ShapeRow.collection_number == CollectionRow.number) & NOT_DELETED & conditions(shapes)
        )
        .group_by(CollectionRow.name)
        .order_by(CollectionRow.name)
    )
    if names is not None:
        of_collections = of_collections.where(CollectionRow.name.in_(names))
    return Facets(
        total=session.scalar(select(number).select_from(matching(shapes).subquery())) or 0,
        tags=tags[:limit],
        distinct_tags=len(tags),
        formats=_by_count((format, count) for format, count in session.execute(of_formats)),
        lengths=_bands(session.scalars(select(LENGTH).where(of_any_length))),
        collections=[Count(value=name, count=count) for name, count in session.execute(of_collections)],
    )


def _by_count(counts: Iterable[tuple[str, int]]) -> list[Count]:
    ordered = sorted(counts, key=lambda each: (-each[1], each[0]))
    return [Count(value=value, count=count) for value, count in ordered]


def _bands(lengths: Iterable[float]) -> list[LengthBand]:
    """Count lengths, each > 0, in bands between 1, 2 and 5 times powers of ten."""
    counts = Counter(_band(length) for length in lengths)
    return [
        # The filter takes both ends of its range.
        LengthBand(value=f"{nextafter(least, inf)}..{greatest}", least=least, greatest=greatest, count=count)
        for (least, greatest), count in sorted(counts.items())
    ]


def _band(length: float) -> tuple[float, float]:
    """Return the band of a length: above its least length, and at most its greatest."""
    power = floor(log10(length))
    exponents = power - 1, power, power + 1
    limits = [float(f"{digit}e{exponent}") for exponent in exponents for digit in (1, 2, 5)]
    above = next(i for i, limit in enumerate(limits) if length <= limit)
    return limits[above - 1], limits[above]
