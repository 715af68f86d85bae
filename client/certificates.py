"""A private certificate authority in a folder, one certificate per role, and further ones."""

from __future__ import annotations

import ipaddress
import os
from collections.abc import Sequence
from dataclasses import dataclass
from datetime import UTC, datetime, timedelta
from pathlib import Path

from common.bus.access import ROLES, Role, role_named
from common.bus.grants import Grant, add_grant
from common.errors import BadCertificate, InvalidValue, MissingExtra, NotWritable

try:
    from cryptography import x509
    from cryptography.hazmat.primitives import hashes, serialization
    from cryptography.hazmat.primitives.asymmetric import ec
    from cryptography.x509.oid import ExtendedKeyUsageOID, NameOID
except ModuleNotFoundError as error:
    raise MissingExtra("cryptography", "certs") from error

ROUTER_NAMES = ("localhost", "127.0.0.1", "::1", "router")
"""Names that every router has: for its own machine, and for the other containers of Compose."""
AUTHORITY_DAYS = 3650
_SKEW = timedelta(minutes=5)
"""Certificates begin this long ago: clocks differ."""


@dataclass(frozen=True)
class Authority:
    """Signs certificates.

    Args:
        folder: Has `ca.pem`, `ca.key` and a folder per certificate.
        certificate: Its own, which every process has.
        key: Needed for signing only.
    """

    folder: Path
    certificate: x509.Certificate
    key: ec.EllipticCurvePrivateKey

    def issue_for(self, grant: Grant, *, days: int) -> Path:
        """Make the folder of a certificate with rights in some cells, and write them down.

        Args:
            grant: The rights; its name is the folder and the common name.
            days: How long it is valid.

        Raises:
            InvalidValue: There is, or was, one of that name.
            BadGrants: The router's file of rights cannot be used.
            NotWritable: The folder cannot be made.
        """

        def issue() -> Path:
            role = role_named(grant.role)
            return self.issue(role, name=grant.name, hosts=(), days=days, common_name=grant.name)

        return add_grant(router_folder(self.folder), grant, issue=issue)

    def issue(
        self,
        role: Role,
        *,
        name: str,
        hosts: Sequence[str],
        days: int,
        common_name: str | None = None,
    ) -> Path:
        """Make the folder of one certificate: `ca.pem`, `cert.pem`, `key.pem`.

        Args:
            role: What it is for.
            name: Folder.
            hosts: Names and addresses of a router beside those that each has.
            days: How long it is valid.
            common_name: By which the router grants rights; that of the role if it is None.

        Raises:
            InvalidValue: There is such a folder already, hosts for another role than the router, or
                a host that cannot be one.
            NotWritable: The folder cannot be made.
        """
        folder = self.folder / name
        if folder.exists():
            raise InvalidValue("--name", name, "a name without a certificate")
        if hosts and role.name != "router":
            raise InvalidValue("--host", list(hosts), "no host: only routers are called by name")
        names = [_host(host) for host in (*ROUTER_NAMES, *hosts)] if role.name == "router" else []
        key = ec.generate_private_key(ec.SECP256R1())
        certificate = _sign(
            _begin(common_name or role.name, key, days=days)
            .issuer_name(self.certificate.subject)
            .add_extension(x509.BasicConstraints(ca=False, path_length=None), critical=True)
            .add_extension(_key_usage(signs=False), critical=True)
            .add_extension(x509.ExtendedKeyUsage(_purposes(role)), critical=False)
            .add_extension(
                x509.AuthorityKeyIdentifier.from_issuer_public_key(self.key.public_key()),
                critical=False,
            ),
            self.key,
            names,
        )
        try:
            folder.mkdir(mode=0o755)
            _write(folder / "ca.pem", _pem(self.certificate), mode=0o644)
            _write(folder / "cert.pem", _pem(certificate), mode=0o644)
            _write(folder / "key.pem", _key_pem(key), mode=0o600)
        except OSError as error:
            raise NotWritable(str(folder), error.strerror or str(error)) from error
        return folder


def create_authority(folder: Path, *, hosts: Sequence[str], days: int) -> Authority:
    """Make an authority and one certificate per role.

    Args:
        folder: New or empty folder.
        hosts: Names and addresses under which other machines reach the router.
        days: How long the certificates of the roles are valid.

    Raises:
        InvalidValue: There is something in the folder, or a host cannot be one.
        NotWritable: The folder cannot be made.
    """
    for host in hosts:
        _host(host)
    if folder.exists() and (not folder.is_dir() or any(folder.iterdir())):
        expected = "a new or empty folder; with an authority in it: legato certs add"
        raise InvalidValue("--out", str(folder), expected)
    key = ec.generate_private_key(ec.SECP256R1())
    builder = _begin("LEGATO authority", key, days=AUTHORITY_DAYS)
    certificate = _sign(
        builder.issuer_name(_name("LEGATO authority"))
        .add_extension(x509.BasicConstraints(ca=True, path_length=0), critical=True)
        .add_extension(_key_usage(signs=True), critical=True),
        key,
    )
    try:
        folder.mkdir(mode=0o755, parents=True, exist_ok=True)
        _write(folder / "ca.key", _key_pem(key), mode=0o600)
        _write(folder / "ca.pem", _pem(certificate), mode=0o644)
    except OSError as error:
        raise NotWritable(str(folder), error.strerror or str(error)) from error
    authority = Authority(folder, certificate, key)
    for role in ROLES:
        own = hosts if role.name == "router" else ()
        authority.issue(role, name=role.name, hosts=own, days=days)
    return authority


