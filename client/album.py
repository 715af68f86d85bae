"""Which pictures a report shows, and pictures as data inside a page."""

from __future__ import annotations

import base64
from dataclasses import dataclass, field

from client.record import EvaluationRecord
from common.api import Trial

BUDGET_BYTES = 8_000_000
"""A report stays small enough to be sent by mail."""

_VIEWS = ("scene", "left", "right")


@dataclass
class Moment:
    """The views of one moment: name of the view -> data URI."""

    name: str
    views: dict[str, str] = field(default_factory=dict[str, str])


@dataclass(frozen=True)
class Strip:
    """The moments of one episode in order."""

    trial: Trial
    moments: list[Moment]


def choose_strips(record: EvaluationRecord, *, budget_bytes: int = BUDGET_BYTES) -> list[Strip]:
    """Pictures of the first trials and of every failed one, as far as the budget goes.

    Trials are taken in this order: trial 0 of every robot, failures, trial 1 of every robot. A
    strip that does not fit is left out, never cut.
    """
    strips: list[Strip] = []
    left = budget_bytes
    for trial in _rank(record.trials):
        strip = _load_strip(record, trial)
        size = sum(len(uri) for moment in strip.moments for uri in moment.views.values())
        if 0 < size <= left:
            strips.append(strip)
            left -= size
    return sorted(strips, key=lambda strip: strip.trial.id)


def may_be_shown(trial: Trial) -> bool:
    """Whether a report with room for it shows the pictures of a trial."""
    return trial.index < 2 or trial.status == "failure"


def _rank(trials: list[Trial]) -> list[Trial]:
    def rank(trial: Trial) -> tuple[int, int]:
        if trial.index == 0:
            return 0, trial.id
        return (1 if trial.status == "failure" else 2), trial.id

    return sorted((t for t in trials if t.pictures and may_be_shown(t)), key=rank)


def _load_strip(record: EvaluationRecord, trial: Trial) -> Strip:
    moments: dict[str, Moment] = {}
    for name in trial.pictures:
        label, _, view = name.rpartition("-")
        if view not in _VIEWS:
            continue
        moment = moments.setdefault(label, Moment(label))
        moment.views[view] = _as_data_uri(record.picture(trial, name))
    for moment in moments.values():
        moment.views = {view: moment.views[view] for view in _VIEWS if view in moment.views}
    return Strip(trial, sorted(moments.values(), key=lambda moment: _order(moment.name)))


def _order(moment: str) -> tuple[int, int, str]:
    """Key moments in the order of time: start, grasp, release, grasp-2, release-2, end."""
    name, _, number = moment.partition("-")
    place = {"start": 0, "end": 2}.get(name, 1)
    return place, int(number) if number.isdecimal() else 1, name


def _as_data_uri(png: bytes) -> str:
    return f"data:image/png;base64,{base64.b64encode(png).decode('ascii')}"
