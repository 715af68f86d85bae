"""One HTML file with the results of an evaluation: no script, no request, pictures inside."""

from __future__ import annotations

from collections.abc import Iterator
from html import escape
from importlib.resources import files
from pathlib import Path
from string import Template

from client.album import Strip, choose_strips
from client.record import (
    EvaluationRecord,
    as_factor,
    count_stages,
    describe_stages,
    describe_success,
    in_mm,
    in_ms,
    in_percent,
)
from common.api import CellSummary, Evaluation, EvaluationRequest, Trial
from common.errors import NotWritable
from common.messages import STAGES

MOST_OPEN_ROWS = 20
"""A longer table of hashes is folded."""


def write_report(record: EvaluationRecord, path: Path, *, command: str) -> None:
    """Write the report of an evaluation.

    Args:
        record: The evaluation, its trials and pictures.
        path: File to write; its folder must exist.
        command: The command line that made the results.

    Raises:
        NotWritable: The file cannot be written.
    """
    text = render_report(record, command=command)
    try:
        path.write_text(text, encoding="utf-8")
    except OSError as error:
        raise NotWritable(str(path), error.strerror or str(error)) from error


def render_report(record: EvaluationRecord, *, command: str) -> str:
    """The report as HTML."""
    evaluation = record.evaluation
    parts = (
        _summary(evaluation, command),
        _results(evaluation),
        _retargeting(evaluation),
        _pictures(choose_strips(record)),
        _failures(record.trials),
        _aborted(record.trials),
        _traces(evaluation),
        _versions(evaluation),
    )
    frame = Template(files("client").joinpath("report.html").read_text(encoding="utf-8"))
    return frame.substitute(
        title=escape(f"LEGATO evaluation {evaluation.id}"),
        body="\n".join(line for part in parts for line in part),
    )


def _summary(evaluation: Evaluation, command: str) -> Iterator[str]:
    request = evaluation.request
    facts = {
        "Command": f"<code>{escape(command)}</code>",
        "Date": escape(f"{evaluation.created_at:%Y-%m-%d %H:%M} UTC"),
        "Seed": str(request.seed),
        "Mode": escape(request.mode),
        "Camera": escape(_describe_camera(request)),
        "Action latency": f"{1e3 * request.action_latency_s:g} ms",
        "Tracking lag": f"{1e3 * request.tracking_lag_s:g} ms",
        "Status": f"{escape(evaluation.status)}, {evaluation.trials_done} of "
        f"{evaluation.trials_total} trials ended",
    }
    yield "<dl>"
    for name, value in facts.items():
        yield f"<div><dt>{name}</dt><dd>{value}</dd></div>"
    yield "</dl>"


def _describe_camera(request: EvaluationRequest) -> str:
    parts = [request.camera]
    if request.full_grid:
        parts.append("every pixel traced")
    if request.randomise_camera:
        parts.append("randomised")
    return ", ".join(parts)


def _results(evaluation: Evaluation) -> Iterator[str]:
    yield "<h2>Results</h2>"
    yield from _table(
        (
            *("Task", "Robot", "Policy", "Success", "Rate, 95 % interval", "Failed", "Aborted"),
            " / ".join(STAGES).capitalize(),
            *("Hand error, median [mm]", "p95 [mm]", "Real-time factor"),
        ),
        [_result_row(cell) for cell in evaluation.cells],
    )
    yield (
        '<p class="note">Trial <var>i</var> has the same scene for every robot and policy. '
        "The interval is Wilson's. An aborted trial counts as not successful. "
        "Stages count the trials that came so far: touched with the grasp closed for 0.2 s, 20 mm "
        "above the start, all objects as the success test wants them at one moment, all of the "
        "success test held at one moment; success takes 0.5 s of it. "
        "The hand error is the distance between where the gripper should be and where it is; "
        "the table shows medians over trials of each trial's median and 95th percentile.</p>"
    )


def _result_row(cell: CellSummary) -> tuple[str, ...]:
    low, high = cell.interval95
    rate = 0.0 if cell.success_rate is None else cell.success_rate
    bar = (
        '<span class="bar" aria-hidden="true">'
        f'<i class="rate" style="width:{100 * rate:.1f}%"></i>'
        f'<i class="range" style="left:{100 * low:.1f}%;width:{100 * (high - low):.1f}%"></i>'
        "</span>"
    )
    return (
        *(escape(cell.task), f"<b>{escape(cell.robot)}</b>", escape(cell.policy)),
        f"{cell.successes}/{cell.trials}",
        bar + escape(describe_success(cell)),
        *(str(cell.failures), str(cell.aborted), count_stages(cell.stages)),
        *(in_mm(cell.median_hand_error_m), in_mm(cell.p95_hand_error_m)),
        escape(as_factor(cell.real_time_factor)),
    )


def _retargeting(evaluation: Evaluation) -> Iterator[str]:
    yield "<h2>Retargeting</h2>"
    yield from _table(
        (
            *("Task", "Robot", "Policy", "Hand task achieved, mean [%]", "least [%]"),
            *("Ticks at a limit [%]", "Fallbacks", "Solve time, median [ms]", "p99 [ms]"),
        ),
        [_retargeting_row(cell) for cell in evaluation.cells],
    )
    yield (
        '<p class="note">The hand task is the motion that keeps the gripper on its reference; '
        "limits of joints, walls and collisions may leave only a share of it. A fallback is a tick "
        "whose program was not solved: the robot then does less than it could.</p>"
    )