def open_authority(folder: Path) -> Authority:
    """The authority that `create_authority` made.

    Raises:
        BadCertificate: It is not there, or cannot be read.
    """
    try:
        certificate = x509.load_pem_x509_certificate((folder / "ca.pem").read_bytes())
        key = serialization.load_pem_private_key((folder / "ca.key").read_bytes(), password=None)
    except OSError as error:
        raise BadCertificate(str(error.filename), error.strerror or str(error)) from error
    except ValueError as error:
        raise BadCertificate(str(folder), "not a certificate and key") from error
    if not isinstance(key, ec.EllipticCurvePrivateKey):
        raise BadCertificate(str(folder / "ca.key"), "not a key that LEGATO has made")
    return Authority(folder, certificate, key)


def read_certificate(path: Path) -> tuple[str, datetime]:
    """Common name of a certificate, and until when it is valid.

    Raises:
        BadCertificate: It cannot be read.
    """
    try:
        certificate = x509.load_pem_x509_certificate(path.read_bytes())
        (name,) = certificate.subject.get_attributes_for_oid(NameOID.COMMON_NAME)
    except OSError as error:
        raise BadCertificate(str(path), error.strerror or str(error)) from error
    except ValueError as error:
        raise BadCertificate(str(path), "not a certificate of LEGATO") from error
    return str(name.value), certificate.not_valid_after_utc


def router_folder(folder: Path) -> Path:
    """Where an authority keeps the router's certificate, and who has rights in some cells."""
    return folder / "router"


def _begin(
    common_name: str, key: ec.EllipticCurvePrivateKey, *, days: int
) -> x509.CertificateBuilder:
    now = datetime.now(UTC)
    return (
        x509.CertificateBuilder()
        .subject_name(_name(common_name))
        .public_key(key.public_key())
        .serial_number(x509.random_serial_number())
        .not_valid_before(now - _SKEW)
        .not_valid_after(now + timedelta(days=days))
        .add_extension(x509.SubjectKeyIdentifier.from_public_key(key.public_key()), critical=False)
    )


def _sign(
    builder: x509.CertificateBuilder,
    key: ec.EllipticCurvePrivateKey,
    hosts: Sequence[x509.GeneralName] = (),
) -> x509.Certificate:
    if hosts:
        builder = builder.add_extension(x509.SubjectAlternativeName(hosts), critical=False)
    return builder.sign(key, hashes.SHA256())


def _name(common_name: str) -> x509.Name:
    return x509.Name([x509.NameAttribute(NameOID.COMMON_NAME, common_name)])


def _purposes(role: Role) -> list[x509.ObjectIdentifier]:
    # The router shows itself on the bus as a client. Nobody else can pass for a router.
    server = [ExtendedKeyUsageOID.SERVER_AUTH] if role.name == "router" else []
    return [*server, ExtendedKeyUsageOID.CLIENT_AUTH]


def _host(host: str) -> x509.GeneralName:
    try:
        return x509.IPAddress(ipaddress.ip_address(host))
    except ValueError:
        pass
    labels = host.split(".")
    if not all(label.replace("-", "a").isalnum() and label.isascii() for label in labels):
        raise InvalidValue("--host", host, "a host name or an address, without port")
    return x509.DNSName(host)


def _key_usage(*, signs: bool) -> x509.KeyUsage:
    return x509.KeyUsage(
        digital_signature=not signs,
        content_commitment=False,
        key_encipherment=False,
        data_encipherment=False,
        key_agreement=False,
        key_cert_sign=signs,
        crl_sign=signs,
        encipher_only=False,
        decipher_only=False,
    )


def _pem(certificate: x509.Certificate) -> bytes:
    return certificate.public_bytes(serialization.Encoding.PEM)


def _key_pem(key: ec.EllipticCurvePrivateKey) -> bytes:
    return key.private_bytes(
        serialization.Encoding.PEM,
        serialization.PrivateFormat.PKCS8,
        serialization.NoEncryption(),
    )


def _write(path: Path, content: bytes, *, mode: int) -> None:
    """A new file that never has more rights than `mode`, not even at first."""
    with os.fdopen(os.open(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL, mode), "wb") as file:
        file.write(content)
