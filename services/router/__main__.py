"""`python -m services.router --listen 127.0.0.1:7447 [--certs DIR]`."""

from __future__ import annotations

import argparse
import logging
import threading
from collections.abc import Sequence
from pathlib import Path

from common.bus import BusSettings, open_session
from common.bus.grants import Grant, read_grants
from common.errors import Exposed, InvalidValue, LegatoError
from common.exposure import is_loopback
from common.log import configure_logging
from common.process import (
    add_certs_option,
    add_lease_option,
    add_metrics_options,
    end_process,
    load_credentials,
    metrics_settings,
    report_failure,
)
from common.service import install_stop_signals, run_process
from services.router.presence import Presence

log = logging.getLogger(__name__)

_LOOPBACK = {"0.0.0.0": "127.0.0.1", "[::]": "[::1]"}


def split_address(listen: str) -> tuple[str, int]:
    """Host and port of `host:port`; an IPv6 host stands in brackets.

    Raises:
        InvalidValue: It is not of that form.
    """
    host, _, port = listen.rpartition(":")
    if not host or not port.isdecimal() or not 1 <= int(port) <= 65535:
        raise InvalidValue("--listen", listen, "host:port, e.g. 127.0.0.1:7447")
    return host, int(port)


def run(args: argparse.Namespace) -> None:
    """Route until SIGTERM, SIGINT or the loss of the parent.

    Raises:
        Exposed: Others could reach it, and nobody has said that they may.
        InvalidValue: `--listen` is not `host:port`.
        BadCertificate: `--certs` cannot be used.
        BadGrants: The rights in its folder cannot be used.
        PortInUse: Something else listens there.
    """
    host, port = split_address(args.listen)
    credentials = load_credentials(args)
    if credentials is None and not (args.insecure_plain_tcp or is_loopback(host)):
        raise Exposed("the bus", host, protection="certificates", consent="--insecure-plain-tcp")
    stop = threading.Event()
    install_stop_signals(stop)
    scheme = "tcp" if credentials is None else "tls"
    grants = () if credentials is None else load_grants(args.certs)
    router = BusSettings(
        "router",
        f"{scheme}/{host}:{port}",
        args.namespace,
        credentials,
        grants,
        asked_lease_s=args.lease_s,
    )
    own = f"{scheme}/{_LOOPBACK.get(host, host)}:{port}"
    presence = BusSettings("client", own, args.namespace, credentials, asked_lease_s=args.lease_s)
    with open_session(router):
        run_process(
            Presence(),
            presence,
            node=args.node,
            parent_pid=args.parent_pid,
            stop=stop,
            metrics=metrics_settings(args),
        )


def load_grants(folder: Path) -> tuple[Grant, ...]:
    """Who has rights in some cells only; the log says so.

    Raises:
        BadGrants: The file cannot be used.
    """
    grants = read_grants(folder).grants
    for grant in grants:
        revoked = None if grant.revoked is None else grant.revoked.isoformat()
        extra = {"role": grant.role, "cells": list(grant.cells), "revoked": revoked}
        log.info("rights", extra={"certificate": grant.name, **extra})
    return grants


def main(argv: Sequence[str] | None = None) -> int:
    """Parse the command line, run, and turn errors into an exit code."""
    parser = argparse.ArgumentParser(prog="python -m services.router", description=__doc__)
    parser.add_argument("--listen", default="127.0.0.1:7447", help="host:port (%(default)s)")
    parser.add_argument(
        "--insecure-plain-tcp",
        action="store_true",
        help="allow another address than this machine's loopback without certificates",
    )
    parser.add_argument("--namespace", default="legato", help="deployment (%(default)s)")
    parser.add_argument("--node", default="router", help="name on the bus (%(default)s)")
    add_certs_option(parser)
    add_lease_option(parser)
    parser.add_argument("--parent-pid", type=int, default=None, help="stop when it is gone")
    parser.add_argument("--log-level", default="INFO", help="least level that is logged")
    add_metrics_options(parser)
    args = parser.parse_args(argv)
    configure_logging(args.node, level=args.log_level)
    try:
        run(args)
    except LegatoError as error:
        return report_failure(error)
    return 0


if __name__ == "__main__":
    end_process(main())
