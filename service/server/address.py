"""Where a service listens: the default address, and the socket of an address."""

import ipaddress
import socket

from service.errors import ExpectedError

LOOPBACK = "127.0.0.1"
DEFAULT_PORT = 8000


class PortError(ExpectedError):
    """The address cannot be listened on; the message says why."""

    status = 2


def bind(host: str, port: int) -> socket.socket:
    """A socket bound to the address, before anything is opened or migrated.

    Raises
    ------
    PortError
        The port is taken, or the address is none of this machine's.
    """
    try:
        family, kind, protocol, _, address = socket.getaddrinfo(host, port, type=socket.SOCK_STREAM)[0]
        bound = socket.socket(family, kind, protocol)
        try:
            bound.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
            bound.bind(address)
            # A second process may bind the same port until somebody listens on it.
            bound.listen(128)
        except BaseException:
            bound.close()
            raise
    except OSError as error:
        raise PortError(f"cannot listen on {host} port {port}: {error.strerror}") from error
    return bound


def is_loopback(address: str) -> bool:
    """Whether a bound address is reached from this machine alone."""
    return ipaddress.ip_address(address).is_loopback
