"""What services measure, and how Prometheus gets it. Importing it imports no Prometheus."""

from __future__ import annotations

from common.metrics.increase import Increase
from common.metrics.metric import Metric, Sample
from common.metrics.settings import MetricsSettings
from common.metrics.table import METRICS
from common.metrics.tally import Tally

__all__ = ["METRICS", "Increase", "Metric", "MetricsSettings", "Sample", "Tally"]
