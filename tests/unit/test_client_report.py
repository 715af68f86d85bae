from __future__ import annotations

import re
from html.parser import HTMLParser

import pytest

from client.album import choose_strips
from client.record import EvaluationRecord, describe_success, to_json
from client.report import render_report, write_report
from client.tables import format_results, format_services, format_table
from common.errors import NotWritable
from common.messages import StagesReached
from tests.client_samples import (
    PNG,
    SHA,
    make_attempt,
    make_cell,
    make_evaluation,
    make_service,
    make_trial,
)

PICTURES = ["end-scene", "grasp-2-scene", "grasp-left", "grasp-right", "grasp-scene", "start-scene"]


def make_record(trials=None, **evaluation) -> EvaluationRecord:
    if trials is None:
        trials = [
            make_trial(0, robot="abstract", pictures=PICTURES),
            make_trial(1, status="failure", pictures=PICTURES),
            make_trial(2, robot="abstract", index=1, status="aborted", attempts=[make_attempt()]),
        ]
    return EvaluationRecord(make_evaluation(**evaluation), trials, lambda *_: PNG)


class Page(HTMLParser):
    """Notes the tags of a page and refuses tags that are not closed in order."""

    VOID = frozenset({"meta", "img"})

    def __init__(self, text: str) -> None:
        super().__init__()
        self.tags, self.attributes, self._open = [], [], []
        self.feed(text)
        assert self._open == []

    def handle_starttag(self, tag, attributes):
        self.tags.append(tag)
        self.attributes += attributes
        if tag not in self.VOID:
            self._open.append(tag)

    def handle_endtag(self, tag):
        assert self._open.pop() == tag


def test_report_is_one_well_formed_file_without_requests_or_script():
    text = render_report(make_record(), command="legato demo")
    page = Page(text)
    assert "script" not in page.tags
    assert "link" not in page.tags
    addresses = [value for name, value in page.attributes if name in ("src", "href")]
    assert addresses
    assert all(address.startswith("data:image/png;base64,") for address in addresses)
    assert "http" not in text
    assert "url(" not in text


def test_report_shows_what_was_run_and_what_came_out():
    text = render_report(make_record(), command="legato eval --seed 3")
    for expected in (
        *("legato eval --seed 3", "2026-01-02 03:04 UTC", "lockstep", "1/2", "50 % [10-90]"),
        *("1.2", "4.7", "10.4x", SHA, "0.1.0", "dropped the lid", "retarget-panda left"),
    ):
        assert expected in text, expected


def test_report_shows_how_the_retargeter_did():
    text = render_report(make_record(), command="legato demo")
    row = "<td><b>panda</b></td><td>expert</td><td>99.8</td><td>25.0</td><td>12.5</td>"
    assert row + "<td>3</td><td>0.11</td><td>0.42</td>" in text


def test_report_counts_stages_and_says_how_far_a_failed_trial_came():
    nothing = StagesReached(grasped=False, lifted=False, placed=False, released=False)
    far, not_at_all = make_trial(0, status="failure"), make_trial(1, status="failure")
    result = not_at_all.result.model_copy(update={"stages": nothing})
    trials = [far, not_at_all.model_copy(update={"result": result})]
    text = render_report(make_record(trials), command="x")
    assert "<th>Grasped / lifted / placed / released</th>" in text
    assert "<td>2/2/1/1</td>" in text
    assert "<td>grasped, lifted</td><td>dropped the lid</td>" in text
    assert "<td>nothing</td><td>dropped the lid</td>" in text


def test_report_lists_failed_conditions():
    trial = make_trial(status="failure")
    result = trial.result.model_copy(update={"failed_conditions": ["upright", "released"]})
    failed = trial.model_copy(update={"result": result})
    assert "upright; released" in render_report(make_record([failed]), command="x")


def test_report_without_failures_says_so():
    text = render_report(make_record([make_trial()]), command="x")
    assert "<p>None.</p>" in text
    assert "Aborted attempts" not in text
    assert "Episodes" not in text


def test_report_escapes_everything():
    evil = '<script>alert("x")</script>'
    trial = make_trial(
        status="failure",
        reason=evil,
        attempts=[make_attempt(reason=evil, cell=evil)],
        task=evil,
        robot=evil,
        pictures=[f"{evil}-scene"],
    )
    cell = make_cell(evil, task=evil, policy=evil, trace_sha256=[evil])
    record = make_record([trial], cells=[cell], versions={evil: evil}, id=evil)
    text = render_report(record, command=evil)
    assert "<script" not in text
    assert "&lt;script&gt;" in text


def test_write_report_says_when_it_cannot(tmp_path):
    path = tmp_path / "report.html"
    write_report(make_record(), path, command="x")
    assert path.read_text().startswith("<!doctype html>")
    with pytest.raises(NotWritable):
        write_report(make_record(), tmp_path / "nowhere" / "report.html", command="x")


def test_moments_stand_in_the_order_of_time_with_their_views():
    (strip, *_) = choose_strips(make_record())
    assert [moment.name for moment in strip.moments] == ["start", "grasp", "grasp-2", "end"]
    assert list(strip.moments[1].views) == ["scene", "left", "right"]


def test_first_trials_and_failures_come_first_within_the_budget():
    trials = [
        make_trial(0, index=0, pictures=["end-scene"]),
        make_trial(1, index=1, pictures=["end-scene"]),
        make_trial(2, index=2, pictures=["end-scene"]),
        make_trial(3, index=3, status="failure", pictures=["end-scene"]),
    ]
    record = make_record(trials)
    assert [strip.trial.id for strip in choose_strips(record)] == [0, 1, 3]
    one = len(next(iter(choose_strips(record)[0].moments[0].views.values())))
    assert [strip.trial.id for strip in choose_strips(record, budget_bytes=2 * one)] == [0, 3]
    assert choose_strips(record, budget_bytes=one - 1) == []


def test_json_has_exactly_the_agreed_fields():
    shown = to_json(make_record())
    assert set(shown) == {"cells", "trials", "versions", "seed", "mode", "evaluation"}
    assert set(shown["cells"][0]) == {
        *("task", "robot", "policy", "trials", "successes", "failures", "aborted"),
        *("stages", "success_rate", "interval95", "median_hand_error_m", "p95_hand_error_m"),
        *("mean_hand_scaling", "least_hand_scaling", "limited_share", "solver_failures"),
        *("median_solve_time_s", "p99_solve_time_s", "real_time_factor", "trace_sha256"),
    }


def test_success_in_words():
    assert describe_success(make_cell()) == "50 % [10-90]"
    assert describe_success(make_cell(success_rate=None, interval95=(0.0, 1.0))) == "-"


def test_tables_line_up():
    assert format_table(("a", "bb"), [("xxx", "y")]) == "a    bb\n---  --\nxxx  y"
    lines = format_results(make_evaluation()).splitlines()
    assert "grasped/lifted/placed/released" in lines[0]
    assert "  2/2/1/1  " in lines[2]
    assert lines[2].split()[:4] == ["lid", "abstract", "expert", "1/2"]
    nothing = make_cell(success_rate=None, median_hand_error_m=None, real_time_factor=None)
    assert "-" in format_results(make_evaluation(cells=[nothing])).splitlines()[2]


def test_services_show_the_dead():
    shown = format_services([make_service("sim", "sim-0", alive=False)])
    assert re.search(r"sim +sim-0 +NO", shown)
