"""`isoshape check`: an archive that is whole, and every way in which one is not."""

import json
import shutil
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import zstandard
from safetensors.numpy import load, save
from typer.testing import CliRunner, Result

from core.parameters import DEFAULT
from service.cli.commands import command_line
from service.errors import ArchiveError, ArchiveTooNewError
from service.storage.checking import CheckReport, check
from tests.service.archives import change, contents, embedded, make_archive, opened
from tests.service.support import small_file


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return make_archive(tmp_path_factory.mktemp("whole") / "archive.sqlite3", 0, 1, 2)


@pytest.fixture
def archive(whole: Path, tmp_path: Path) -> Path:
    """A copy to spoil."""
    return Path(shutil.copy(whole, tmp_path / "archive.sqlite3"))


def faults(path: Path) -> list[str]:
    return check(path, lock_seconds=1).faults


def test_a_whole_archive_has_no_faults_and_is_counted(whole: Path) -> None:
    assert check(whole, lock_seconds=1) == CheckReport(
        shapes=3,
        blobs=3,
        embeddings=3,
        bytes=sum(len(small_file(number)) for number in range(3)),
        pipelines={DEFAULT.fingerprint: 3},
        faults=[],
    )


Spoil = Callable[[dict[str, np.ndarray]], object]
"""Changes the arrays of a record, which are stored by columns."""


def spoilt(change: Spoil) -> bytes:
    """The second shape's record, changed."""
    record = zstandard.decompress(embedded(1).record)
    arrays = {name: array.copy() for name, array in load(record).items()}
    change(arrays)
    return zstandard.compress(save(arrays))


def set_nan(arrays: dict[str, np.ndarray]) -> None:
    """The unit of the first column."""
    arrays["points"].view(np.float32)[3] = np.nan


def set_double(arrays: dict[str, np.ndarray]) -> None:
    arrays["positions"] = arrays["positions"].astype(np.float64)


def set_short(arrays: dict[str, np.ndarray]) -> None:
    arrays["points"].view(np.int32)[0] -= 1


def set_dimensions(arrays: dict[str, np.ndarray]) -> None:
    header = json.loads(arrays["header"].tobytes())
    (_, first), (_, second) = header["spectra"]
    header["spectra"] = [["affinity", first - 1], ["laplace-beltrami", second + 1]]
    arrays["header"] = np.frombuffer(json.dumps(header).encode(), np.uint8)


def set_fingerprint(arrays: dict[str, np.ndarray]) -> None:
    text = arrays["header"].tobytes().replace(DEFAULT.fingerprint.encode(), b"0" * 16)
    arrays["header"] = np.frombuffer(text, np.uint8)


def flip_the_last_bit(arrays: dict[str, np.ndarray]) -> None:
    """Change a coordinate to a number as good as any."""
    arrays["points"][-8] ^= 1


@pytest.mark.parametrize(
    ("spoil", "fault"),
    [
        (flip_the_last_bit, "embedding 2 does not have its checksum"),
        (set_nan, "embedding 2 cannot be read: not an embedding: coordinates has a number that"),
        (set_double, "embedding 2 cannot be read: not an embedding: positions is of type float64"),
        (set_short, "embedding 2 cannot be read: not an embedding"),
        (set_dimensions, f"embedding 2 has other dimensions than the first of {DEFAULT.fingerprint}"),
        (set_fingerprint, "embedding 2 is of 0000000000000000, and stored as one of"),
    ],
)
def test_a_spoilt_embedding_is_named(archive: Path, spoil: Spoil, fault: str) -> None:
    change(archive, "UPDATE embeddings SET record = ? WHERE number = 2", spoilt(spoil))
    (found,) = faults(archive)
    assert found.startswith(fault)


