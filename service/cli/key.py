"""`isoshape key`: a new key."""

from service.access.keys import digest_of, new_key
from service.cli.console import output


def command() -> None:
    """Make a key, and print it and its SHA-256.

    The service is given the digest, in ISOSHAPE_API_KEYS (may do everything) or ISOSHAPE_READ_KEYS (may read,
    query and compare). Whoever uses the service is given the key. It is kept nowhere.
    """
    key = new_key()
    console = output()
    console.print(f"key     {key}", soft_wrap=True)
    console.print(f"sha256  {digest_of(key)}", soft_wrap=True)
