"""Archives: what is in them is read whole, and what strangers put into them is named, member by member."""

import bz2
import gzip
import io
import lzma
import struct
import tarfile
import tracemalloc
import zipfile
from collections.abc import Iterator
from contextlib import contextmanager

import numpy as np
import pytest

from service.jobs.archives import archive_format, list_members, read_members
from service.jobs.errors import ArchiveTooLargeError, UnknownArchiveError
from service.jobs.members import ArchiveLimits
from tests.service.jobs.packing import FORMATS, pack, patched, tar_of_type, tarred, zip_link, zipped

MIB = 1024 * 1024
LIMITS = ArchiveLimits(members=100, member_bytes=4 * MIB, total_bytes=32 * MIB, ratio=50.0)
NOISE = np.random.default_rng(0).bytes(200_000)


def faults(data: bytes, limits: ArchiveLimits = LIMITS) -> dict[str, str | None]:
    """Each member's path and the kind of its fault, by listing, and reading what has none by then."""
    file = io.BytesIO(data)
    format = archive_format(file, limits)
    listing = list_members(file, format, limits)
    found = {member.path: member.fault and member.fault.kind for member in listing.members}
    paths = {member.place: member.path for member in listing.members}
    wanted = {member.place for member in listing.members if member.fault is None}
    read = dict(read_members(file, format, limits, wanted))
    for place in wanted:
        got = read.get(place)
        if not isinstance(got, bytes):
            found[paths[place]] = "left out" if got is None else got.kind
    return found


def contents(data: bytes, limits: ArchiveLimits = LIMITS) -> dict[str, bytes]:
    """The bytes of each member that is read."""
    file = io.BytesIO(data)
    format = archive_format(file, limits)
    paths = {member.place: member.path for member in list_members(file, format, limits).members}
    return {
        paths[place]: got
        for place, got in read_members(file, format, limits, set(paths))
        if isinstance(got, bytes)
    }


def problem(data: bytes, limits: ArchiveLimits = LIMITS) -> str | None:
    file = io.BytesIO(data)
    ended = list_members(file, archive_format(file, limits), limits).problem
    return None if ended is None else ended.kind


@contextmanager
def little_memory(most: int) -> Iterator[None]:
    """Fail where the block holds more at any time."""
    tracemalloc.start()
    try:
        yield
        assert tracemalloc.get_traced_memory()[1] < most
    finally:
        tracemalloc.stop()


@pytest.mark.parametrize("format", FORMATS)
def test_members_come_back_bit_for_bit_and_in_order(format: str) -> None:
    files = {f"class {i % 3}/mesh {i}.off": NOISE[i * 7_001 : i * 14_007] for i in range(12)}
    data = pack(files, format)
    assert archive_format(io.BytesIO(data), LIMITS) == format
    assert list(contents(data).items()) == list(files.items())
    assert set(faults(data).values()) == {None}
    assert problem(data) is None


@pytest.mark.parametrize("format", FORMATS)
def test_only_what_is_wanted_is_read(format: str) -> None:
    file = io.BytesIO(pack({f"{i}.off": bytes([i]) * i for i in range(9)}, format))
    assert dict(read_members(file, format, LIMITS, {2, 7})) == {2: b"\2" * 2, 7: b"\7" * 7}


@pytest.mark.parametrize("format", FORMATS)
def test_names_that_lead_elsewhere_or_are_there_twice(format: str) -> None:
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
    }
    found = faults(pack([(name, b"x") for name in names], format))
    assert found == {name.replace("\x01", "\ufffd"): kind for name, kind in names.items()}


@pytest.mark.filterwarnings("ignore:Duplicate name")
@pytest.mark.parametrize("format", FORMATS)
def test_the_first_of_one_name_is_taken(format: str) -> None:
    file = io.BytesIO(pack([("a.off", b"1"), ("./a.off", b"2"), ("b/a.off", b"3"), ("a.off", b"4")], format))
    members = list_members(file, format, LIMITS).members
    kinds = [member.fault and member.fault.kind for member in members]
    assert kinds == [None, "member-repeated", None, "member-repeated"]
    assert dict(read_members(file, format, LIMITS, {0, 2})) == {0: b"1", 2: b"3"}


def test_folders_are_no_files() -> None:
    folder = zipfile.ZipInfo("folder/")
    assert faults(zipped([(folder, b""), (zipfile.ZipInfo("folder/a.off"), b"x")])) == {"folder/a.off": None}
    members = [(tar_of_type("folder", tarfile.DIRTYPE), b""), (tarfile.TarInfo("folder/a.off"), b"x")]
    assert faults(tarred(members)) == {"folder/a.off": None}


def test_links_and_devices_in_a_zip() -> None:
    device = zipfile.ZipInfo("device.off")
    device.create_system, device.external_attr = 3, 0o020666 << 16
    data = zipped([(zip_link("link.off"), b"/etc/passwd"), (device, b""), (zipfile.ZipInfo("a.off"), b"x")])
    assert faults(data) == {"link.off": "member-kind", "device.off": "member-kind", "a.off": None}


