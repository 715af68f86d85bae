"""The command line edge of every service process: bus options, logging, exit code."""

from __future__ import annotations

import argparse
import logging
import os
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any, NoReturn

from common.bus import BusSettings, Credentials
from common.errors import InvalidValue, LegatoError
from common.log import configure_logging
from common.metrics import MetricsSettings
from common.service import Reactor, run_process

log = logging.getLogger(__name__)

LEASE_S = "LEGATO_LEASE_S"
METRICS_PORT = "LEGATO_METRICS_PORT"
METRICS_HOST = "LEGATO_METRICS_HOST"


def add_bus_options(parser: argparse.ArgumentParser, *, default_node: str) -> None:
    """Add the options that every process has: its name, bus, parent, log and metrics."""
    parser.add_argument("--node", default=default_node, help="name on the bus (%(default)s)")
    parser.add_argument(
        "--endpoint",
        default=os.environ.get("LEGATO_ENDPOINT") or "tcp/127.0.0.1:7447",
        help="Zenoh router (LEGATO_ENDPOINT; %(default)s)",
    )
    add_certs_option(parser)
    parser.add_argument("--namespace", default="legato", help="deployment (%(default)s)")
    add_lease_option(parser)
    parser.add_argument(
        "--parent-pid", type=int, default=None, help="stop when this process is gone"
    )
    parser.add_argument(
        "--log-level",
        default="INFO",
        choices=("DEBUG", "INFO", "WARNING", "ERROR"),
        help="least level that is logged (%(default)s)",
    )
    add_metrics_options(parser)


def add_lease_option(parser: argparse.ArgumentParser) -> None:
    """Add how long silence is borne."""
    parser.add_argument(
        "--lease-s",
        type=float,
        default=os.environ.get(LEASE_S) or None,
        help=f"seconds until a silent link counts as lost ({LEASE_S}; 1, encrypted 2)",
    )


def add_metrics_options(parser: argparse.ArgumentParser) -> None:
    """Add where Prometheus may ask."""
    parser.add_argument(
        "--metrics-port",
        type=int,
        default=os.environ.get(METRICS_PORT) or None,
        help=f"port of the metrics for Prometheus ({METRICS_PORT}; default: none)",
    )
    parser.add_argument(
        "--metrics-host",
        default=os.environ.get(METRICS_HOST) or "127.0.0.1",
        help=f"address of the metrics ({METRICS_HOST}; %(default)s)",
    )


def metrics_settings(args: argparse.Namespace) -> MetricsSettings | None:
    """Where Prometheus may ask, from the options of `add_metrics_options`.

    Raises:
        InvalidValue: There is no such port.
    """
    port: int | None = args.metrics_port
    if port is None:
        return None
    if not 0 <= port <= 65535:
        raise InvalidValue("--metrics-port", port, "a number from 0 to 65535")
    return MetricsSettings(port=port, host=args.metrics_host)


def add_certs_option(parser: argparse.ArgumentParser) -> None:
    """Add the option of who this process is, for an encrypted bus."""
    folder = os.environ.get("LEGATO_CERTS")
    parser.add_argument(
        "--certs",
        type=Path,
        default=Path(folder) if folder else None,
        help="folder of its certificate: ca.pem, cert.pem, key.pem (LEGATO_CERTS; none)",
    )


def load_credentials(args: argparse.Namespace) -> Credentials | None:
    """Who this process is, from the option `--certs`.

    Raises:
        BadCertificate: It cannot be used.
    """
    return None if args.certs is None else Credentials.from_folder(args.certs)


def bus_settings(args: argparse.Namespace) -> BusSettings:
    """Where the bus is, from the options of `add_bus_options`.

    Raises:
        BadCertificate: `--certs` cannot be used.
        InvalidValue: `--endpoint` and `--certs` do not go together, or there is no such lease.
    """
    return BusSettings(
        endpoint=args.endpoint,
        namespace=args.namespace,
        credentials=load_credentials(args),
        asked_lease_s=args.lease_s,
    )


def report_failure(error: LegatoError) -> int:
    """Log an error, say it in one line on standard error, and return the exit code 1."""
    log.error("stopped by an error", extra=error.describe())
    sys.stderr.write(f"{error.code} {error}\n")
    return 1


def end_process(code: int) -> NoReturn:
    """End this process now, with everything closed and written.

    Taking the interpreter apart frees what the system takes back anyway, for up to half a second
    of computing time (compiled kernels, a web application), which on a busy machine is longer than
    a supervisor waits. It also waits for whatever a session behind a stalled link left running.

    Args:
        code: Exit code.
    """
    logging.shutdown()
    sys.stdout.flush()
    sys.stderr.flush()
    os._exit(code)


def run_service(
    make_reactor: Callable[[], Reactor], args: argparse.Namespace, **kwargs: Any
) -> int:
    """Run a reactor as a process until it is told to stop.

    Args:
        make_reactor: Builds the service; called once logging is configured.
        args: Options of `add_bus_options`.
        **kwargs: Passed on to `run_process`.

    Returns:
        Exit code: 0 after a clean stop, 1 after an error of LEGATO's own.
    """
    configure_logging(args.node, level=args.log_level)
    try:
        run_process(
            make_reactor(),
            bus_settings(args),
            node=args.node,
            parent_pid=args.parent_pid,
            metrics=metrics_settings(args),
            **kwargs,
        )
    except LegatoError as error:
        return report_failure(error)
    return 0
