"""Reading an endpoint as Prometheus does."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import httpx
from prometheus_client.parser import text_string_to_metric_families
from prometheus_client.samples import Sample as Series

from common.metrics import Metric


@dataclass(frozen=True)
class Scrape:
    """All series of one process at one moment."""

    series: tuple[Series, ...]

    def value(self, metric: Metric, **labels: str) -> float:
        """Value of the one series of a counter or gauge that has these labels."""
        return self.raw(metric.name, **labels)

    def count(self, metric: Metric, **labels: str) -> float:
        """How many samples a histogram has."""
        return self.raw(f"{metric.name}_count", **labels)

    def raw(self, name: str, **labels: str) -> float:
        """Value of the one series of that name and these labels."""
        found = [
            each.value
            for each in self.series
            if each.name == name and labels.items() <= each.labels.items()
        ]
        assert len(found) == 1, (name, labels, found)
        return found[0]

    def each(self, metric: Metric) -> Iterator[tuple[dict[str, str], float]]:
        """Labels and value of every series of a counter or gauge."""
        return ((each.labels, each.value) for each in self.series if each.name == metric.name)

    def labels(self, prefix: str) -> Iterator[dict[str, str]]:
        """Labels of every series whose name begins so."""
        return (each.labels for each in self.series if each.name.startswith(prefix))

    @property
    def names(self) -> set[str]:
        """Names of all series."""
        return {each.name for each in self.series}


def scrape(port: int) -> Scrape:
    """Ask a process of this machine."""
    text = httpx.get(f"http://127.0.0.1:{port}/metrics", timeout=20.0).raise_for_status().text
    families = text_string_to_metric_families(text)
    return Scrape(tuple(each for family in families for each in family.samples))
