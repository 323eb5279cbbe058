"""Zip archives: members are read whole, and hostile ones are named, member by member."""

import io
import json
import struct
import tracemalloc
import zipfile
import zlib
from collections.abc import Iterator
from contextlib import contextmanager

import numpy as np
import pytest

from service.compute.sandbox import zip_directory
from service.errors import TaskTimeLimitError, WorkerCrashedError
from service.jobs.zip_archive import (
    PIECE,
    ArchiveTooLargeError,
    MalformedArchiveError,
    MemberError,
    UnknownArchiveError,
    ZipArchive,
    check_zip,
)
from service.settings import Settings
from tests.service.jobs.support import pack, zip_link, zipped

MIB = 1024 * 1024
LIMITS = Settings(
    max_archive_files=100, max_upload_bytes=4 * MIB, max_unpacked_bytes=32 * MIB, max_unpacked_ratio=50.0
)
NOISE = np.random.default_rng(0).bytes(200_000)


def faults(data: bytes, limits: Settings = LIMITS) -> dict[str, str | None]:
    """Return each member's path and the kind of its fault, by its header or by its bytes."""
    archive = ZipArchive(io.BytesIO(data), limits, zip_directory)
    members = archive.members()
    kinds = {member.path: member.fault and member.fault.kind for member in members}
    sound = {position: member.path for position, member in enumerate(members) if member.fault is None}
    for position, content in archive.read(sound):
        kinds[sound.pop(position)] = None if isinstance(content, bytes) else content.kind
    assert not sound
    return kinds


def contents(data: bytes) -> dict[str, bytes]:
    """Return the bytes of each member that is read."""
    check_zip(io.BytesIO(data))
    return contents_of(data)


def contents_of(data: bytes) -> dict[str, bytes]:
    archive = ZipArchive(io.BytesIO(data), LIMITS, zip_directory)
    paths = {position: member.path for position, member in enumerate(archive.members())}
    members = archive.read(paths)
    return {paths[position]: content for position, content in members if isinstance(content, bytes)}


def patched(archive: bytes, old: bytes, new: bytes) -> bytes:
    """Return the archive with some bytes, wherever they are, replaced by as many others."""
    assert len(old) == len(new)
    assert old in archive
    return archive.replace(old, new)


@contextmanager
def little_memory(most: int) -> Iterator[None]:
    """Fail if the block holds more memory at any time."""
    tracemalloc.start()
    try:
        yield
        assert tracemalloc.get_traced_memory()[1] < most
    finally:
        tracemalloc.stop()


def test_members_come_back_bit_for_bit_and_in_order() -> None:
    files = {f"class {i % 3}/mesh {i}.off": NOISE[i * 7_001 : i * 14_007] for i in range(5)}
    data = pack(files)
    assert list(contents(data).items()) == list(files.items())
    assert set(faults(data).values()) == {None}
    wanted = dict(ZipArchive(io.BytesIO(data), LIMITS, zip_directory).read({1, 4}))
    assert list(wanted.items()) == [(i, files[f"class {i % 3}/mesh {i}.off"]) for i in (1, 4)]


def test_names_that_lead_elsewhere_or_are_no_meshes() -> None:
    names = {
        "/etc/cron.d/x.off": "member-name",
        "../x.off": "member-name",
        "a/../../x.off": "member-name",
        "..\\x.off": "member-name",
        "C:\\x.off": "member-name",
        "a/\x01.off": "member-name",
        "a" * 300 + ".off": "member-name",
        "good.off": None,
        "inside.zip": "nested-archive",
        "inside.tar.gz": "nested-archive",
        "notes.txt": "unknown-format",
        "none": "unknown-format",
        "__MACOSX/._good.off": "unknown-format",
        ".trash/bad.off": "unknown-format",
    }
    kinds = faults(pack([(name, b"x") for name in names]))
    assert kinds == {name.replace("\x01", "\ufffd"): kind for name, kind in names.items()}


@pytest.mark.filterwarnings("ignore:Duplicate name")
def test_the_first_of_one_name_is_taken() -> None:
    data = pack([("a.off", b"1"), ("./a.off", b"2"), ("b/a.off", b"3"), ("a.off", b"4")])
    archive = ZipArchive(io.BytesIO(data), LIMITS, zip_directory)
    kinds = [member.fault and member.fault.kind for member in archive.members()]
    assert kinds == [None, "member-repeated", None, "member-repeated"]
    assert dict(archive.read({0, 2})) == {0: b"1", 2: b"3"}


