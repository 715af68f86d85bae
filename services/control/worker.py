"""The scheduler on its thread, with the store behind it."""

from __future__ import annotations

import argparse
import logging
import threading
from pathlib import Path

from common.errors import LegatoError, RouterUnreachable
from common.process import bus_settings, metrics_settings
from common.service import Host, run_process
from services.control.catalog import Catalog
from services.control.database import Database, database_url
from services.control.deployment import Deployment
from services.control.plane import ControlPlane
from services.control.queries import Queries
from services.control.scheduler import Scheduler
from services.control.sink import ResultSink
from services.control.store import Store
from services.control.subscriptions import Subscriptions

log = logging.getLogger(__name__)


class Worker:
    """Runs the scheduler until `stop` is set, and sets it when it ends for any other reason.

    Nothing is written before the bus has said that this is the only control plane.

    Args:
        args: Options of the command line.
        catalog: What this code knows.
        stop: Ends it.
    """

    def __init__(self, args: argparse.Namespace, catalog: Catalog, stop: threading.Event) -> None:
        self.plane: ControlPlane | None = None
        self._args = args
        self._catalog = catalog
        self._stop = stop
        self._settled = threading.Event()
        self._error: LegatoError | None = None
        self._crashed = False
        self._thread = threading.Thread(target=self._run, name="scheduler")

    def start(self) -> ControlPlane | None:
        """Start, and return once it is ready: what is behind REST, or None if it ended instead."""
        self._thread.start()
        self._settled.wait()
        return self.plane

    def finish(self) -> int:
        """Stop, wait for the end and return the exit code.

        Raises:
            LegatoError: What ended it.
        """
        self._stop.set()
        self._thread.join()
        if self._error is not None:
            raise self._error
        return 1 if self._crashed else 0

    def _run(self) -> None:
        try:
            self._serve()
        except LegatoError as error:
            # Told to stop while it waited for the router: that is no error.
            if not (isinstance(error, RouterUnreachable) and self._stop.is_set()):
                self._error = error
        except Exception:
            log.exception("the scheduler failed")
            self._crashed = True
        finally:
            self._stop.set()
            self._settled.set()

    def _serve(self) -> None:
        settings = bus_settings(self._args)
        sinks: list[ResultSink] = []
        databases: list[Database] = []

        def on_host(host: Host, _: threading.Event) -> None:
            database = Database(self._args.database or database_url(Path(self._args.data)))
            databases.append(database)
            self.plane, sink = self._connect(host, database)
            sinks.append(sink)
            self._settled.set()

        try:
            run_process(
                Scheduler(lease_s=settings.lease_s),
                settings,
                node=self._args.node,
                # The host handles nothing before `on_host` has returned.
                sink=lambda event: sinks[0](event),
                parent_pid=self._args.parent_pid,
                unique=True,
                on_host=on_host,
                stop=self._stop,
                metrics=metrics_settings(self._args),
            )
        finally:
            for database in databases:
                database.close()

    def _connect(self, host: Host, database: Database) -> tuple[ControlPlane, ResultSink]:
        store = Store(database, namespace=self._args.namespace)
        deployment, subscriptions = Deployment(), Subscriptions()
        for submitted in store.resume():
            log.info(
                "evaluation resumed",
                extra={"evaluation": submitted.evaluation, "trials": len(submitted.trials)},
            )
            host.inbox.put_event(submitted)
        plane = ControlPlane(
            store=store,
            queries=Queries(database, namespace=self._args.namespace),
            deployment=deployment,
            catalog=self._catalog,
            subscriptions=subscriptions,
            send=host.inbox.put_event,
        )
        return plane, ResultSink(store, deployment, subscriptions.notify)
