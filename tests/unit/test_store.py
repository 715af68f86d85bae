"""The store: transactions, restarts, refusals."""

from __future__ import annotations

import io
import sqlite3
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor

import pytest
from PIL import Image
from sqlalchemy import create_engine, text
from sqlalchemy.dialects import postgresql
from sqlalchemy.schema import CreateTable

from common.api import EvaluationRequest, StageCounts
from common.errors import InvalidValue, NotFound, NotWritable, StoreError
from common.messages import EpisodePicture, Header
from services.control.database import Database, database_url
from services.control.events import (
    AttemptEnded,
    AttemptStarted,
    EvaluationEnded,
    PictureArrived,
    TrialEnded,
)
from services.control.models import Base
from services.control.queries import Queries
from services.control.store import STOPPED, Store
from tests.control_nodes import make_picture, make_result


class Opened:
    """Store and queries on one database, to be closed and opened again."""

    def __init__(self, url: str, *, namespace: str = "legato") -> None:
        self.database = Database(url)
        self.store = Store(self.database, namespace=namespace)
        self.queries = Queries(self.database, namespace=namespace)

    def close(self):
        self.database.close()

    def begin(self, trial, *, number=None, versions=None):
        number = number or trial.spent + 1
        self.store.start_attempt(
            AttemptStarted(trial, number, 1000 + number, "sim-0", versions or {"legato": "0.1.0"})
        )

    def finish(self, trial, status="success"):
        self.begin(trial)
        result = make_result(status, "because", seed=trial.seed)
        self.store.end_trial(TrialEnded(trial, status, "because", result))


@pytest.fixture
def url(tmp_path):
    return database_url(tmp_path / "runs")


@pytest.fixture
def opened(url):
    opened = Opened(url)
    yield opened
    opened.close()


def make_request(**fields):
    fields = {"tasks": ["lid"], "robots": ["panda", "spot"], "policy": "expert"} | fields
    return EvaluationRequest(**({"trials": 2} | fields))


def test_new_evaluation_has_all_its_trials_pending(opened):
    request = make_request()
    submitted = opened.store.create(request)
    evaluation = opened.queries.evaluation(submitted.evaluation, waiting_for=["sim"])
    assert evaluation.request == request
    assert (evaluation.status, evaluation.trials_total, evaluation.trials_done) == ("running", 4, 0)
    assert evaluation.waiting_for == ["sim"]
    assert [cell.interval95 for cell in evaluation.cells] == [(0.0, 1.0)] * 2
    trials = opened.queries.trials(submitted.evaluation)
    assert [(t.id, t.index, t.robot, t.status) for t in trials] == [
        (0, 0, "panda", "pending"),
        (1, 0, "spot", "pending"),
        (2, 1, "panda", "pending"),
        (3, 1, "spot", "pending"),
    ]


def test_ended_trial_has_result_attempt_and_summary(opened):
    submitted = opened.store.create(make_request())
    first, second = submitted.trials[0], submitted.trials[2]
    opened.finish(first)
    opened.finish(second, "failure")
    trial = opened.queries.trial(submitted.evaluation, first.id)
    assert trial.result == make_result("success", "because", seed=first.seed)
    assert [(a.number, a.outcome, a.cell) for a in trial.attempts] == [(1, "success", "sim-0")]
    assert trial.attempts[0].finished_at >= trial.attempts[0].started_at
    panda, spot = opened.queries.evaluation(submitted.evaluation).cells
    assert (panda.done, panda.successes, panda.failures, panda.success_rate) == (2, 1, 1, 0.5)
    assert panda.trace_sha256 == [f"{t.seed:064x}" for t in (first, second)]
    assert panda.real_time_factor == pytest.approx(10.0)
    assert panda.stages == StageCounts(grasped=2, lifted=2, placed=2, released=2)
    assert (spot.done, spot.trace_sha256) == (0, [None, None])


def test_aborted_attempt_leaves_the_trial_pending(opened):
    submitted = opened.store.create(make_request())
    trial = submitted.trials[0]
    opened.begin(trial)
    opened.store.end_attempt(AttemptEnded(trial, 1, "policy left"))
    read = opened.queries.trial(submitted.evaluation, trial.id)
    assert read.status == "pending"
    assert [(a.outcome, a.reason) for a in read.attempts] == [("aborted", "policy left")]