def test_members_that_are_no_plain_files() -> None:
    device = zipfile.ZipInfo("device.off")
    device.create_system, device.external_attr = 3, 0o020666 << 16
    lzma_packed, bzip2_packed = zipfile.ZipInfo("lzma.off"), zipfile.ZipInfo("bzip2.off")
    lzma_packed.compress_type, bzip2_packed.compress_type = zipfile.ZIP_LZMA, zipfile.ZIP_BZIP2
    members = [(zip_link("link.off"), b"/etc/passwd"), (device, b""), (zipfile.ZipInfo("folder/"), b"")]
    members += [(lzma_packed, NOISE), (bzip2_packed, NOISE), (zipfile.ZipInfo("folder/a.off"), b"x")]
    refused = dict.fromkeys(("link.off", "device.off", "lzma.off", "bzip2.off"), "member-kind")
    assert faults(zipped(members)) == {**refused, "folder/a.off": None}
    locked = bytearray(pack({"a.off": b"secret"}))
    locked[locked.index(b"PK\1\2") + 8] |= 1
    assert faults(bytes(locked)) == {"a.off": "member-encrypted"}


def test_a_member_that_is_larger_than_is_taken_or_than_it_says() -> None:
    data = pack({"large.off": NOISE * 21, "a.off": b"x"})
    assert faults(data) == {"large.off": "member-too-large", "a.off": None}
    data, size = pack({"a.off": NOISE, "b.off": b"x"}), struct.pack("<I", len(NOISE))
    for other in (10, 300_000):
        changed = patched(data, size, struct.pack("<I", other))
        assert faults(changed) == {"a.off": "member-damaged", "b.off": None}


def test_a_bomb_is_stopped_while_it_unpacks() -> None:
    data = pack({"bomb.off": bytes(4 * MIB), "a.off": b"x"})
    with little_memory(3 * MIB):
        assert faults(data) == {"bomb.off": "member-too-large", "a.off": None}


def test_an_archive_of_too_much() -> None:
    few = LIMITS.model_copy(update={"max_archive_files": 3, "max_unpacked_bytes": 400_000})
    with pytest.raises(ArchiveTooLargeError, match="members"):
        faults(pack({f"{i}.off": b"" for i in range(4)}), few)
    assert len(faults(pack({f"{i}.off": b"" for i in range(3)}), few)) == 3
    with pytest.raises(ArchiveTooLargeError, match="bytes"):
        faults(pack({f"{i}.off": NOISE for i in range(3)}), few)
    many = pack({f"{i:0200}": b"" for i in range(6000)})
    with little_memory(8 * MIB), pytest.raises(ArchiveTooLargeError, match="directory"):
        faults(many)


def test_a_spoilt_member_is_the_only_one_and_a_cut_zip_has_no_directory() -> None:
    data = bytearray(pack({"a.off": NOISE, "b.off": b"b"}))
    data[1000] ^= 0xFF
    assert faults(bytes(data)) == {"a.off": "member-damaged", "b.off": None}
    with pytest.raises(MalformedArchiveError):
        faults(bytes(data[:-30]))


@pytest.mark.parametrize("data", [b"", b"PK", b"OFF\n0 0 0\n", bytes(10240), b"\x1f\x8b" + NOISE])
def test_bytes_that_are_no_zip(data: bytes) -> None:
    with pytest.raises(UnknownArchiveError):
        check_zip(io.BytesIO(data))


def test_archives_with_bytes_changed_are_read_or_refused() -> None:
    draw = np.random.default_rng(1)
    files = {f"{i}.off": NOISE[i * 900 :][:900] for i in range(4)}
    honest = pack(files)
    for _ in range(150):
        data = bytearray(honest)
        for position in draw.integers(0, len(data), 3):
            data[position] = draw.integers(256)
        try:
            members = contents(bytes(data))
        except (ArchiveTooLargeError, MalformedArchiveError, UnknownArchiveError):
            continue
        assert len(members) <= len(files)


