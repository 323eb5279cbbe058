"""The supported formats, by name and by file extension."""

from core.errors import UnknownFormatError
from core.io import step

FORMATS: tuple[str, ...] = ("stl", "obj", "ply", "off", "glb")
"""The formats of one mesh or scene, which need no extra package."""

WRITABLE: tuple[str, ...] = (*FORMATS, "3mf")
"""The formats that are written."""

READABLE: tuple[str, ...] = (*WRITABLE, "step")
"""The formats that are read: STEP with the package cascadio."""

ENDINGS: dict[str, str] = {**{name: name for name in READABLE}, "stp": "step"}
"""Formats by file extension."""


def readable() -> tuple[str, ...]:
    """The formats whose readers are installed."""
    return READABLE if step.is_read() else WRITABLE


def known(format: str) -> str:
    """Return the canonical name of a readable format, in lower case.

    Raises
    ------
    UnknownFormatError
        The format is not one of `READABLE`, or its reader is not installed.
    """
    name = ENDINGS.get(format.lower())
    if name is None:
        raise UnknownFormatError(f"the format {_shown(format)} is not one of {', '.join(readable())}")
    if name == "step" and not step.is_read():
        raise UnknownFormatError(
            "STEP is not read here: it needs the extra 'step', as pip install 'isoshape[step]'"
        )
    return name


def written(format: str) -> str:
    """Return the canonical name of a writable format, in lower case.

    Raises
    ------
    UnknownFormatError
        The format is not one of `WRITABLE`.
    """
    name = format.lower()
    if name not in WRITABLE:
        raise UnknownFormatError(
            f"the format {_shown(format)} is not one that is written: {', '.join(WRITABLE)}"
        )
    return name


def _shown(format: str) -> str:
    """Return the name of a format from a request, shortened and reduced to letters and digits."""
    return (
        "".join(letter for letter in format.lower()[:16] if letter.isalnum())
        or "of a file without an extension"
    )


def format_of(filename: str) -> str:
    """Return the format of a file extension, which is not case-sensitive.

    Parameters
    ----------
    filename : str
        The text after the last dot is the extension.

    Returns
    -------
    format : str
        One of `READABLE`.

    Raises
    ------
    UnknownFormatError
        There is no extension, its format is not one of `READABLE`, or the reader is not installed.
    """
    return known(filename.rpartition(".")[2] if "." in filename else "")
