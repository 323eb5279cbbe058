"""The tables of near-identical shapes: pairs that registration found, and the shapes that are judged.

Each pair of judged shapes is decided: the table has it, or the shapes are no copies, or other pairs join
them. A service recomputes missing pairs and judgements from files and embeddings.
"""

from sqlalchemy import ForeignKey, Index, String, UniqueConstraint
from sqlalchemy.orm import Mapped, mapped_column

from service.storage.tables import Table


class DuplicatePairRow(Table):
    """Two shapes of one collection of which the second is a rigid copy, or a variant, of the first.

    `fingerprint` identifies the pipeline that computed `cc`. `residual` is their distance after registration
    over the root of the area, and `scale` a length in the second over that in the first.
    """

    __tablename__ = "duplicate_pairs"
    __table_args__ = (Index("duplicate_pairs_by_second", "second_number"),)

    first_number: Mapped[int] = mapped_column(
        ForeignKey("shapes.number", ondelete="CASCADE"), primary_key=True, autoincrement=False
    )
    second_number: Mapped[int] = mapped_column(
        ForeignKey("shapes.number", ondelete="CASCADE"), primary_key=True, autoincrement=False
    )
    fingerprint: Mapped[str] = mapped_column(String(16), primary_key=True)
    cc: Mapped[float]
    residual: Mapped[float]
    scale: Mapped[float]
    mirrored: Mapped[bool]
    variant: Mapped[bool]


class JudgedShapeRow(Table):
    """A shape that has been compared with all other judged shapes of its collection.

    `variants` tells a search for variants from one for copies. Pairs with at least `min_cc` and at most
    `max_residual` were found. `compared` and `aligned` count the compared and the registered pairs. `number`
    orders the rows by time.
    """

    __tablename__ = "judged_shapes"
    __table_args__ = (
        UniqueConstraint("shape_number", "fingerprint", "variants", name="one_judgement_a_search"),
        {"sqlite_autoincrement": True},
    )

    number: Mapped[int] = mapped_column(primary_key=True)
    shape_number: Mapped[int] = mapped_column(ForeignKey("shapes.number", ondelete="CASCADE"))
    fingerprint: Mapped[str] = mapped_column(String(16))
    variants: Mapped[bool]
    min_cc: Mapped[float]
    max_residual: Mapped[float]
    compared: Mapped[int]
    aligned: Mapped[int]
