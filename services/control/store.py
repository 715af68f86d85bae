"""Results in a database: each trial is written as it ends, and a restart goes on from there."""

from __future__ import annotations

import secrets
from collections.abc import Container
from datetime import UTC, datetime

from sqlalchemy import delete, insert, select, update
from sqlalchemy.orm import Session

from common.aborts import Cause, write_reason
from common.api import EvaluationRequest
from services.control.database import Database
from services.control.events import (
    AttemptEnded,
    AttemptStarted,
    EvaluationEnded,
    PictureArrived,
    SubmitEvaluation,
    TrialEnded,
    TrialSpec,
)
from services.control.grid import expand_grid
from services.control.models import AttemptRow, EvaluationRow, PictureRow, TrialRow
from services.control.pictures import encode_png, picture_name
from services.control.scheduler import MAX_ATTEMPTS
from services.control.summary import measurements_of

STOPPED = write_reason(Cause.CONTROL_STOPPED, "control plane stopped during the attempt")

_OPEN = ("pending", "running")


class Store:
    """The writing half of the results of one namespace; `queries` is the reading half.

    Args:
        database: Where they are kept.
        namespace: Deployment; evaluations of other ones are left alone.
    """

    def __init__(self, database: Database, *, namespace: str) -> None:
        self._database = database
        self._namespace = namespace

    def create(
        self, request: EvaluationRequest, *, only: Container[int] | None = None
    ) -> SubmitEvaluation:
        """Write down a new evaluation with its trials, pending.

        Args:
            request: The grid.
            only: Numbers of the trials that belong to it; all of the grid without it.

        Raises:
            InvalidValue: The grid is too large.
        """
        identifier = f"e-{secrets.token_hex(4)}"
        trials = _expand(identifier, request, only)
        with self._database.write() as session:
            while session.get(EvaluationRow, identifier) is not None:
                identifier = f"e-{secrets.token_hex(4)}"
                trials = _expand(identifier, request, only)
            session.add(
                EvaluationRow(
                    id=identifier,
                    namespace=self._namespace,
                    status="running",
                    request=request.model_dump(mode="json", exclude_none=True),
                    versions={},
                    created_at=_now(),
                )
            )
            session.flush()
            session.execute(insert(TrialRow), [_pending_row(trial) for trial in trials])
        return SubmitEvaluation(identifier, request, trials)

    def start_attempt(self, started: AttemptStarted) -> None:
        """Write down that a trial was handed to a cell, and who takes part."""
        trial = started.trial
        with self._database.write() as session:
            evaluation = session.get_one(EvaluationRow, trial.evaluation)
            evaluation.versions = _merge_versions(evaluation.versions, started.versions)
            _trial_row(session, trial).status = "running"
            session.execute(
                delete(PictureRow).where(
                    PictureRow.evaluation == trial.evaluation, PictureRow.trial == trial.id
                )
            )
            session.add(
                AttemptRow(
                    evaluation=trial.evaluation,
                    trial=trial.id,
                    number=started.number,
                    epoch=started.epoch,
                    cell=started.cell,
                    outcome="running",
                    started_at=_now(),
                )
            )

    def end_attempt(self, ended: AttemptEnded) -> None:
        """Write down that an attempt was aborted; its trial is pending again."""
        with self._database.write() as session:
            _close_attempts(session, ended.trial, "aborted", ended.reason)
            _trial_row(session, ended.trial).status = "pending"

    def end_trial(self, ended: TrialEnded) -> None:
        """Write down how a trial ended, together with its attempt."""
        with self._database.write() as session:
            _close_attempts(session, ended.trial, ended.status, ended.reason)
            row = _trial_row(session, ended.trial)
            row.status = ended.status
            row.reason = ended.reason
            row.result = None if ended.result is None else ended.result.model_dump(mode="json")
            for name, value in measurements_of(ended.result).items():
                setattr(row, name, value)

    def add_picture(self, arrived: PictureArrived) -> None:
        """Keep a picture; one of the same name is replaced."""
        png = encode_png(arrived.picture)
        with self._database.write() as session:
            session.merge(
                PictureRow(
                    evaluation=arrived.trial.evaluation,
                    trial=arrived.trial.id,
                    name=picture_name(arrived.picture),
                    png=png,
                )
            )

    def end_evaluation(self, ended: EvaluationEnded) -> None:
        """Write down that an evaluation has ended; what is still open is cancelled."""
        now = _now()
        with self._database.write() as session:
            session.execute(
                update(TrialRow)
                .where(TrialRow.evaluation == ended.evaluation, TrialRow.status.in_(_OPEN))
                .values(status="cancelled")
            )
            session.execute(
                update(AttemptRow)
                .where(AttemptRow.evaluation == ended.evaluation, AttemptRow.outcome == "running")
                .values(outcome="cancelled", finished_at=now)
            )
            row = session.get_one(EvaluationRow, ended.evaluation)
            row.status = ended.status
            row.finished_at = now

    def resume(self) -> list[SubmitEvaluation]:
        """Close what an earlier process left running and give back what remains to be done.

        An attempt that was running is aborted and counts; a trial that has ended stays as it is.
        """
        with self._database.write() as session:
            rows = session.scalars(
                select(EvaluationRow)
                .where(
                    EvaluationRow.namespace == self._namespace, EvaluationRow.status == "running"
                )
                .order_by(EvaluationRow.created_at)
            ).all()
            return [resumed for row in rows if (resumed := _resume_one(session, row)) is not None]


