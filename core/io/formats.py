"""The formats that are read, by name."""

from core.errors import UnknownFormatError
from core.io import step

FORMATS: tuple[str, ...] = ("stl", "obj", "ply", "off", "glb")
"""The formats of one mesh or scene a file, which are read and written."""

WRITABLE: tuple[str, ...] = (*FORMATS, "3mf")
"""The formats that are written."""

READABLE: tuple[str, ...] = (*WRITABLE, "step")
"""The formats that are read: STEP with the package cascadio."""

ENDINGS: dict[str, str] = {**{name: name for name in READABLE}, "stp": "step"}
"""What the name of a file ends in, and its format."""


def known(format: str) -> str:
    """Return the name of a format in small letters.

    Raises
    ------
    UnknownFormatError
        It is not one of `READABLE`, or what reads it is not installed.
    """
    name = ENDINGS.get(format.lower())
    if name is None:
        raise UnknownFormatError(f"the format {_shown(format)} is not one of {', '.join(READABLE)}")
    if name == "step" and not step.is_read():
        raise UnknownFormatError(
            "STEP is not read here: it needs the extra 'step', as pip install 'isoshape[step]'"
        )
    return name


def written(format: str) -> str:
    """Return the name of a format in small letters.

    Raises
    ------
    UnknownFormatError
        It is not one of `WRITABLE`.
    """
    name = format.lower()
    if name not in WRITABLE:
        raise UnknownFormatError(
            f"the format {_shown(format)} is not one that is written: {', '.join(WRITABLE)}"
        )
    return name


def _shown(format: str) -> str:
    """Return what a stranger called a format as it can be shown."""
    return (
        "".join(letter for letter in format.lower()[:16] if letter.isalnum())
        or "of a file without an extension"
    )


def format_of(filename: str) -> str:
    """Return the format that a file's extension names, in any case of letters.

    Parameters
    ----------
    filename : str
        Only what follows the last dot is looked at.

    Returns
    -------
    format : str
        One of `READABLE`.

    Raises
    ------
    UnknownFormatError
        There is no extension, it is not that of a format in `READABLE`, or what reads it is not installed.
    """
    return known(filename.rpartition(".")[2] if "." in filename else "")
