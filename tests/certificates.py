"""Certificates for tests: those of `legato certs`, and those that it would never make."""

from __future__ import annotations

from datetime import timedelta
from pathlib import Path
from unittest import mock

from client import certificates
from client.certificates import Authority, create_authority
from common.bus import Credentials
from common.bus.access import Role, role_named

STRANGER = "stranger"
"""A role that the router does not know, signed by its own authority."""
EXPIRED = "expired"
FOREIGN = "foreign"
"""A retargeter of another authority, which has the certificate of ours."""


def make_certificates(folder: Path) -> Path:
    """Every role's folder, and those of the three who must not get in."""
    authority = create_authority(folder, hosts=[], days=1)
    authority.issue(Role(STRANGER, None), name=STRANGER, hosts=[], days=1)
    issue_expired(authority)
    other = create_authority(folder.with_name(f"{folder.name}-other"), hosts=[], days=1)
    forged = other.issue(role_named("retarget"), name=FOREIGN, hosts=[], days=1)
    (forged / "ca.pem").write_bytes((folder / "ca.pem").read_bytes())
    forged.rename(folder / FOREIGN)
    return folder


def issue_expired(authority: Authority) -> Path:
    with mock.patch.object(certificates, "_SKEW", timedelta(days=9)):
        return authority.issue(role_named("retarget"), name=EXPIRED, hosts=[], days=-1)


def unchecked(folder: Path) -> Credentials:
    """The files as they are, for what a process of ours would refuse before it connects."""
    return Credentials(folder / "ca.pem", folder / "cert.pem", folder / "key.pem")
