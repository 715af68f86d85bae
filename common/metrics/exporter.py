"""From what a node counts and measures to what Prometheus reads."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from typing import TypeAlias

from prometheus_client import CollectorRegistry, Histogram, ProcessCollector
from prometheus_client.core import CounterMetricFamily, GaugeMetricFamily
from prometheus_client.registry import Collector

from common import __version__
from common.bus import Inbox
from common.metrics import table
from common.metrics.metric import Metric, Sample
from common.metrics.tally import Tally
from common.reactor import AnyMessage, Reactor
from common.topics import topics_of

_Family: TypeAlias = CounterMetricFamily | GaugeMetricFamily
_Value: TypeAlias = tuple[tuple[str, ...], float]


class Exporter(Collector):
    """Metrics of one node, in a registry of its own.

    The worker thread adds; Prometheus's thread collects. Histograms are prometheus_client's, which
    lock. What somebody counts already is copied: the runner's tables when they are collected, the
    reactor's totals once a second (`Reactor.levels`).

    Args:
        reactor: Whose measurements they are.
        node: Its name, the label of everything.
    """

    def __init__(self, reactor: Reactor, *, node: str) -> None:
        self.registry = CollectorRegistry()
        self._reactor = reactor
        self._node = node
        self._inputs = {topic.name: 0 for topic in topics_of(reactor.inputs)}
        self._tally = Tally()
        self._inbox = Inbox()
        self._levels: tuple[Sample, ...] = ()
        self._histograms = {
            metric: _make_histogram(metric, self.registry)
            for metric in table.METRICS
            if metric.kind == "histogram" and metric.belongs_to(reactor.kind)
        }
        self._observe: dict[tuple[Metric, tuple[str, ...]], Callable[[float], None]] = {}
        for metric in self._histograms:
            if not metric.labels:
                self._open(metric, ())
        ProcessCollector(registry=self.registry)
        self.registry.register(self)

    def watch(self, tally: Tally, inbox: Inbox) -> None:
        """Take the runner's own counters from here."""
        self._tally, self._inbox = tally, inbox

    def handled(
        self, given: Sequence[AnyMessage], returned: Sequence[AnyMessage], *, took_ns: int
    ) -> None:
        """Add what one call of `Reactor.handle` has shown.

        Args:
            given: What it was given.
            returned: What it returned.
            took_ns: How long it took [ns]; it has just ended.
        """
        began_ns = time.monotonic_ns() - took_ns
        self._observe[table.HANDLE, ()](took_ns * 1e-9)
        for metric, value, labels in self._reactor.measure(given, returned, began_ns):
            (self._observe.get((metric, labels)) or self._open(metric, labels))(value)

    def note_levels(self) -> None:
        """Ask the reactor for its totals and current values. On the worker thread."""
        self._levels = tuple(self._reactor.levels())

    def collect(self) -> Iterator[_Family]:
        """What is counted elsewhere. On Prometheus's thread."""
        yield self._family(table.NODE_INFO, [((self._reactor.kind, __version__), 1.0)])
        tally, inbox = self._tally, self._inbox
        yield self._by_topic(table.PUBLISHED, tally.published)
        for metric, counts in (
            (table.RECEIVED, tally.received),
            (table.REJECTED, tally.rejected),
            (table.STALE, tally.stale),
            (table.MISSING, tally.missing),
            (table.SUPERSEDED, inbox.superseded_by_topic),
            (table.WAITING, inbox.depths()),
        ):
            # Zeros too: a rate begins with the first message only if there was a 0 before it.
            yield self._by_topic(metric, self._inputs | dict(counts))
        yield self._family(table.WAITING_EVENTS, [((), inbox.waiting_events)])
        levels = self._levels
        for metric in dict.fromkeys(sample.metric for sample in levels):
            yield self._family(
                metric, ((each.labels, each.value) for each in levels if each.metric is metric)
            )

    def _by_topic(self, metric: Metric, counts: Mapping[str, int]) -> _Family:
        # A copy, in one step: the worker thread may add a topic at any time.
        return self._family(metric, (((topic,), n) for topic, n in dict(counts).items()))

    def _family(self, metric: Metric, values: Iterable[_Value]) -> _Family:
        make = CounterMetricFamily if metric.kind == "counter" else GaugeMetricFamily
        family = make(metric.name, metric.help, labels=["node", *metric.labels])
        for labels, value in values:
            family.add_metric([self._node, *labels], value)
        return family

    def _open(self, metric: Metric, labels: tuple[str, ...]) -> Callable[[float], None]:
        observe = self._histograms[metric].labels(self._node, *labels).observe
        self._observe[metric, labels] = observe
        return observe


def _make_histogram(metric: Metric, registry: CollectorRegistry) -> Histogram:
    return Histogram(
        metric.name,
        metric.help,
        ("node", *metric.labels),
        registry=registry,
        buckets=metric.buckets,
    )
