"""Archives of before: shapes that were stored without a bounding box get one from their files."""

from pathlib import Path

from sqlalchemy import select, update

from service.storage.checking import check
from service.storage.database import Database
from service.storage.tables import BlobRow, ShapeRow
from tests.service.engines import on_both
from tests.service.support import serving, settings_in, small_file, wait_until

pytestmark = on_both


def forget_boxes(url: str) -> None:
    """Leave the archive as a version without bounding boxes would, except for the checksums."""
    database = Database(url, lock_seconds=10)
    with database.write() as session:
        for number, facts in session.execute(select(ShapeRow.number, ShapeRow.facts)).all():
            before = {name: value for name, value in facts.items() if name != "bounding_box"}
            session.execute(update(ShapeRow).where(ShapeRow.number == number).values(facts=before))
    database.close()


def test_boxes_are_measured_after_the_start_and_a_damaged_file_has_none(tmp_path: Path, engine: str) -> None:
    settings = settings_in(tmp_path)
    with serving(settings) as running:
        for number in range(3):
            running.store(small_file(number), f"{number}.off")
        running.store(small_file(1), "copy of 1.off")
        before = running.client.get("/shapes").json()["shapes"]
        assert all(len(shape["facts"]["bounding_box"]) == 3 for shape in before)
    forget_boxes(settings.database_url)
    database = Database(settings.database_url, lock_seconds=10)
    with database.write() as session:
        damaged = next(shape["sha256"] for shape in before if shape["name"] == "2.off")
        session.execute(update(BlobRow).where(BlobRow.sha256 == damaged).values(data=b"no longer a mesh"))
    database.close()
    with serving(settings) as running:

        def boxes() -> dict[str, list[float] | None]:
            shapes = running.client.get("/shapes").json()["shapes"]
            return {shape["name"]: shape["facts"]["bounding_box"] for shape in shapes}

        wanted = {shape["name"]: shape["facts"]["bounding_box"] for shape in before}
        wait_until(lambda: sum(box is not None for box in boxes().values()) == 3, seconds=120)
        assert boxes() == {**wanted, "2.off": None}
        known = running.client.get("/shapes", params={"length": "0.."}).json()
        assert {shape["name"] for shape in known["shapes"]} == set(wanted) - {"2.off"}
    if engine == "sqlite":
        faults = check(tmp_path / "archive.sqlite3", lock_seconds=10).faults
        measured = [shape["id"] for shape in before if shape["name"] != "2.off"]
        assert faults
        assert not [fault for fault in faults for shape_id in measured if shape_id in fault]