@pytest.mark.parametrize(
    ("statement", "expected"),
    [
        ("UPDATE embeddings SET record = x'00' WHERE number = 3", ["embedding 3 cannot be read"]),
        ("UPDATE embeddings SET record = 'text' WHERE number = 3", ["embedding 3 cannot be read"]),
        (
            "UPDATE embeddings SET signature = 'text' WHERE number = 3",
            ["embeddings row 3 has a value", "embedding 3 has another signature"],
        ),
        (
            "UPDATE embeddings SET signature = x'00000000' WHERE number = 1",
            ["embedding 1 has a signature", "embedding 1 has another signature"],
        ),
        (
            "UPDATE coarse_samples SET signature = x'00000000' WHERE embedding_number = 2",
            ["embedding 2 has another signature beside its coarse samples"],
        ),
        (
            "UPDATE coarse_samples SET view_signature = x'00' WHERE embedding_number = 2",
            ["embedding 2 has views beside its coarse samples"],
        ),
        (
            "UPDATE coarse_samples SET reliability = 0.25 WHERE embedding_number = 1",
            ["embedding 1 has views beside its coarse samples"],
        ),
        ("DELETE FROM pieces WHERE embedding_number = 2", ["embedding 2 has pieces beside it"]),
        ("UPDATE pieces SET size = 1 WHERE embedding_number = 1", ["embedding 1 has pieces beside it"]),
        ("DELETE FROM coarse_samples WHERE embedding_number = 2", ["embedding 2 has no coarse samples"]),
        ("UPDATE blobs SET data = x'00' WHERE number = 1", ["blob 1 has 1 bytes", "blob 1 does not have"]),
        (
            "UPDATE blobs SET data = 'text' WHERE number = 1",
            ["blob 1 has 4 bytes", "blobs row 1 has a value"],
        ),
        ("UPDATE blobs SET size = 5 WHERE number = 2", ["blob 2 has"]),
        (
            "DELETE FROM blobs WHERE number = 2",
            ["shapes row 2 refers to a row of blobs", "embeddings row 2 refers to a row of blobs"],
        ),
        (
            "INSERT INTO blobs SELECT 9, '00', size, data FROM blobs WHERE number = 1",
            ["blob 9 has no shape", "blob 9 does not have the SHA-256"],
        ),
        (
            "UPDATE shape_tags SET shape_number = 77 WHERE shape_number = 3",
            ["shape_tags row 3 refers", "shape "],
        ),
        (
            "UPDATE shape_metadata SET shape_number = 77 WHERE shape_number = 3",
            ["shape_metadata row 3", "shape "],
        ),
        ("UPDATE embeddings SET format = 'ply' WHERE number = 3", ["shape ", "embedding 3 has no shape"]),
        ("INSERT INTO removals VALUES (2, 3)", ["shape "]),
        ("INSERT INTO removals VALUES (99, 99)", ["the removal of shape number 99"]),
        ("UPDATE shapes SET revision = 1000 WHERE number = 1", ["shape "]),
        ("DELETE FROM archive", ["the archive has 0 rows about itself"]),
        ("INSERT INTO archive (number, revision) VALUES (2, 0)", ["the archive has 2 rows about itself"]),
        ("UPDATE shapes SET name = 'another' WHERE number = 2", ["shape "]),
        ("UPDATE shapes SET meta = '{}' WHERE number = 2", ["shape "]),
        ("UPDATE shapes SET facts = '{}' WHERE number = 2", ["shape "]),
        ("UPDATE shapes SET facts = '{' WHERE number = 2", ["shapes row 2 has a value of the wrong kind"]),
        ("UPDATE shapes SET created_at = '2020-01-01 00:00:00.000000' WHERE number = 2", ["shape "]),
        ("UPDATE shape_tags SET tag = 'another' WHERE shape_number = 2", ["shape "]),
        ("DELETE FROM shape_metadata WHERE shape_number = 2", ["shape "]),
        ("UPDATE shape_words SET weight = 4 WHERE shape_number = 2 AND weight = 6", ["shape "]),
        ("UPDATE words SET backward = 'x' WHERE word = 'tag'", ["shape "] * 3),
        ("INSERT INTO words VALUES (99, 'lost', 'tsol')", ["word 99 is of no shape"]),
        (
            "UPDATE coarse_samples SET data = x'00' WHERE embedding_number = 2",
            ["coarse_samples row 2 does not have"],
        ),
        (
            "INSERT INTO thumbnails VALUES (1, 'off', 96, 1, x'89', 'wrong')",
            ["thumbnails row 1 does not have its checksum"],
        ),
        (
            "INSERT INTO neighbours VALUES (1, 'f', x'00', 'wrong')",
            ["neighbours row 1 does not have its checksum"],
        ),
    ],
)
def test_a_spoilt_row_is_named(archive: Path, statement: str, expected: list[str]) -> None:
    change(archive, statement)
    found = faults(archive)
    assert len(found) == len(expected), found
    for beginning in expected:
        assert any(fault.startswith(beginning) for fault in found), found


def found_out(path: Path) -> bool:
    """Whether there are faults, or so many that it is no archive any more."""
    try:
        return bool(faults(path))
    except ArchiveError:
        return True


