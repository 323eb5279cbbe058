"""The formats that are read, by name."""

from core.errors import UnknownFormatError

FORMATS: tuple[str, ...] = ("stl", "obj", "ply", "off", "glb")


def known(format: str) -> str:
    """Return the name of a format in small letters.

    Raises
    ------
    UnknownFormatError
        It is not one of `FORMATS`.
    """
    name = format.lower()
    if name not in FORMATS:
        shown = "".join(letter for letter in name[:16] if letter.isalnum())
        raise UnknownFormatError(
            f"the format {shown or 'of a file without an extension'} is not one of {', '.join(FORMATS)}"
        )
    return name


def format_of(filename: str) -> str:
    """Return the format that a file's extension names, in any case of letters.

    Parameters
    ----------
    filename : str
        Only what follows the last dot is looked at.

    Returns
    -------
    format : str
        One of `FORMATS`.

    Raises
    ------
    UnknownFormatError
        There is no extension, or it is not that of a format in `FORMATS`.
    """
    return known(filename.rpartition(".")[2] if "." in filename else "")