def _expand(
    identifier: str, request: EvaluationRequest, only: Container[int] | None
) -> tuple[TrialSpec, ...]:
    trials = expand_grid(identifier, request)
    return trials if only is None else tuple(trial for trial in trials if trial.id in only)


def _resume_one(session: Session, evaluation: EvaluationRow) -> SubmitEvaluation | None:
    open_rows = session.scalars(
        select(TrialRow)
        .where(TrialRow.evaluation == evaluation.id, TrialRow.status.in_(_OPEN))
        .order_by(TrialRow.id)
    ).all()
    attempts = session.scalars(
        select(AttemptRow).where(AttemptRow.evaluation == evaluation.id)
    ).all()
    spent: dict[int, int] = {}
    for attempt in attempts:
        spent[attempt.trial] = max(spent.get(attempt.trial, 0), attempt.number)
        if attempt.outcome == "running":
            attempt.outcome, attempt.reason, attempt.finished_at = "aborted", STOPPED, _now()
    remaining: list[TrialSpec] = []
    for row in open_rows:
        if spent.get(row.id, 0) >= MAX_ATTEMPTS:
            row.status, row.reason = "aborted", STOPPED
        else:
            row.status = "pending"
            remaining.append(_spec(row, spent.get(row.id, 0)))
    if not remaining:
        evaluation.status, evaluation.finished_at = "done", _now()
        return None
    request = EvaluationRequest.model_validate(evaluation.request)
    return SubmitEvaluation(evaluation.id, request, tuple(remaining))


def _spec(row: TrialRow, spent: int) -> TrialSpec:
    return TrialSpec(
        evaluation=row.evaluation,
        id=row.id,
        index=row.index,
        task=row.task,
        robot=row.robot,
        policy=row.policy,
        seed=row.seed,
        spent=spent,
    )


def _pending_row(trial: TrialSpec) -> dict[str, object]:
    return {
        "evaluation": trial.evaluation,
        "id": trial.id,
        "index": trial.index,
        "task": trial.task,
        "robot": trial.robot,
        "policy": trial.policy,
        "seed": trial.seed,
        "status": "pending",
    }


def _trial_row(session: Session, trial: TrialSpec) -> TrialRow:
    return session.get_one(TrialRow, (trial.evaluation, trial.id))


def _close_attempts(session: Session, trial: TrialSpec, outcome: str, reason: str) -> None:
    session.execute(
        update(AttemptRow)
        .where(
            AttemptRow.evaluation == trial.evaluation,
            AttemptRow.trial == trial.id,
            AttemptRow.outcome == "running",
        )
        .values(outcome=outcome, reason=reason, finished_at=_now())
    )


def _merge_versions(known: dict[str, str], new: dict[str, str]) -> dict[str, str]:
    """Versions by package; where they differ over an evaluation, all of them."""
    merged = dict(known)
    for name, version in new.items():
        seen = merged[name].split(", ") if name in merged else []
        merged[name] = ", ".join(sorted({*seen, *version.split(", ")}))
    return merged


def _now() -> datetime:
    return datetime.now(UTC)
