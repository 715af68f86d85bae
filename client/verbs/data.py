"""`legato data view` and `legato data check`."""

from __future__ import annotations

import json
import sys
from pathlib import Path
from typing import Any

from client.commands import DataCheck, DataView
from client.sheet import write_sheet
from client.tables import format_table
from client.video import write_video
from common.datasets import EpisodeInfo, EpisodeStore
from common.datasets.quality import QualityReport, check_quality
from common.errors import InvalidValue
from common.robots import load_robot
from common.robots.menagerie import find_menagerie


def view(command: DataView) -> int:
    """Show the episodes, and draw one of them when asked to."""
    store = EpisodeStore.open(command.folder)
    drawn = _draw(store, command)
    if command.json:
        sys.stdout.write(json.dumps(_to_json(store)) + "\n")
    else:
        sys.stdout.write(_to_text(store) + "\n")
    sys.stderr.write(drawn)
    return 0


def _draw(store: EpisodeStore, command: DataView) -> str:
    """Draw what was asked for; tell where it is."""
    if command.meshes is not None and command.video is None:
        raise InvalidValue("--meshes", str(command.meshes), "--video beside it")
    if command.sheet is None and command.video is None:
        return ""
    if not 0 <= command.episode < len(store):
        raise InvalidValue("--episode", command.episode, f"0 to {len(store) - 1}")
    episode, drawn = store[command.episode], ""
    if command.sheet is not None:
        write_sheet(episode, command.sheet, rate_hz=store.spec.rate_hz)
        drawn += f"sheet: {command.sheet}\n"
    if command.video is not None:
        meshes = _find_meshes(command, store.spec.robot)
        write_video(episode, command.video, spec=store.spec, meshes=meshes)
        drawn += f"video: {command.video}\n"
    return drawn


def _find_meshes(command: DataView, robot: str) -> Path | None:
    """The folder that was asked for; the environment's only for a robot that has meshes."""
    if command.meshes is not None or load_robot(robot).meshes is None:
        return command.meshes
    return find_menagerie()


def check(command: DataCheck) -> int:
    """Check everything and tell what was found."""
    store = EpisodeStore.open(command.folder)
    report = check_quality(store)
    if command.json:
        sys.stdout.write(json.dumps(report.to_json(), allow_nan=False) + "\n")
    else:
        sys.stdout.write(format_report(report) + "\n")
    return 1 if report.problems else 0


def format_report(report: QualityReport) -> str:
    """Statistics, measures and problems as text."""
    columns = [
        (each.column, each.unit, f"{each.least:.4g}", f"{each.mean:.4g}", f"{each.largest:.4g}")
        for each in report.statistics
    ]
    measured = [(name, f"{value:.3g}") for name, value in report.measured.items()]
    lines = [
        format_table(("column", "unit", "least", "mean", "largest"), columns),
        "",
        format_table(("largest of any episode", ""), measured),
        "",
    ]
    if report.not_checked:
        lines.append(f"not checked, for want of columns: {', '.join(report.not_checked)}")
    lines += [f"episode {each.episode}: {each.check}: {each.detail}" for each in report.problems]
    found = f"{len(report.problems)} problems" if report.problems else "no problem"
    lines.append(
        f"{report.episodes} episodes ({report.failures} failed), {report.rows} rows: {found}"
    )
    return "\n".join(lines)


def _to_text(store: EpisodeStore) -> str:
    spec = store.spec
    rows = [_row(number, info, spec.rate_hz) for number, info in enumerate(store.episodes)]
    headers = ("episode", "trial", "seed", "outcome", "rows", "time s", "reason")
    failed = sum(1 for info in store.episodes if info.outcome == "failure")
    total = (
        f"{len(store)} episodes ({failed} failed), {store.rows} rows, "
        f"{store.rows / spec.rate_hz / 60:.1f} min, {store.rows * spec.row_bytes / 1e6:.1f} MB; "
        f"task {spec.task}, robot {spec.robot}, camera {spec.camera.name}, {spec.rate_hz:g} Hz"
    )
    return format_table(headers, rows) + "\n" + total


def _row(number: int, info: EpisodeInfo, rate_hz: float) -> tuple[str, ...]:
    return (
        *(str(number), str(info.trial), str(info.seed), info.outcome, str(info.length)),
        *(f"{info.length / rate_hz:.1f}", str(info.details.get("reason", ""))),
    )


def _to_json(store: EpisodeStore) -> dict[str, Any]:
    return {
        "dataset": store.spec.model_dump(mode="json"),
        "episodes": [info.model_dump(mode="json") for info in store.episodes],
        "rows": store.rows,
        "unfinished": store.unfinished,
    }
