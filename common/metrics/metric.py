"""What a metric and a sample of it are."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, NamedTuple

Kind = Literal["counter", "gauge", "histogram"]


@dataclass(frozen=True, eq=False)
class Metric:
    """One row of the table of metrics. Compared by identity: each exists once.

    Args:
        name: As Prometheus shows it, with its unit; counters end with `_total`.
        kind: What Prometheus takes it for.
        of: Kinds of node that have it, joined by ", ", or `every`.
        help: What is measured, in one line.
        labels: Labels beside `node`. Their values come from small fixed sets: never an episode.
        buckets: Upper bounds of a histogram, in the unit of the name.
    """

    name: str
    kind: Kind
    of: str
    help: str
    labels: tuple[str, ...] = ()
    buckets: tuple[float, ...] = ()

    def belongs_to(self, kind: str) -> bool:
        """Whether nodes of a kind have it."""
        return self.of == "every" or kind in self.of.split(", ")


class Sample(NamedTuple):
    """One value.

    Args:
        metric: Of what: a histogram in `Reactor.measure`, anything else in `Reactor.levels`.
        value: What was measured, the total of a counter, or the current value of a gauge.
        labels: Values of the metric's labels, in their order.
    """

    metric: Metric
    value: float
    labels: tuple[str, ...] = ()
