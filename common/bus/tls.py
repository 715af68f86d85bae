"""The certificate of a process: its files, checked before they are used."""

from __future__ import annotations

import socket
import ssl
from dataclasses import dataclass
from pathlib import Path
from typing import Self

from common.bus.grants import read_own
from common.errors import BadCertificate

PROBE_S = 1.0


@dataclass(frozen=True)
class Credentials:
    """Who a process is, and whom it believes.

    Args:
        authority: Certificate of the authority that signed every other one.
        certificate: Its own; the common name is its role, or a name with rights in some cells.
        key: Private key of its own certificate.
        cells: Cells in which it has rights, as `common/bus/grants.py` writes them. The router does
            not ask here; it is for control to know.
    """

    authority: Path
    certificate: Path
    key: Path
    cells: tuple[str, ...] = ("*",)

    @classmethod
    def from_folder(cls, folder: Path) -> Self:
        """The files of a folder as `legato certs` makes it: `ca.pem`, `cert.pem`, `key.pem`.

        Where it has rights in some cells only, `grant.json` says in which.

        Raises:
            BadCertificate: One is missing or unreadable, they do not belong together, or are not
                valid now.
            BadGrants: `grant.json` is there and cannot be used.
        """
        # Zenoh reads them later and elsewhere.
        whole = folder.resolve()
        grant = read_own(whole)
        cells = ("*",) if grant is None else grant.cells
        found = cls(whole / "ca.pem", whole / "cert.pem", whole / "key.pem", cells)
        for path in (found.authority, found.certificate, found.key):
            try:
                path.read_bytes()
            except OSError as error:
                raise BadCertificate(str(path), error.strerror or str(error)) from error
        found.check()
        return found

    def check(self) -> None:
        """Show the certificate to ourselves as another process will see it.

        Raises:
            BadCertificate: What is wrong with it.
        """
        server = self._load(ssl.PROTOCOL_TLS_SERVER)
        client = self._load(ssl.PROTOCOL_TLS_CLIENT)
        client.check_hostname = False
        # A role's certificate is no server's: only the other direction is checked.
        client.verify_mode = ssl.CERT_NONE
        to_server, to_client = ssl.MemoryBIO(), ssl.MemoryBIO()
        ours = client.wrap_bio(to_client, to_server)
        theirs = server.wrap_bio(to_server, to_client, server_side=True)
        try:
            for end in (ours, theirs, ours):
                _advance(end)
            # The last word: it has seen the certificate now.
            theirs.do_handshake()
        except ssl.SSLError as error:
            raise BadCertificate(str(self.certificate), _describe(error)) from error

    def find_problem(self, host: str, port: int) -> str:
        """Why no link to a router comes about, in words.

        Asked only after Zenoh has failed: it opens a connection of its own.
        """
        context = self._load(ssl.PROTOCOL_TLS_CLIENT)
        try:
            with (
                socket.create_connection((host, port), timeout=PROBE_S) as plain,
                context.wrap_socket(plain, server_hostname=host) as link,
            ):
                # With TLS 1.3 the router judges our certificate after our side is done.
                link.recv(1)
        except TimeoutError:
            return "it accepted the connection, then said nothing"
        except ssl.SSLError as error:
            return _describe(error)
        except OSError as error:
            return error.strerror or str(error)
        return "it closed the connection"

    def _load(self, protocol: int) -> ssl.SSLContext:
        context = ssl.SSLContext(protocol)
        context.verify_mode = ssl.CERT_REQUIRED
        try:
            context.load_verify_locations(self.authority)
        except ssl.SSLError as error:
            raise BadCertificate(str(self.authority), "not a certificate") from error
        try:
            # A key under a password would be asked for on the terminal.
            context.load_cert_chain(self.certificate, self.key, password="")
        except ssl.SSLError as error:
            wrong = "its key is not that of cert.pem" if "MISMATCH" in str(error.reason) else None
            raise BadCertificate(str(self.key), wrong or "not a certificate and key") from error
        return context


def _advance(end: ssl.SSLObject) -> None:
    try:
        end.do_handshake()
    except ssl.SSLWantReadError:
        # Its turn comes again when the other end has answered.
        return


def _describe(error: ssl.SSLError) -> str:
    if isinstance(error, ssl.SSLCertVerificationError):
        return error.verify_message
    return (error.reason or str(error)).lower().replace("_", " ")
