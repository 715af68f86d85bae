"""`python -m services.router --listen 127.0.0.1:7447`."""

from __future__ import annotations

import argparse
import threading
from collections.abc import Sequence

from common.bus import BusSettings, open_session
from common.errors import InvalidValue, LegatoError
from common.log import configure_logging
from common.process import end_process, report_failure
from common.service import install_stop_signals, run_process
from services.router.presence import Presence

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
        InvalidValue: `--listen` is not `host:port`.
        PortInUse: Something else listens there.
    """
    host, port = split_address(args.listen)
    stop = threading.Event()
    install_stop_signals(stop)
    router = BusSettings(profile="router", endpoint=f"tcp/{host}:{port}")
    presence = BusSettings(
        endpoint=f"tcp/{_LOOPBACK.get(host, host)}:{port}", namespace=args.namespace
    )
    with open_session(router):
        run_process(Presence(), presence, node=args.node, parent_pid=args.parent_pid, stop=stop)


def main(argv: Sequence[str] | None = None) -> int:
    """Parse the command line, run, and turn errors into an exit code."""
    parser = argparse.ArgumentParser(prog="python -m services.router", description=__doc__)
    parser.add_argument("--listen", default="127.0.0.1:7447", help="host:port (%(default)s)")
    parser.add_argument("--namespace", default="legato", help="where it shows itself (%(default)s)")
    parser.add_argument("--node", default="router", help="name on the bus (%(default)s)")
    parser.add_argument("--parent-pid", type=int, default=None, help="stop when it is gone")
    parser.add_argument("--log-level", default="INFO", help="least level that is logged")
    args = parser.parse_args(argv)
    configure_logging(args.node, level=args.log_level)
    try:
        run(args)
    except LegatoError as error:
        return report_failure(error)
    return 0


if __name__ == "__main__":
    end_process(main())
