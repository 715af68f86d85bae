"""The tables. `SCHEMA_VERSION` rises whenever one of them changes."""

from __future__ import annotations

from datetime import UTC, datetime
from typing import Any

from sqlalchemy import JSON, BigInteger, DateTime, ForeignKey, ForeignKeyConstraint, Index
from sqlalchemy.engine import Dialect
from sqlalchemy.orm import DeclarativeBase, Mapped, mapped_column
from sqlalchemy.types import TypeDecorator

SCHEMA_VERSION = 3


class UtcDateTime(TypeDecorator[datetime]):
    """A moment in UTC. SQLite stores no zone, so it is given back here."""

    impl = DateTime(timezone=True)
    cache_ok = True

    def process_result_value(self, value: datetime | None, dialect: Dialect) -> datetime | None:
        """Say that what was stored is UTC."""
        del dialect
        if value is None or value.tzinfo is not None:
            return value
        return value.replace(tzinfo=UTC)


class Base(DeclarativeBase):
    """Root of the tables."""

    type_annotation_map = {datetime: UtcDateTime, dict[str, Any]: JSON}  # noqa: RUF012


class DatabaseRow(Base):
    """One row: which schema the database has and when it was last opened."""

    __tablename__ = "database"

    id: Mapped[int] = mapped_column(primary_key=True)
    schema_version: Mapped[int]
    opened_at: Mapped[datetime]


class EvaluationRow(Base):
    """An evaluation of one namespace."""

    __tablename__ = "evaluations"
    __table_args__ = (Index("evaluations_by_time", "namespace", "created_at"),)

    id: Mapped[str] = mapped_column(primary_key=True)
    namespace: Mapped[str]
    status: Mapped[str]
    request: Mapped[dict[str, Any]]
    versions: Mapped[dict[str, Any]]
    created_at: Mapped[datetime]
    finished_at: Mapped[datetime | None]


class TrialRow(Base):
    """A trial. What a summary needs stands in columns beside the whole result."""

    __tablename__ = "trials"

    evaluation: Mapped[str] = mapped_column(ForeignKey("evaluations.id"), primary_key=True)
    id: Mapped[int] = mapped_column(primary_key=True, autoincrement=False)
    index: Mapped[int]
    task: Mapped[str]
    robot: Mapped[str]
    policy: Mapped[str]
    seed: Mapped[int] = mapped_column(BigInteger)
    status: Mapped[str]
    reason: Mapped[str] = mapped_column(default="")
    result: Mapped[dict[str, Any] | None]
    grasped: Mapped[bool | None]
    lifted: Mapped[bool | None]
    placed: Mapped[bool | None]
    released: Mapped[bool | None]
    hand_error_median_m: Mapped[float | None]
    hand_error_p95_m: Mapped[float | None]
    hand_scaling_mean: Mapped[float | None]
    hand_scaling_least: Mapped[float | None]
    limited_share: Mapped[float | None]
    solver_failures: Mapped[int | None]
    solve_time_median_s: Mapped[float | None]
    solve_time_p99_s: Mapped[float | None]
    sim_time_s: Mapped[float | None]
    wall_time_s: Mapped[float | None]
    trace_sha256: Mapped[str | None]


class AttemptRow(Base):
    """One try at a trial."""

    __tablename__ = "attempts"
    __table_args__ = (
        ForeignKeyConstraint(["evaluation", "trial"], ["trials.evaluation", "trials.id"]),
    )

    evaluation: Mapped[str] = mapped_column(primary_key=True)
    trial: Mapped[int] = mapped_column(primary_key=True, autoincrement=False)
    number: Mapped[int] = mapped_column(primary_key=True, autoincrement=False)
    epoch: Mapped[int] = mapped_column(BigInteger)
    cell: Mapped[str]
    outcome: Mapped[str]
    reason: Mapped[str] = mapped_column(default="")
    started_at: Mapped[datetime]
    finished_at: Mapped[datetime | None]


class PictureRow(Base):
    """A picture of a trial, as PNG."""

    __tablename__ = "pictures"
    __table_args__ = (
        ForeignKeyConstraint(["evaluation", "trial"], ["trials.evaluation", "trials.id"]),
    )

    evaluation: Mapped[str] = mapped_column(primary_key=True)
    trial: Mapped[int] = mapped_column(primary_key=True, autoincrement=False)
    name: Mapped[str] = mapped_column(primary_key=True)
    png: Mapped[bytes]