@pytest.mark.parametrize(
    "answer",
    [
        b"",
        b"null",
        b"[1, [[]]]",
        b'[1, [["a.off", 0, 0, 0, -1, 0, 0, 0]]]',
        b'[1, [["a.off", 0, 0, 0, 1e99, 0, 0, 0]]]',
    ],
)
def test_the_reader_of_the_directory_is_not_trusted(answer: bytes) -> None:
    with pytest.raises(MalformedArchiveError):
        ZipArchive(io.BytesIO(pack({"a.off": b"x"})), LIMITS, lambda *_: answer)


@pytest.mark.parametrize("error", [ValueError, MemoryError, TaskTimeLimitError, WorkerCrashedError])
def test_a_directory_that_its_reader_cannot_read(error: type[Exception]) -> None:
    def read_directory(*_: object) -> bytes:
        raise error("why")

    with pytest.raises(MalformedArchiveError, match="why"):
        ZipArchive(io.BytesIO(pack({"a.off": b"x"})), LIMITS, read_directory)


def test_a_directory_that_points_elsewhere() -> None:
    elsewhere = b'[1, [["a.off", 0, 0, 0, 9223372036854775807, 1, 1, 0]]]'
    archive = ZipArchive(io.BytesIO(pack({"a.off": b"x"})), LIMITS, lambda *_: elsewhere)
    ((_, content),) = archive.read({0})
    assert isinstance(content, MemberError)
    assert content.kind == "member-damaged"


def test_each_gltf_has_the_buffers_that_it_names() -> None:
    """In one folder there may be thousands of pairs."""
    gltf = {f"{i}.gltf": b'{"buffers": [{"uri": "%d%%20b.bin"}]}' % i for i in range(3)}
    buffers = {f"{i} b.bin": NOISE[:100] for i in range(3)}
    few = LIMITS.model_copy(update={"max_unpacked_bytes": 1_000})
    archive = ZipArchive(io.BytesIO(pack({**gltf, **buffers})), few, zip_directory)
    assert [member.name for member in archive.members()] == list(gltf)
    for position, content in archive.read({0, 1, 2}):
        assert isinstance(content, bytes)
        with zipfile.ZipFile(io.BytesIO(content)) as bundle:
            assert bundle.namelist() == [f"{position}.gltf", f"{position} b.bin"]
    # What is unpacked counts, also buffers.
    little = LIMITS.model_copy(update={"max_unpacked_bytes": 250})
    archive = ZipArchive(io.BytesIO(pack({**gltf, **buffers})), little, zip_directory)
    contents = [content for _, content in archive.read({0, 1, 2})]
    assert [type(content) for content in contents] == [bytes, MemberError, MemberError]


def test_packed_bytes_after_the_end_of_a_member_are_not_read() -> None:
    """The library would collect them, and copy all of them for each further piece."""
    info = zipfile.ZipInfo("a.off")
    packed = zlib.compress(b"OFF", wbits=-15) + bytes(10 * PIECE)
    entry = [info.filename, 0, zipfile.ZIP_DEFLATED, 0, 0, len(packed), 3, zlib.crc32(b"OFF")]
    file = io.BytesIO(b"PK\3\4" + bytes(26) + packed)
    archive = ZipArchive(file, LIMITS, lambda *_: json.dumps([1, [entry]]).encode())
    ((_, content),) = archive.read({0})
    assert isinstance(content, MemberError)
    assert content.kind == "member-damaged"
    assert file.tell() <= 30 + PIECE


def test_members_that_overlap_are_refused() -> None:
    """Each would unpack the same bytes (CVE-2024-0450)."""
    data = pack({"a.off": NOISE})
    count, ((_, *rest),) = json.loads(zip_directory(data, len(data), 9))
    twice = json.dumps([2 * count, [["a.off", *rest], ["b.off", *rest]]]).encode()
    with pytest.raises(MalformedArchiveError, match="overlap"):
        ZipArchive(io.BytesIO(data), LIMITS, lambda *_: twice)


def test_bytes_before_and_after_the_zip() -> None:
    data = b"#!/bin/sh\n" * 20 + pack({"a.off": NOISE, "b.off": b"b"})
    assert contents_of(data) == {"a.off": NOISE, "b.off": b"b"}