def test_links_devices_and_holes_in_a_tar() -> None:
    kinds = (tarfile.SYMTYPE, tarfile.LNKTYPE, tarfile.CHRTYPE, tarfile.BLKTYPE, tarfile.FIFOTYPE)
    members = [(tar_of_type(f"{kind!r}.off", kind, "/etc/passwd"), b"") for kind in kinds]
    sparse = tarfile.TarInfo("sparse.off")
    sparse.pax_headers = {"GNU.sparse.size": str(2**60), "GNU.sparse.map": f"{2**59},1"}
    members += [(sparse, b"x"), (tarfile.TarInfo("a.off"), b"x")]
    found = faults(tarred(members))
    assert found.pop("a.off") is None
    assert set(found.values()) == {"member-kind"}
    assert len(found) == len(kinds) + 1


def test_zip_members_that_are_encrypted_or_packed_by_other_methods() -> None:
    lzma_packed, bzip2_packed = zipfile.ZipInfo("lzma.off"), zipfile.ZipInfo("bzip2.off")
    lzma_packed.compress_type, bzip2_packed.compress_type = zipfile.ZIP_LZMA, zipfile.ZIP_BZIP2
    data = zipped([(lzma_packed, NOISE), (bzip2_packed, NOISE), (zipfile.ZipInfo("a.off"), NOISE)])
    assert faults(data) == {"lzma.off": "member-kind", "bzip2.off": "member-kind", "a.off": None}
    locked = bytearray(pack({"a.off": b"secret"}))
    directory = locked.index(b"PK\1\2")
    locked[directory + 8] |= 1
    assert faults(bytes(locked)) == {"a.off": "member-encrypted"}


@pytest.mark.parametrize("format", FORMATS)
def test_a_member_that_says_it_is_too_large(format: str) -> None:
    large = NOISE * 21
    assert len(large) > LIMITS.member_bytes
    data = pack({"large.off": large, "a.off": b"x"}, format)
    assert faults(data) == {"large.off": "member-too-large", "a.off": None}


def test_a_member_that_is_larger_than_it_says() -> None:
    data = pack({"a.off": NOISE, "b.off": b"x"})
    size = struct.pack("<I", len(NOISE))
    assert faults(patched(data, size, struct.pack("<I", 10))) == {"a.off": "member-damaged", "b.off": None}
    assert faults(patched(data, size, struct.pack("<I", 300_000))) == {
        "a.off": "member-damaged",
        "b.off": None,
    }


def test_a_bomb_in_a_zip_is_stopped_while_it_unpacks() -> None:
    data = pack({"bomb.off": bytes(4 * MIB), "a.off": b"x"})
    with little_memory(3 * MIB):
        assert faults(data) == {"bomb.off": "member-too-large", "a.off": None}


@pytest.mark.parametrize("pack_stream", [gzip.compress, bz2.compress, lzma.compress])
def test_a_bomb_around_a_tar_is_stopped_while_it_unpacks(pack_stream: object) -> None:
    data = pack_stream(tarred([(tarfile.TarInfo("bomb.off"), bytes(24 * MIB))]))  # type: ignore[operator]
    # The dictionary of an xz stream takes 8 MiB.
    with little_memory(10 * MIB), pytest.raises(ArchiveTooLargeError, match="50 times"):
        problem(data)


def test_a_bomb_in_the_headers_of_a_tar() -> None:
    long_name = tarfile.TarInfo("x")
    long_name.type, long_name.size = tarfile.GNUTYPE_LONGNAME, 24 * MIB
    data = tarred([(tarfile.TarInfo("a.off"), b"x")])[:1024] + long_name.tobuf() + NOISE * 120
    with little_memory(3 * MIB):
        assert problem(data) == "malformed-archive"
        assert faults(data) == {"a.off": None}


def test_headers_that_lead_back_or_never_end() -> None:
    back = bytearray(tarfile.TarInfo("a.off").tobuf())
    back[124:136] = b"\xff" * 8 + struct.pack(">i", -512)
    back[148:156] = b" " * 8
    back[148:156] = b"%06o\0 " % sum(back)
    assert problem(bytes(back) + bytes(1024)) == "malformed-archive"
    name = tarfile.TarInfo("x")
    name.type, name.size = tarfile.GNUTYPE_LONGNAME, 1
    chain = (name.tobuf() + b"y" + bytes(511)) * 2000
    assert problem(tarred([(tarfile.TarInfo("a.off"), b"x")])[:1024] + chain) == "malformed-archive"


