"""Archives made for the tests, honest ones and others."""

import io
import stat
import tarfile
import zipfile
from collections.abc import Mapping, Sequence

TAR_MODES = {"tar": "w", "tar.gz": "w:gz", "tar.bz2": "w:bz2", "tar.xz": "w:xz"}
FORMATS = ("zip", *TAR_MODES)

Files = Mapping[str, bytes] | Sequence[tuple[str, bytes]]


def pack(files: Files, format: str = "zip") -> bytes:
    """An archive of files by their names, of which some may be there twice."""
    pairs = list(files.items()) if isinstance(files, Mapping) else list(files)
    if format == "zip":
        return zipped([(zipfile.ZipInfo(name), data) for name, data in pairs])
    return tarred([(tarfile.TarInfo(name), data) for name, data in pairs], format)


def zipped(members: Sequence[tuple[zipfile.ZipInfo, bytes]]) -> bytes:
    """A zip of members with all that is said of them; deflated, unless it is said otherwise."""
    buffer = io.BytesIO()
    with zipfile.ZipFile(buffer, "w") as archive:
        for info, data in members:
            archive.writestr(info, data, info.compress_type or zipfile.ZIP_DEFLATED)
    return buffer.getvalue()


def tarred(members: Sequence[tuple[tarfile.TarInfo, bytes]], format: str = "tar", **options: int) -> bytes:
    """A tar of members with all that is said of them."""
    buffer = io.BytesIO()
    with tarfile.open(fileobj=buffer, mode=TAR_MODES[format], **options) as archive:  # type: ignore[call-overload]
        for info, data in members:
            info.size = len(data)
            archive.addfile(info, io.BytesIO(data))
    return buffer.getvalue()


def zip_link(name: str) -> zipfile.ZipInfo:
    """A member that says it is a symbolic link."""
    info = zipfile.ZipInfo(name)
    info.create_system = 3
    info.external_attr = (stat.S_IFLNK | 0o777) << 16
    return info


def tar_of_type(name: str, kind: bytes, target: str = "") -> tarfile.TarInfo:
    """A member of a kind: a link, a device, ..."""
    info = tarfile.TarInfo(name)
    info.type, info.linkname = kind, target
    return info


def patched(archive: bytes, old: bytes, new: bytes) -> bytes:
    """The archive with some bytes, wherever they are, replaced by as many others."""
    assert len(old) == len(new)
    assert old in archive
    return archive.replace(old, new)
