"""The reading half of the results: rows as the resources of REST."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterable, Sequence
from dataclasses import fields
from typing import Literal, TypeAlias, cast

from sqlalchemy import select
from sqlalchemy.orm import Session

from common.api import (
    PREFIX,
    Attempt,
    Evaluation,
    EvaluationRequest,
    EvaluationStatus,
    Trial,
    TrialStatus,
)
from common.errors import NotFound
from common.messages import TrialResult
from services.control.database import Database
from services.control.models import AttemptRow, EvaluationRow, PictureRow, TrialRow
from services.control.summary import TrialFacts, summarise

AttemptOutcome: TypeAlias = Literal["running", "success", "failure", "aborted", "cancelled"]

_FACTS = tuple(getattr(TrialRow, field.name) for field in fields(TrialFacts))


class Queries:
    """Reads the evaluations of one namespace.

    Args:
        database: Where they are kept.
        namespace: Deployment.
    """

    def __init__(self, database: Database, *, namespace: str) -> None:
        self._database = database
        self._namespace = namespace

    def evaluation(self, identifier: str, *, waiting_for: Sequence[str] = ()) -> Evaluation:
        """One evaluation as it is now.

        Args:
            identifier: Its id.
            waiting_for: What it waits for, which only the scheduler knows.

        Raises:
            NotFound: There is none of that id.
        """
        with self._database.read() as session:
            return _evaluation(session, self._row(session, identifier), waiting_for)

    def evaluations(
        self, waiting_for: dict[str, tuple[str, ...]], *, limit: int, offset: int = 0
    ) -> list[Evaluation]:
        """Evaluations, newest first."""
        with self._database.read() as session:
            rows = session.scalars(
                select(EvaluationRow)
                .where(EvaluationRow.namespace == self._namespace)
                .order_by(EvaluationRow.created_at.desc(), EvaluationRow.id)
                .limit(limit)
                .offset(offset)
            ).all()
            return [_evaluation(session, row, waiting_for.get(row.id, ())) for row in rows]

    def trials(self, evaluation: str) -> list[Trial]:
        """All trials of an evaluation, in order.

        Raises:
            NotFound: There is no such evaluation.
        """
        with self._database.read() as session:
            self._row(session, evaluation)
            return _trials(session, evaluation)

    def trial(self, evaluation: str, trial: int) -> Trial:
        """One trial.

        Raises:
            NotFound: There is no such evaluation or trial.
        """
        with self._database.read() as session:
            self._row(session, evaluation)
            found = _trials(session, evaluation, trial)
        if not found:
            raise NotFound("trial", f"{evaluation}/{trial}", listed_at=_trials_path(evaluation))
        return found[0]

    def picture(self, evaluation: str, trial: int, name: str) -> bytes:
        """A picture as PNG.

        Raises:
            NotFound: There is no such evaluation, trial or picture.
        """
        with self._database.read() as session:
            self._row(session, evaluation)
            row = session.get(PictureRow, (evaluation, trial, name))
            if row is None:
                identifier = f"{evaluation}/{trial}/{name}"
                raise NotFound("picture", identifier, listed_at=_trials_path(evaluation))
            return row.png

    def _row(self, session: Session, identifier: str) -> EvaluationRow:
        row = session.get(EvaluationRow, identifier)
        if row is None or row.namespace != self._namespace:
            raise NotFound("evaluation", identifier)
        return row


def _trials_path(evaluation: str) -> str:
    return f"{PREFIX}/evaluations/{evaluation}/trials"


def _evaluation(session: Session, row: EvaluationRow, waiting_for: Sequence[str]) -> Evaluation:
    request = EvaluationRequest.model_validate(row.request)
    facts = [
        TrialFacts(*values)
        for values in session.execute(select(*_FACTS).where(TrialRow.evaluation == row.id))
    ]
    cells = summarise(request, facts)
    return Evaluation(
        id=row.id,
        status=cast(EvaluationStatus, row.status),
        request=request,
        created_at=row.created_at,
        finished_at=row.finished_at,
        trials_total=len(facts),
        trials_done=sum(cell.done for cell in cells),
        waiting_for=list(waiting_for) if row.status == "running" else [],
        cells=cells,
        versions=row.versions,
    )


def _trials(session: Session, evaluation: str, trial: int | None = None) -> list[Trial]:
    """Trials with their attempts and pictures: three queries, however many trials."""
    trials = select(TrialRow).where(TrialRow.evaluation == evaluation)
    attempts = select(AttemptRow).where(AttemptRow.evaluation == evaluation)
    pictures = select(PictureRow.trial, PictureRow.name).where(PictureRow.evaluation == evaluation)
    if trial is not None:
        trials = trials.where(TrialRow.id == trial)
        attempts = attempts.where(AttemptRow.trial == trial)
        pictures = pictures.where(PictureRow.trial == trial)
    attempts_of: defaultdict[int, list[AttemptRow]] = defaultdict(list)
    for row in session.scalars(attempts.order_by(AttemptRow.number)):
        attempts_of[row.trial].append(row)
    names_of: defaultdict[int, list[str]] = defaultdict(list)
    for number, name in session.execute(pictures.order_by(PictureRow.name)):
        names_of[number].append(name)
    rows = session.scalars(trials.order_by(TrialRow.id))
    return [_trial(row, attempts_of[row.id], names_of[row.id]) for row in rows]


def _trial(row: TrialRow, attempts: Iterable[AttemptRow], pictures: list[str]) -> Trial:
    return Trial(
        id=row.id,
        evaluation=row.evaluation,
        index=row.index,
        task=row.task,
        robot=row.robot,
        policy=row.policy,
        seed=row.seed,
        status=cast(TrialStatus, row.status),
        reason=row.reason,
        attempts=[_attempt(attempt) for attempt in attempts],
        result=None if row.result is None else TrialResult.model_validate(row.result),
        pictures=pictures,
    )


def _attempt(row: AttemptRow) -> Attempt:
    return Attempt(
        number=row.number,
        epoch=row.epoch,
        cell=row.cell,
        outcome=cast(AttemptOutcome, row.outcome),
        reason=row.reason,
        started_at=row.started_at,
        finished_at=row.finished_at,
    )
