"""The SQL by which a shape that changes leaves the pairs of near-identical shapes."""

from sqlalchemy import delete, or_, select

from service.storage.database import WriteSession
from service.storage.tables import DuplicatePairRow, JudgedShapeRow


def forget(session: WriteSession, number: int) -> None:
    """Delete the pairs and the judgement of a shape, and have its copies judged again.

    Two copies of a third shape need not be a pair themselves: without the third, their pair is unknown.
    """
    first, second = DuplicatePairRow.first_number, DuplicatePairRow.second_number
    copies = select(first).where(second == number).union(select(second).where(first == number))
    unknown = JudgedShapeRow.shape_number
    session.execute(delete(JudgedShapeRow).where(or_(unknown == number, unknown.in_(copies))))
    session.execute(delete(DuplicatePairRow).where(or_(first == number, second == number)))