def test_no_page_can_be_lost_unnoticed(whole: Path, archive: Path) -> None:
    """Nor ends the check in an error of its own. Free pages hold nothing, and there are none after VACUUM."""
    change(archive, "VACUUM")
    good = archive.read_bytes()
    with opened(archive) as connection:
        (size,) = connection.execute("PRAGMA page_size").fetchone()
    noise = np.random.default_rng(0).bytes(size)
    for start in range(0, len(good), size):
        archive.write_bytes(good[:start] + noise + good[start + size :])
        assert found_out(archive), f"page {start // size}"
    archive.write_bytes(good)
    assert faults(archive) == []


def test_a_file_cut_short_is_found(archive: Path) -> None:
    good = archive.read_bytes()
    for share in (0.3, 0.6, 0.9):
        archive.write_bytes(good[: int(len(good) * share)])
        assert found_out(archive)


def test_a_file_that_is_no_archive_is_refused_and_left_alone(tmp_path: Path, archive: Path) -> None:
    missing, other, empty = tmp_path / "missing", tmp_path / "text", tmp_path / "empty"
    other.write_text("no database " * 1000)
    empty.touch()
    for path in (missing, other, empty, tmp_path):
        with pytest.raises(ArchiveError):
            check(path, lock_seconds=1)
    assert not missing.exists()
    assert empty.stat().st_size == 0
    change(archive, "UPDATE alembic_version SET version_num = '9999'")
    with pytest.raises(ArchiveTooNewError, match="9999"):
        check(archive, lock_seconds=1)


def run(*arguments: object) -> Result:
    return CliRunner().invoke(command_line(), ["check", *map(str, arguments)])


def test_the_command_prints_counts_and_faults_and_its_status_tells(
    archive: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("ISOSHAPE_DATABASE_URL", f"sqlite:///{archive}")
    done = run()
    assert done.exit_code == 0, done.output
    assert f"pipeline {DEFAULT.fingerprint}: 3 embeddings" in done.stdout
    assert done.stdout.startswith("3 shapes on 3 files of ")
    change(archive, "UPDATE blobs SET size = 5 WHERE number = 2")
    done = run(archive)
    assert done.exit_code == 1
    assert "blob 2 has " in done.stdout
    done = run("--json")
    assert done.exit_code == 1
    told = json.loads(done.stdout)
    assert (told["archive"], told["shapes"], told["blobs"]) == (str(archive), 3, 3)
    assert [fault.split(" has ")[0] for fault in told["faults"]] == ["blob 2"]
    done = run(archive.with_name("missing"))
    assert done.exit_code == 1
    assert "there is no archive at" in done.stderr


def test_a_collection_that_is_not_there_is_named(archive: Path) -> None:
    change(archive, "UPDATE shapes SET collection_number = 9 WHERE number = 2")
    assert faults(archive)[0] == "shapes row 2 refers to a row of collections that is not there"
    change(archive, "UPDATE shapes SET collection_number = 1")
    change(archive, "UPDATE collections SET name = 'another'")
    assert faults(archive) == ["the first collection is not default, but another"]
    change(archive, "DELETE FROM collections")
    assert "the first collection is not default, but not there" in faults(archive)


@pytest.mark.parametrize("table", ["blobs", "shapes"])
def test_a_schema_that_is_no_utf_8_is_a_fault(archive: Path, table: str) -> None:
    sound = archive.read_bytes()
    start = sound.index(b"CREATE TABLE %s" % table.encode())
    for place in range(start, start + 24, 3):
        archive.write_bytes(sound[:place] + b"\xf7" + sound[place + 1 :])
        assert found_out(archive), place


FLIPS = 40


def test_every_flipped_bit_is_found_or_lies_in_free_space(archive: Path, tmp_path: Path) -> None:
    """A flip in free space: everything that is stored reads the same."""
    sound = archive.read_bytes()
    before = contents(archive)
    rng = np.random.default_rng(7)
    unnoticed = 0
    for bit in rng.integers(8 * len(sound), size=FLIPS).tolist():
        damaged = bytearray(sound)
        damaged[bit // 8] ^= 1 << bit % 8
        path = tmp_path / "flipped.sqlite3"
        path.write_bytes(damaged)
        if not found_out(path):
            unnoticed += 1
            assert contents(path) == before, f"bit {bit}"
    assert unnoticed < FLIPS