def test_restart_repeats_nothing_and_counts_the_broken_attempt(url):
    opened = Opened(url)
    submitted = opened.store.create(make_request(robots=["panda"], trials=4))
    done, broken, twice, waiting = submitted.trials
    opened.finish(done)
    opened.begin(broken)
    opened.begin(twice)
    opened.store.end_attempt(AttemptEnded(twice, 1, "policy left"))
    opened.begin(twice, number=2)
    opened.close()

    opened = Opened(url)
    (resumed,) = opened.store.resume()
    assert resumed.request == submitted.request
    assert [(t.id, t.spent) for t in resumed.trials] == [(broken.id, 1), (waiting.id, 0)]
    assert resumed.trials[1] == waiting
    statuses = {t.id: t for t in opened.queries.trials(submitted.evaluation)}
    assert [statuses[t.id].status for t in submitted.trials] == [
        "success",
        "pending",
        "aborted",
        "pending",
    ]
    assert statuses[twice.id].reason == STOPPED
    assert statuses[broken.id].attempts[0].reason == STOPPED
    opened.close()


def test_restart_after_the_last_trial_closes_the_evaluation(url):
    opened = Opened(url)
    submitted = opened.store.create(make_request(robots=["panda"], trials=1))
    opened.finish(submitted.trials[0])
    opened.close()
    opened = Opened(url)
    assert opened.store.resume() == []
    evaluation = opened.queries.evaluation(submitted.evaluation)
    assert evaluation.status == "done"
    assert evaluation.finished_at >= evaluation.created_at
    opened.close()


def test_restart_leaves_ended_evaluations_and_other_namespaces_alone(url):
    opened, other = Opened(url), Opened(url, namespace="other")
    cancelled = opened.store.create(make_request()).evaluation
    opened.store.end_evaluation(EvaluationEnded(cancelled, "cancelled"))
    foreign = other.store.create(make_request()).evaluation
    assert opened.store.resume() == []
    with pytest.raises(NotFound):
        opened.queries.evaluation(foreign)
    assert [e.id for e in opened.queries.evaluations({}, limit=10)] == [cancelled]
    opened.close()
    other.close()


def test_cancelled_evaluation_keeps_what_had_ended(opened):
    submitted = opened.store.create(make_request())
    opened.finish(submitted.trials[0])
    opened.begin(submitted.trials[1])
    opened.store.end_evaluation(EvaluationEnded(submitted.evaluation, "cancelled"))
    trials = opened.queries.trials(submitted.evaluation)
    assert [t.status for t in trials] == ["success", "cancelled", "cancelled", "cancelled"]
    assert trials[1].attempts[0].outcome == "cancelled"
    assert opened.queries.evaluation(submitted.evaluation).finished_at is not None


def test_newest_evaluation_comes_first_and_pages(opened):
    made = [opened.store.create(make_request()).evaluation for _ in range(3)]
    listed = opened.queries.evaluations({made[2]: ("sim",)}, limit=2)
    assert [e.id for e in listed] == [made[2], made[1]]
    assert listed[0].waiting_for == ["sim"]
    assert [e.id for e in opened.queries.evaluations({}, limit=2, offset=2)] == [made[0]]


def test_versions_of_all_attempts_are_kept(opened):
    submitted = opened.store.create(make_request())
    opened.begin(submitted.trials[0], versions={"legato": "0.1.0", "numpy": "2.0"})
    opened.begin(submitted.trials[1], versions={"legato": "0.1.0", "numpy": "2.1", "pin": "4"})
    versions = opened.queries.evaluation(submitted.evaluation).versions
    assert versions == {"legato": "0.1.0", "numpy": "2.0, 2.1", "pin": "4"}


def test_picture_is_png_replaced_by_name_and_dropped_on_retry(opened):
    submitted = opened.store.create(make_request())
    trial = submitted.trials[0]
    opened.begin(trial)
    for value in (10, 200):
        picture = EpisodePicture(
            header=Header(), moment="end", view="left", width=3, height=2, channels=1,
            pixels=bytes([value] * 6),
        )  # fmt: skip
        opened.store.add_picture(PictureArrived(trial, picture))
    assert opened.queries.trial(submitted.evaluation, trial.id).pictures == ["end-left"]
    png = opened.queries.picture(submitted.evaluation, trial.id, "end-left")
    image = Image.open(io.BytesIO(png))
    assert (image.size, image.getpixel((2, 1))) == ((3, 2), 200)
    opened.begin(trial, number=2)
    assert opened.queries.trial(submitted.evaluation, trial.id).pictures == []


def test_colour_picture_keeps_its_channels(opened):
    submitted = opened.store.create(make_request())
    picture = make_picture(Header()).model_copy(update={"pixels": bytes([1, 2, 3] * 8)})
    opened.store.add_picture(PictureArrived(submitted.trials[0], picture))
    png = opened.queries.picture(submitted.evaluation, 0, "end-scene")
    assert Image.open(io.BytesIO(png)).getpixel((3, 1)) == (1, 2, 3)


