"""The names under which a service answers: a defence against DNS rebinding.

To a browser, a page whose name is rebound to the address of the service has the origin of the service: the
page may read and upload. The header Host of its requests has the name of the page.
"""

import ipaddress
from collections.abc import Collection

from starlette.datastructures import Headers

from service.errors import MisdirectedRequestError


def name_in(host: str) -> str:
    """The name or address of a header Host, in lower case, without port, brackets and final dot."""
    name = host.strip().lower()
    if name.startswith("["):
        return name[1:].partition("]")[0]
    if name.count(":") > 1:
        # An IPv6 address without brackets, as settings have it.
        return name
    return name.partition(":")[0].removesuffix(".")


def is_loopback_name(name: str) -> bool:
    """Whether a name stands for this machine alone: localhost, or an address of the loopback interface."""
    if name == "localhost":
        return True
    try:
        return ipaddress.ip_address(name).is_loopback
    except ValueError:
        return False


class Hosts:
    """The check of the header Host.

    Parameters
    ----------
    names : collection of str
        Names of the service; those of the loopback interface are always among them.
    any : bool
        Whether the service answers under every name.
    """

    def __init__(self, names: Collection[str], *, any: bool) -> None:
        self._names = frozenset(map(name_in, names))
        self._any = any

    def check(self, headers: Headers) -> None:
        """Refuse a request for another name.

        Raises
        ------
        MisdirectedRequestError
            The request names another host, or none.
        """
        if self._any:
            return
        given = [name_in(host) for host in headers.getlist("host")] or [""]
        for name in given:
            if not (name in self._names or is_loopback_name(name)):
                raise MisdirectedRequestError(
                    f"this service does not answer as {name[:80]!r}; the setting ISOSHAPE_HOSTS adds a name"
                )