@pytest.mark.parametrize("format", FORMATS)
def test_an_archive_of_too_much(format: str) -> None:
    few = ArchiveLimits(members=3, member_bytes=MIB, total_bytes=400_000, ratio=50.0)
    with pytest.raises(ArchiveTooLargeError, match="members"):
        problem(pack({f"{i}.off": b"" for i in range(4)}, format), few)
    assert problem(pack({f"{i}.off": b"" for i in range(3)}, format), few) is None
    with pytest.raises(ArchiveTooLargeError, match="bytes"):
        problem(pack({f"{i}.off": NOISE for i in range(3)}, format), few)


def test_a_directory_that_is_far_too_long() -> None:
    many = pack({f"{i:0200}": b"" for i in range(6000)})
    with little_memory(8 * MIB), pytest.raises(ArchiveTooLargeError, match="directory"):
        problem(many)


@pytest.mark.parametrize("format", ["tar", "tar.gz", "tar.bz2", "tar.xz"])
def test_a_tar_that_ends_in_the_middle_gives_what_came_before(format: str) -> None:
    # A block of bzip2 is 900 kB, and read whole or not at all.
    noise = np.random.default_rng(2).bytes(6 * MIB)
    data = pack({f"{i}.off": noise[2 * i * MIB :][: 2 * MIB] for i in range(3)}, format)
    half = data[: len(data) // 2]
    assert problem(half) == "malformed-archive"
    found = faults(half)
    assert found["0.off"] is None
    assert "2.off" not in found


def test_a_tar_that_ends_in_its_last_member() -> None:
    data = tarred([(tarfile.TarInfo("a.off"), b"a" * 600), (tarfile.TarInfo("b.off"), b"b" * 600)])
    cut = data[: 512 + 1024 + 512 + 300]
    assert problem(cut) == "malformed-archive"
    assert faults(cut) == {"a.off": None, "b.off": "member-damaged"}
    assert contents(cut) == {"a.off": b"a" * 600}


def test_a_spoilt_header_in_the_middle_of_a_tar_is_no_end() -> None:
    data = bytearray(pack({"a.off": b"a", "b.off": b"b"}, "tar"))
    data[1024 + 150] ^= 0xFF
    assert problem(bytes(data)) == "malformed-archive"
    assert faults(bytes(data)) == {"a.off": None}


def test_a_spoilt_member_of_a_zip_is_the_only_one() -> None:
    data = bytearray(pack({"a.off": NOISE, "b.off": b"b"}))
    data[1000] ^= 0xFF
    assert faults(bytes(data)) == {"a.off": "member-damaged", "b.off": None}


def test_a_zip_that_is_cut_has_no_directory() -> None:
    data = pack({"a.off": NOISE})
    assert problem(data[:-30]) == "malformed-archive"
    assert faults(data[:-30]) == {}


def test_streams_that_follow_one_another_are_one() -> None:
    data = tarred([(tarfile.TarInfo(f"{i}.off"), NOISE) for i in range(3)])
    halves = data[:250_000], data[250_000:]
    for compress in (gzip.compress, bz2.compress, lzma.compress):
        packed = b"".join(map(compress, halves)) + bytes(512)
        assert contents(packed) == {f"{i}.off": NOISE for i in range(3)}


def test_an_xz_stream_that_asks_for_too_much_memory() -> None:
    filters = [{"id": lzma.FILTER_LZMA2, "dict_size": 1024 * MIB, "mode": lzma.MODE_FAST, "mf": lzma.MF_HC3}]
    # The size of the dictionary stands in the block's header, behind its filter's number and length.
    honest = lzma.compress(pack({"a.off": b"x"}, "tar"), filters=[{**filters[0], "dict_size": MIB}])
    block = bytearray(honest[12:24])
    assert block[2:4] == b"\x21\x01"
    block[4] = 36
    block[8:12] = struct.pack("<I", __import__("zlib").crc32(block[:8]))
    with pytest.raises(UnknownArchiveError):
        archive_format(io.BytesIO(honest[:12] + bytes(block) + honest[24:]), LIMITS)


@pytest.mark.parametrize(
    "data",
    [b"", b"OFF\n0 0 0\n", bytes(10240), NOISE, gzip.compress(NOISE), b"\x1f\x8b" + NOISE, b"BZh9" + NOISE],
)
def test_bytes_that_are_no_archive(data: bytes) -> None:
    with pytest.raises(UnknownArchiveError):
        archive_format(io.BytesIO(data), LIMITS)


def test_archives_with_bytes_changed_are_read_or_refused() -> None:
    draw = np.random.default_rng(1)
    files = {f"{i}.off": NOISE[i * 900 :][:900] for i in range(4)}
    for format in FORMATS:
        honest = pack(files, format)
        for _ in range(150):
            data = bytearray(honest)
            for place in draw.integers(0, len(data), 3):
                data[place] = draw.integers(256)
            try:
                got = contents(bytes(data))
            except (ArchiveTooLargeError, UnknownArchiveError):
                continue
            assert len(got) <= len(files)