def _retargeting_row(cell: CellSummary) -> tuple[str, ...]:
    return (
        *(escape(cell.task), f"<b>{escape(cell.robot)}</b>", escape(cell.policy)),
        *(in_percent(cell.mean_hand_scaling), in_percent(cell.least_hand_scaling)),
        *(in_percent(cell.limited_share), str(cell.solver_failures)),
        *(in_ms(cell.median_solve_time_s), in_ms(cell.p99_solve_time_s)),
    )


def _pictures(strips: list[Strip]) -> Iterator[str]:
    if not strips:
        return
    yield "<h2>Episodes</h2>"
    yield (
        '<p class="note">Scene and the two eyes of the gripper\'s camera at key moments: '
        "the first trials of every robot, and those that failed.</p>"
    )
    for strip in strips:
        trial = strip.trial
        reason = f" – {escape(trial.reason)}" if trial.reason else ""
        yield (
            f'<section class="episode"><h3>{escape(trial.robot)} '
            f"<small>{escape(trial.task)}, {escape(trial.policy)}, trial {trial.index}, "
            f'<span class="{trial.status}">{trial.status}</span>{reason}</small></h3>'
            '<div class="strip">'
        )
        for moment in strip.moments:
            views = "".join(
                f'<img class="{view}" alt="{escape(view)} view at {escape(moment.name)}" '
                f'src="{source}">'
                for view, source in moment.views.items()
            )
            yield f"<figure>{views}<figcaption>{escape(moment.name)}</figcaption></figure>"
        yield "</div></section>"


def _failures(trials: list[Trial]) -> Iterator[str]:
    failed = [trial for trial in trials if trial.status in ("failure", "aborted")]
    yield "<h2>Failures</h2>"
    if not failed:
        yield "<p>None.</p>"
        return
    rows: list[tuple[str, ...]] = []
    for trial in failed:
        conditions = trial.result.failed_conditions if trial.result else []
        time_s = f"{trial.result.sim_time_s:.1f}" if trial.result else "-"
        rows.append(
            (
                *(escape(trial.task), f"<b>{escape(trial.robot)}</b>", escape(trial.policy)),
                *(str(trial.index), str(trial.seed)),
                f'<span class="{trial.status}">{trial.status}</span>',
                *(time_s, describe_stages(trial.stages)),
                *(escape(trial.reason), escape("; ".join(conditions)) or "-"),
            )
        )
    yield from _table(
        (
            *("Task", "Robot", "Policy", "Trial", "Seed", "Outcome", "Simulated time [s]"),
            *("Reached", "Reason", "Failed conditions"),
        ),
        rows,
    )


def _aborted(trials: list[Trial]) -> Iterator[str]:
    rows = [
        (
            *(escape(trial.task), f"<b>{escape(trial.robot)}</b>", escape(trial.policy)),
            *(str(trial.index), str(attempt.number), escape(attempt.cell), escape(attempt.reason)),
        )
        for trial in trials
        for attempt in trial.attempts
        if attempt.outcome == "aborted"
    ]
    if rows:
        yield "<h2>Aborted attempts</h2>"
        yield from _table(("Task", "Robot", "Policy", "Trial", "Attempt", "Cell", "Reason"), rows)


def _traces(evaluation: Evaluation) -> Iterator[str]:
    yield "<h2>Traces</h2>"
    yield (
        '<p class="note">SHA-256 of every trial\'s trace. In lockstep, equal seeds and versions '
        "give equal hashes.</p>"
    )
    rows = [
        (
            *(escape(cell.task), f"<b>{escape(cell.robot)}</b>", escape(cell.policy), str(index)),
            f"<code>{escape(sha256)}</code>" if sha256 else "-",
        )
        for cell in evaluation.cells
        for index, sha256 in enumerate(cell.trace_sha256)
    ]
    shown = " open" if len(rows) <= MOST_OPEN_ROWS else ""
    yield f"<details{shown}><summary>{len(rows)} hashes</summary>"
    yield from _table(("Task", "Robot", "Policy", "Trial", "SHA-256"), rows)
    yield "</details>"


def _versions(evaluation: Evaluation) -> Iterator[str]:
    yield "<h2>Versions</h2>"
    rows = [(escape(name), escape(version)) for name, version in evaluation.versions.items()]
    yield from _table(("Package", "Version"), rows)


def _table(headers: tuple[str, ...], rows: list[tuple[str, ...]]) -> Iterator[str]:
    """A table; the cells are HTML already."""
    yield '<div class="scroll"><table><thead><tr>'
    yield "".join(f"<th>{escape(header)}</th>" for header in headers)
    yield "</tr></thead><tbody>"
    for row in rows:
        yield "<tr>" + "".join(f"<td>{cell}</td>" for cell in row) + "</tr>"
    yield "</tbody></table></div>"
