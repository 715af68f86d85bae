"""The HTTP server that Prometheus asks."""

from __future__ import annotations

import errno
import logging
from collections.abc import Generator
from contextlib import contextmanager

import prometheus_client

from common.errors import InvalidValue, PortInUse
from common.metrics.exporter import Exporter
from common.metrics.settings import MetricsSettings
from common.reactor import Reactor

log = logging.getLogger(__name__)


@contextmanager
def open_exporter(
    settings: MetricsSettings, reactor: Reactor, *, node: str
) -> Generator[Exporter, None, None]:
    """Offer the metrics of a node until the block ends.

    Args:
        settings: Where.
        reactor: Whose.
        node: Its name.

    Raises:
        PortInUse: Something else listens there.
        InvalidValue: Not an address of this machine, or not allowed.
    """
    # Every series would get a second one with the time of its birth, which no rule needs.
    prometheus_client.disable_created_metrics()
    exporter = Exporter(reactor, node=node)
    try:
        server, thread = prometheus_client.start_http_server(
            settings.port, settings.host, exporter.registry
        )
    except OSError as error:
        if error.errno == errno.EADDRINUSE:
            raise PortInUse("metrics", settings.host, settings.port) from error
        asked = f"{settings.host}:{settings.port}"
        expected = f"an address and port that can be listened on ({error.strerror or error})"
        raise InvalidValue("--metrics-host, --metrics-port", asked, expected) from error
    log.info("metrics", extra={"host": settings.host, "port": server.server_port})
    try:
        yield exporter
    finally:
        server.shutdown()
        server.server_close()
        thread.join()
