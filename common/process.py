"""The command line edge of every service process: bus options, logging, exit code."""

from __future__ import annotations

import argparse
import logging
import os
import sys
from collections.abc import Callable
from typing import Any, NoReturn

from common.bus import BusSettings
from common.errors import LegatoError
from common.log import configure_logging
from common.service import Reactor, run_process

log = logging.getLogger(__name__)


def add_bus_options(parser: argparse.ArgumentParser, *, default_node: str) -> None:
    """Add the options that every process has: its name, its bus, its parent, its log."""
    parser.add_argument("--node", default=default_node, help="name on the bus (%(default)s)")
    parser.add_argument(
        "--endpoint", default="tcp/127.0.0.1:7447", help="Zenoh router (%(default)s)"
    )
    parser.add_argument("--namespace", default="legato", help="deployment (%(default)s)")
    parser.add_argument(
        "--parent-pid", type=int, default=None, help="stop when this process is gone"
    )
    parser.add_argument(
        "--log-level",
        default="INFO",
        choices=("DEBUG", "INFO", "WARNING", "ERROR"),
        help="least level that is logged (%(default)s)",
    )


def bus_settings(args: argparse.Namespace) -> BusSettings:
    """Where the bus is, from the options of `add_bus_options`."""
    return BusSettings(endpoint=args.endpoint, namespace=args.namespace)


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
            **kwargs,
        )
    except LegatoError as error:
        return report_failure(error)
    return 0
