"""`python -m services.control --port 8000 --data runs`: REST in front of the scheduler."""

from __future__ import annotations

import argparse
import errno
import logging
import os
import socket
import threading
from collections.abc import Sequence
from pathlib import Path

import uvicorn

from common.errors import Exposed, InvalidValue, LegatoError, PortInUse
from common.exposure import is_loopback
from common.log import configure_logging
from common.process import add_bus_options, end_process, report_failure
from common.service import install_stop_signals
from services.control.app import create_app
from services.control.catalog import load_catalog
from services.control.keyring import KeyRing
from services.control.plane import ControlPlane
from services.control.worker import Worker

log = logging.getLogger(__name__)

GRACE_S = 1
"""How long a connection may take to finish when the process stops."""


class Server(uvicorn.Server):
    """Ends when `stop` is set too, and sends those who follow an evaluation away first."""

    def __init__(self, plane: ControlPlane, keys: KeyRing | None, stop: threading.Event) -> None:
        config = uvicorn.Config(
            create_app(plane, keys=keys),
            # The process's own logging is in place already.
            log_config=None,
            access_log=False,
            lifespan="off",
            server_header=False,
            # A caller must not choose the address that is counted and logged.
            proxy_headers=False,
            timeout_graceful_shutdown=GRACE_S,
        )
        super().__init__(config)
        self._plane = plane
        self._stop = stop

    async def on_tick(self, counter: int) -> bool:
        """Tell ten times a second whether to end."""
        return await super().on_tick(counter) or self._stop.is_set()

    async def shutdown(self, sockets: list[socket.socket] | None = None) -> None:
        """Close the listener and the connections."""
        self._plane.subscriptions.close()
        await super().shutdown(sockets)


def listen(host: str, port: int) -> socket.socket:
    """Take the port, before anything else is started.

    Raises:
        PortInUse: Something else listens there.
        InvalidValue: Not an address of this machine, or not allowed.
    """
    family = socket.AF_INET6 if ":" in host else socket.AF_INET
    try:
        return socket.create_server((host, port), family=family, backlog=128)
    except OSError as error:
        if error.errno == errno.EADDRINUSE:
            raise PortInUse("REST", host, port) from error
        expected = f"an address and port that can be listened on ({error.strerror or error})"
        raise InvalidValue("--host, --port", f"{host}:{port}", expected) from error


def open_keys(args: argparse.Namespace) -> KeyRing | None:
    """The keys that the options name, or none where nobody else can call.

    Raises:
        BadKeyFile: The file cannot be used.
        Exposed: Others could call, and neither keys nor consent are given.
        InvalidValue: Both are.
    """
    if args.api_keys_file is not None:
        if args.insecure_no_keys:
            raise InvalidValue("--insecure-no-keys", True, "it without --api-keys-file")
        return KeyRing(args.api_keys_file)
    if not (args.insecure_no_keys or is_loopback(args.host)):
        raise Exposed(
            "REST",
            args.host,
            protection="--api-keys-file",
            consent="--insecure-no-keys",
        )
    return None


def run(args: argparse.Namespace) -> int:
    """Serve until SIGTERM, SIGINT, the loss of the parent or an error; return the exit code.

    Raises:
        LegatoError: Why it cannot start or had to end.
    """
    stop = threading.Event()
    install_stop_signals(stop)
    keys = open_keys(args)
    with listen(args.host, args.port) as listener:
        worker = Worker(args, load_catalog(), stop)
        plane = worker.start()
        if plane is not None:
            host, port = listener.getsockname()[:2]
            log.info("listening", extra={"host": host, "port": port})
            try:
                Server(plane, keys, stop).run(sockets=[listener])
            finally:
                stop.set()
    return worker.finish()


def main(argv: Sequence[str] | None = None) -> int:
    """Parse the command line, run, and turn errors into an exit code."""
    parser = argparse.ArgumentParser(prog="python -m services.control", description=__doc__)
    parser.add_argument("--host", default="127.0.0.1", help="address of REST (%(default)s)")
    parser.add_argument("--port", type=int, default=8000, help="port of REST (%(default)s)")
    parser.add_argument(
        "--api-keys-file",
        type=Path,
        default=None,
        help="file of `legato keys create`; without it everybody who calls may do everything",
    )
    parser.add_argument(
        "--insecure-no-keys",
        action="store_true",
        help="allow another --host than this machine's loopback without keys",
    )
    parser.add_argument("--data", default="runs", help="folder of the results (%(default)s)")
    parser.add_argument(
        "--database",
        default=os.environ.get("DATABASE_URL"),
        help="URL of another database (DATABASE_URL; default: SQLite in --data)",
    )
    add_bus_options(parser, default_node="control")
    args = parser.parse_args(argv)
    configure_logging(args.node, level=args.log_level)
    try:
        return run(args)
    except LegatoError as error:
        return report_failure(error)


if __name__ == "__main__":
    end_process(main())
