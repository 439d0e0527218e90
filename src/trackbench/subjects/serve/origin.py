"""Who may talk to the server: programs of this machine, and the pages that are named.

A browser lets any page open a WebSocket to this machine, and says where the page is from in ``Origin``. A page whose
name was made to point here (DNS rebinding) is known by that name in ``Host``.
"""

from __future__ import annotations

import ipaddress
import socket
from collections.abc import Collection
from urllib.parse import urlsplit

from trackbench.base.errors import InputError

EVERYWHERE = ("0.0.0.0", "::")


def require_origin(origin: str) -> str:
    """An origin as browsers write it.

    Raises:
        InputError: it is none.
    """
    parts = urlsplit(origin)
    if not parts.scheme or not parts.netloc or origin != f"{parts.scheme}://{parts.netloc}":
        raise InputError(f"write SCHEME://HOST[:PORT], such as http://localhost:8000, not {origin!r}")
    return origin.lower()


def refusal(origins: list[str], hosts: list[str], bound: str, allowed: Collection[str]) -> str | None:
    """Why a request is refused; None if it is not.

    Args:
        origins: its Origin headers; programs that are no browsers send none.
        hosts: its Host headers.
        bound: the address at which the server listens, as the user named it.
        allowed: origins of other machines.
    """
    for origin in origins:
        if origin.lower() not in allowed and not _loopback(_name(origin.partition("://")[2])):
            return f"a page of {origin!r} is not let in; --allow-origin lets it"
    for host in hosts:
        if not _own(_name(host), bound):
            return f"{host!r} is no name of this server; --host names it"
    return None


def _own(name: str, bound: str) -> bool:
    if _loopback(name) or name == bound.lower():
        return True
    # A name that was made to point here is never an address.
    return bound in EVERYWHERE and (name == socket.gethostname().lower() or _address(name) is not None)


def _name(netloc: str) -> str:
    """The host without its port."""
    try:
        return urlsplit(f"//{netloc}").hostname or ""
    except ValueError:
        return ""


def _loopback(name: str) -> bool:
    address = _address(name)
    return name == "localhost" or (address is not None and address.is_loopback)


def _address(name: str) -> ipaddress.IPv4Address | ipaddress.IPv6Address | None:
    try:
        return ipaddress.ip_address(name)
    except ValueError:
        return None
