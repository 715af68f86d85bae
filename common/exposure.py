"""Whether an address to listen on is reached from this machine alone."""

from __future__ import annotations

import ipaddress


def is_loopback(host: str) -> bool:
    """Whether only this machine reaches a host.

    A name is taken for public unless it is `localhost`: what others resolve to is not asked.

    Args:
        host: Address or name; IPv6 with or without brackets. Empty means every address.
    """
    try:
        return ipaddress.ip_address(host.strip("[]")).is_loopback
    except ValueError:
        return host == "localhost"
