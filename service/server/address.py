"""The address of a service: its defaults and its socket."""

import ipaddress
import socket

from service.errors import ExpectedError

LOOPBACK = "127.0.0.1"
DEFAULT_PORT = 8000


class PortError(ExpectedError):
    """The service cannot listen on the address; the message gives the reason."""

    status = 2


def bind(host: str, port: int) -> socket.socket:
    """A socket bound to the address, before a database is opened or migrated.

    Raises
    ------
    PortError
        The port is in use, or the address is not one of this machine.
    """
    try:
        family, kind, protocol, _, address = socket.getaddrinfo(host, port, type=socket.SOCK_STREAM)[0]
        bound = socket.socket(family, kind, protocol)
        try:
            bound.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
            bound.bind(address)
            # Until a process listens on the port, a second one can bind it.
            bound.listen(128)
        except BaseException:
            bound.close()
            raise
    except OSError as error:
        raise PortError(f"cannot listen on {host} port {port}: {error.strerror}") from error
    return bound


def is_loopback(address: str) -> bool:
    """Whether only this machine can reach the address."""
    return ipaddress.ip_address(address).is_loopback