@pytest.mark.parametrize("what", ["evaluation", "trial", "picture"])
def test_unknown_things_are_not_found(opened, what):
    known = opened.store.create(make_request()).evaluation
    read = {
        "evaluation": lambda: opened.queries.evaluation("e-none"),
        "trial": lambda: opened.queries.trial(known, 99),
        "picture": lambda: opened.queries.picture(known, 0, "end-scene"),
    }[what]
    with pytest.raises(NotFound, match=f"no {what}"):
        read()


def test_failed_write_leaves_nothing_half_written(opened):
    submitted = opened.store.create(make_request())

    def fail():
        with opened.database.write() as session:
            session.execute(text("UPDATE trials SET status = 'success'"))
            raise RuntimeError

    with pytest.raises(RuntimeError):
        fail()
    assert {t.status for t in opened.queries.trials(submitted.evaluation)} == {"pending"}


def test_grid_that_is_too_large_is_refused_and_not_written(opened):
    with pytest.raises(InvalidValue, match="at most 50000"):
        opened.store.create(make_request(trials=50_001))
    assert opened.queries.evaluations({}, limit=10) == []


def test_file_is_in_wal_mode(opened, tmp_path):
    opened.store.create(make_request())
    connection = sqlite3.connect(tmp_path / "runs" / "legato.db")
    assert connection.execute("PRAGMA journal_mode").fetchone() == ("wal",)
    connection.close()


def test_folder_that_cannot_be_made_is_refused(tmp_path):
    (tmp_path / "file").write_text("")
    with pytest.raises(NotWritable, match="file/runs"):
        database_url(tmp_path / "file" / "runs")


def test_path_that_cannot_be_opened_is_refused(tmp_path):
    (tmp_path / "legato.db").mkdir()
    with pytest.raises(NotWritable, match=r"legato\.db"):
        Database(database_url(tmp_path))


def test_file_that_is_no_database_is_refused_and_kept(tmp_path):
    path = tmp_path / "legato.db"
    path.write_bytes(b"something else entirely, and long enough to be read" * 10)
    before = path.read_bytes()
    with pytest.raises(NotWritable, match="not a database"):
        Database(database_url(tmp_path))
    assert path.read_bytes() == before


def test_read_only_database_is_refused(url, tmp_path):
    Opened(url).close()
    path = tmp_path / "runs" / "legato.db"
    with pytest.raises(NotWritable, match="readonly"):
        Database(f"sqlite:///file:{path}?mode=ro&uri=true")


def test_database_of_another_version_is_refused_and_kept(url):
    Opened(url).close()
    engine = create_engine(url)
    with engine.begin() as connection:
        connection.execute(text('UPDATE "database" SET schema_version = 99'))
        connection.execute(text("DROP TABLE pictures"))
    with pytest.raises(StoreError, match="schema version 99; expected version 3"):
        Database(url)
    with engine.begin() as connection:
        tables = connection.execute(text("SELECT name FROM sqlite_master WHERE name = 'pictures'"))
        assert tables.all() == []
    engine.dispose()


@pytest.mark.parametrize("bad", ["no url", "nosuchthing://host/db"])
def test_url_without_a_driver_is_refused(bad):
    with pytest.raises(InvalidValue, match="--database"):
        Database(bad)


def test_password_never_shows():
    with pytest.raises(InvalidValue) as caught:
        Database("nosuchthing://user:secret@host/db")
    assert "secret" not in str(caught.value)


def test_tables_are_not_bound_to_sqlite():
    for table in Base.metadata.sorted_tables:
        assert "CREATE TABLE" in str(CreateTable(table).compile(dialect=postgresql.dialect()))


def test_in_memory_database_serves_all_threads():
    opened = Opened("sqlite://")
    trials = opened.store.create(make_request(trials=20)).trials
    with ThreadPoolExecutor(4) as pool:
        list(pool.map(opened.finish, trials))
        read = list(pool.map(opened.queries.evaluation, [trials[0].evaluation] * 8))
    assert {evaluation.trials_done for evaluation in read} == {40}
    opened.close()


def test_threads_write_to_one_file(opened):
    trials = opened.store.create(make_request(trials=20)).trials
    with ThreadPoolExecutor(4) as pool:
        list(pool.map(opened.finish, trials))
    assert opened.queries.evaluation(trials[0].evaluation).trials_done == 40


def test_offline_use_needs_no_web_framework():
    modules = "scheduler, store, queries, sink, deployment"
    code = f"from services.control import {modules}; import sys; sys.exit('fastapi' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", code]).returncode == 0
