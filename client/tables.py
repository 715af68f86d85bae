"""Results and services as plain text tables."""

from __future__ import annotations

from collections.abc import Sequence

from client.record import as_factor, count_stages, describe_success, in_mm
from common.api import CellInfo, Evaluation, ServiceInfo
from common.messages import STAGES


def format_table(headers: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """Columns of equal width, two blanks apart, a rule under the headers."""
    table = [list(headers), *(list(row) for row in rows)]
    widths = [max(len(row[column]) for row in table) for column in range(len(headers))]
    table.insert(1, ["-" * width for width in widths])
    lines = ("  ".join(cell.ljust(w) for cell, w in zip(row, widths, strict=True)) for row in table)
    return "\n".join(line.rstrip() for line in lines)


def format_results(evaluation: Evaluation) -> str:
    """One row per task, robot and policy."""
    return format_table(
        (
            *("task", "robot", "policy", "success", "rate [95 %]", "failed", "aborted"),
            "/".join(STAGES),
            *("hand error median mm", "p95 mm", "real time"),
        ),
        [
            (
                *(cell.task, cell.robot, cell.policy, f"{cell.successes}/{cell.trials}"),
                *(describe_success(cell), str(cell.failures), str(cell.aborted)),
                count_stages(cell.stages),
                *(in_mm(cell.median_hand_error_m), in_mm(cell.p95_hand_error_m)),
                as_factor(cell.real_time_factor),
            )
            for cell in evaluation.cells
        ],
    )


def format_cells(cells: Sequence[CellInfo]) -> str:
    """One row per cell."""
    return format_table(
        ("cell", "alive", "robot", "emergency stop", "fault"),
        [
            (
                *(cell.cell, "yes" if cell.alive else "NO", cell.status or "unknown"),
                "YES" if cell.emergency_stop else "no",
                f"{cell.fault.happened} ({cell.fault.code})" if cell.fault else "-",
            )
            for cell in cells
        ],
    )


def format_services(services: Sequence[ServiceInfo]) -> str:
    """One row per node."""
    return format_table(
        ("kind", "node", "alive", "version", "host", "pid", "offers", "metrics"),
        [
            (
                *(service.kind, service.node, "yes" if service.alive else "NO"),
                *(service.code_version or "-", service.host or "-", str(service.pid or "-")),
                " ".join(f"{key}={','.join(names)}" for key, names in service.offers.items()),
                " ".join(f"{key}={value:.3g}" for key, value in service.metrics.items()),
            )
            for service in sorted(services, key=lambda service: (service.kind, service.node))
        ],
    )
