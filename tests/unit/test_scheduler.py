"""The scheduler by itself: messages in, messages out, time as ticks."""

from __future__ import annotations

import itertools

import pytest

from common.api import EvaluationRequest
from common.messages import (
    AskDescription,
    EpisodeAbort,
    EpisodeConfigure,
    EpisodeReady,
    EpisodeResult,
    EpisodeStart,
    Header,
    NodeDescription,
    NodeDown,
    NodeMetrics,
    NodeUp,
    Problem,
    Tick,
)
from services.control.events import (
    AttemptEnded,
    AttemptStarted,
    CancelEvaluation,
    CellsChanged,
    EvaluationEnded,
    NodesChanged,
    PictureArrived,
    SubmitEvaluation,
    TrialEnded,
    WaitingChanged,
)
from services.control.grid import expand_grid, trial_seed
from services.control.scheduler import Scheduler, growing_epochs
from tests.control_nodes import make_picture, make_result

OFFERS = {
    "retarget-panda": {"robots": ["panda"]},
    "retarget-spot": {"robots": ["spot"]},
    "policy": {"policies": ["expert"]},
}


class Bench:
    """A scheduler with nodes that are described at once, and a hand on its clock."""

    def __init__(self, *, cells=1, robots=("panda",), **options):
        self.scheduler = Scheduler(new_epoch=itertools.count(1).__next__, **options)
        self.now_s = 100.0
        self.log = []
        self.tick(0.0)
        self.up("router", "router")
        for number in range(cells):
            self.up("sim", f"sim-{number}")
        for robot in robots:
            self.up("retarget", f"retarget-{robot}")
        self.up("gripper", "gripper")
        self.up("policy", "policy")

    def give(self, *messages):
        out = list(self.scheduler.handle(messages))
        self.log += out
        return [m for m in out if not isinstance(m, (NodesChanged, CellsChanged, WaitingChanged))]

    def tick(self, passed_s=0.05):
        self.now_s += passed_s
        return self.give(Tick(round(self.now_s * 1e9)))

    def up(self, kind, node):
        return self.give(NodeUp(kind, node), describe(kind, node))

    def down(self, *nodes):
        return self.give(*(NodeDown(kind, node) for kind, node in nodes))

    def beat(self, node, *, seq=0):
        counts = dict.fromkeys(
            ("handled", "published", "rejected", "superseded", "stale", "gaps"), 0
        )
        header = Header(source=node, seq=seq)
        return self.give(NodeMetrics(header=header, node=node, handle_time_s=0.0, **counts))

    def submit(self, name="e-1", **request):
        request = {"tasks": ["lid"], "robots": ["panda"], "policy": "expert", "trials": 1} | request
        request = EvaluationRequest(**request)
        return self.give(SubmitEvaluation(name, request, expand_grid(name, request)))

    def ready(self, configure, *, kinds=None, problem=None):
        return self.give(
            *(
                EpisodeReady(header=configure.header, node=node, kind=kind, problem=problem)
                for kind, node in configure.nodes.items()
                if kinds is None or kind in kinds
            )
        )

    def end(self, configure, outcome="success", reason="done"):
        result = make_result(outcome, reason, seed=configure.seed)
        return self.give(EpisodeResult(header=configure.header, result=result))

    def run(self, configure, **how):
        self.ready(configure)
        return self.end(configure, **how)


def describe(kind, node):
    return NodeDescription(
        header=Header(source=node),
        kind=kind,
        node=node,
        code_version="0.1.0",
        packages={f"package-of-{kind}": "1"},
        host="here",
        pid=1,
        started_unix_s=0.0,
        offers=OFFERS.get(node, {}),
    )


def only(kind, messages):
    return [message for message in messages if isinstance(message, kind)]


def one(kind, messages):
    (found,) = only(kind, messages)
    return found


def test_trial_runs_from_configure_to_result():
    bench = Bench()
    out = bench.submit()
    configure = one(EpisodeConfigure, out)
    assert configure.nodes == {
        "sim": "sim-0",
        "retarget": "retarget-panda",
        "gripper": "gripper",
        "policy": "policy",
    }
    assert (configure.header.cell, configure.header.epoch) == ("sim-0", 1)
    assert configure.seed == trial_seed(0, 0)
    assert one(AttemptStarted, out).versions == {
        "legato": "0.1.0",
        **{f"package-of-{kind}": "1" for kind in sorted(configure.nodes)},
    }
    assert bench.ready(configure, kinds={"sim", "policy", "gripper"}) == []
    assert one(EpisodeStart, bench.ready(configure, kinds={"retarget"})).header.epoch == 1
    out = bench.end(configure)
    assert one(TrialEnded, out).status == "success"
    assert one(EvaluationEnded, out).status == "done"


def test_bus_messages_come_before_what_is_written_down():
    bench = Bench()
    configure = one(EpisodeConfigure, bench.submit(trials=2))
    bench.ready(configure)
    out = bench.end(configure)
    assert [type(message) for message in out] == [EpisodeConfigure, TrialEnded, AttemptStarted]


def test_robots_take_turns_and_share_seeds():
    bench = Bench(robots=("panda", "spot"))
    out = bench.submit(robots=["panda", "spot"], trials=2)
    seen = []
    while configures := only(EpisodeConfigure, out):
        (configure,) = configures
        seen.append((configure.robot, configure.seed))
        out = bench.run(configure)
    first, second = trial_seed(0, 0), trial_seed(0, 1)
    assert first != second
    assert seen == [("panda", first), ("spot", first), ("panda", second), ("spot", second)]


def test_cells_work_in_parallel():
    bench = Bench(cells=3)
    configures = only(EpisodeConfigure, bench.submit(trials=4))
    assert [c.header.cell for c in configures] == ["sim-0", "sim-1", "sim-2"]
    following = one(EpisodeConfigure, bench.run(configures[1]))
    assert following.header.cell == "sim-1"
    for configure in (configures[0], configures[2]):
        assert only(EvaluationEnded, bench.run(configure)) == []
    assert one(EvaluationEnded, bench.run(following)).status == "done"


def test_least_loaded_policy_is_chosen(monkeypatch):
    monkeypatch.setitem(OFFERS, "policy-b", {"policies": ["expert"]})
    bench = Bench(cells=2)
    bench.up("policy", "policy-b")
    configures = only(EpisodeConfigure, bench.submit(trials=2))
    assert {c.nodes["policy"] for c in configures} == {"policy", "policy-b"}


def test_a_policy_is_given_only_cells_in_which_it_has_rights(monkeypatch):
    monkeypatch.setitem(OFFERS, "policy", {"policies": ["expert"], "only_cells": ["sim-0"]})
    monkeypatch.setitem(OFFERS, "policy-b", {"policies": ["expert"], "only_cells": ["sim-1*"]})
    bench = Bench(cells=3)
    bench.up("policy", "policy-b")
    out = bench.submit(trials=4)
    configures = only(EpisodeConfigure, out)
    assert [(c.header.cell, c.nodes["policy"]) for c in configures] == [
        ("sim-0", "policy"),
        ("sim-1", "policy-b"),
    ]
    assert one(EpisodeConfigure, bench.run(configures[1])).header.cell == "sim-1"


def test_trials_for_which_no_cell_is_right_say_so_and_end(monkeypatch):
    monkeypatch.setitem(OFFERS, "policy", {"policies": ["expert"], "only_cells": ["sim-7"]})
    bench = Bench(cells=2, rejoin_s=10.0)
    assert only(EpisodeConfigure, bench.submit()) == []
    bench.tick()
    wanted = "a cell in which retarget for panda, gripper, policy for expert have rights"
    assert bench.log[-1].names == (wanted,)
    assert one(TrialEnded, bench.tick(10.0)).reason == f"node_missing: {wanted} missing for 10 s"


def test_lost_node_is_named_and_trial_retried_once():
    bench = Bench()
    configure = one(EpisodeConfigure, bench.submit())
    bench.ready(configure)
    assert bench.down(("retarget", "retarget-panda")) == []
    out = [m for _ in range(3) for m in bench.tick()]
    reason = "node_left: retarget retarget-panda left (process died or link lost)"
    assert one(EpisodeAbort, out).reason == reason
    assert one(AttemptEnded, out).reason == reason

    assert bench.tick(5.0) == []
    assert bench.log[-1] == WaitingChanged("e-1", ("retarget retarget-panda",))
    bench.up("retarget", "retarget-panda")
    again = one(EpisodeConfigure, bench.log[-5:])
    assert (again.seed, again.header.epoch) == (configure.seed, 2)

    bench.ready(again)
    bench.down(("retarget", "retarget-panda"))
    out = [m for _ in range(3) for m in bench.tick()]
    ended = one(TrialEnded, out)
    assert (ended.status, ended.reason, ended.trial.spent) == ("aborted", reason, 1)
    assert one(EvaluationEnded, out).status == "done"


def test_retry_waits_until_a_hanging_node_would_have_been_noticed():
    bench = Bench()
    configure = one(EpisodeConfigure, bench.submit())
    bench.ready(configure)
    assert only(EpisodeConfigure, bench.end(configure, "aborted", "policy silent")) == []
    assert only(EpisodeConfigure, bench.tick(0.9)) == []
    assert one(EpisodeConfigure, bench.tick(0.2)).seed == configure.seed


def test_a_longer_lease_lengthens_what_a_tick_and_a_retry_in_real_time_wait():
    assert one(EpisodeConfigure, Bench().submit()).node_deadline_s == pytest.approx(1.6)
    bench = Bench(lease_s=5.0)
    configure = one(EpisodeConfigure, bench.submit(mode="realtime"))
    assert configure.node_deadline_s == pytest.approx(8.0)
    bench.ready(configure)
    bench.end(configure, "aborted", "robot_fault: no command for 50 ms")
    assert only(EpisodeConfigure, bench.tick(4.9)) == []
    assert one(EpisodeConfigure, bench.tick(0.2)).seed == configure.seed


def test_a_retry_in_lockstep_does_not_wait_for_a_long_lease():
    bench = Bench(lease_s=5.0)
    configure = one(EpisodeConfigure, bench.submit())
    bench.ready(configure)
    bench.end(configure, "aborted", "node_timeout: policy silent")
    assert only(EpisodeConfigure, bench.tick(0.9)) == []
    assert one(EpisodeConfigure, bench.tick(0.2)).seed == configure.seed


def test_nor_does_one_after_a_loss():
    bench = Bench(lease_s=5.0)
    bench.ready(one(EpisodeConfigure, bench.submit()))
    bench.down(("retarget", "retarget-panda"))
    bench.up("retarget", "retarget-panda")
    out = [m for _ in range(3) for m in bench.tick()]
    assert len(only(EpisodeAbort, out)) == 1
    assert only(EpisodeConfigure, bench.tick(0.9)) == []
    assert len(only(EpisodeConfigure, bench.tick(0.2))) == 1


def test_abort_by_the_cell_counts_as_an_attempt_and_is_not_sent_back():
    bench = Bench()
    configure = one(EpisodeConfigure, bench.submit())
    bench.ready(configure)
    out = bench.end(configure, "aborted", "policy silent")
    assert one(AttemptEnded, out).reason == "policy silent"
    assert only(EpisodeAbort, out) == []


def test_router_is_named_when_every_token_vanishes():
    bench = Bench()
    bench.ready(one(EpisodeConfigure, bench.submit()))
    bench.down(("sim", "sim-0"), ("policy", "policy"))
    bench.tick()
    bench.down(("router", "router"), ("retarget", "retarget-panda"), ("gripper", "gripper"))
    out = [m for _ in range(3) for m in bench.tick()]
    assert (
        one(EpisodeAbort, out).reason
        == "router_left: router router left (process died or link lost)"
    )


def test_loss_is_the_cause_even_if_the_cell_aborts_first():
    bench = Bench()
    configure = one(EpisodeConfigure, bench.submit())
    bench.ready(configure)
    bench.down(("policy", "policy"))
    assert bench.end(configure, "aborted", "no action") == []
    out = [m for _ in range(3) for m in bench.tick()]
    assert one(AttemptEnded, out).reason.startswith("node_left: policy policy left")


def test_node_that_left_and_came_back_within_the_window_still_aborts():
    bench = Bench()
    bench.ready(one(EpisodeConfigure, bench.submit()))
    bench.down(("gripper", "gripper"))
    bench.up("gripper", "gripper")
    out = [m for _ in range(4) for m in bench.tick()]
    assert one(EpisodeAbort, out).reason.startswith("node_left: gripper gripper left")


def test_node_that_was_replaced_without_leaving_is_noticed_by_its_beats():
    bench = Bench()
    configure = one(EpisodeConfigure, bench.submit())
    bench.ready(configure)
    for seq in (1, 2, 3):
        assert bench.beat("sim-0", seq=seq) == []
    assert bench.beat("sim-0", seq=1) == [AskDescription("sim-0")]
    out = [m for _ in range(4) for m in bench.tick()]
    assert one(EpisodeAbort, out).reason.startswith("node_left: sim sim-0 left")
    bench.give(describe("sim", "sim-0"))
    assert one(EpisodeConfigure, bench.tick(1.0)).seed == configure.seed


def test_beats_of_two_nodes_of_one_name_say_nothing():
    bench = Bench()
    bench.up("policy", "sim-0")
    bench.ready(one(EpisodeConfigure, bench.submit()))
    assert [m for seq in (5, 1, 6, 2) for m in bench.beat("sim-0", seq=seq)] == []
    assert [m for _ in range(4) for m in bench.tick()] == []


def test_loss_of_a_node_that_takes_no_part_changes_nothing():
    bench = Bench(cells=2, robots=("panda", "spot"))
    configure = one(EpisodeConfigure, bench.submit())
    bench.ready(configure)
    bench.down(("retarget", "retarget-spot"), ("sim", "sim-1"))
    assert [m for _ in range(10) for m in bench.tick()] == []
    assert one(TrialEnded, bench.end(configure)).status == "success"


def test_result_that_was_on_its_way_when_a_node_left_counts():
    bench = Bench()
    configure = one(EpisodeConfigure, bench.submit())
    bench.ready(configure)
    bench.down(("policy", "policy"))
    assert one(TrialEnded, bench.end(configure)).status == "success"


def test_missing_node_ends_the_trials_that_need_it_and_no_other():
    bench = Bench(robots=("panda", "spot"), rejoin_s=10.0)
    bench.down(("retarget", "retarget-spot"))
    out = bench.submit(robots=["spot", "panda"], trials=2)
    bench.tick()
    assert bench.log[-1] == WaitingChanged("e-1", ("retarget retarget-spot",))
    out = bench.run(one(EpisodeConfigure, out))
    assert only(TrialEnded, bench.tick(9.5)) == []
    ended = only(TrialEnded, bench.tick(1.0))
    assert [(e.trial.robot, e.status) for e in ended] == [("spot", "aborted")] * 2
    assert {e.reason for e in ended} == {"node_missing: retarget retarget-spot missing for 10 s"}
    assert only(EvaluationEnded, bench.log) == []
    assert one(EvaluationEnded, bench.run(one(EpisodeConfigure, out))).status == "done"


def test_waiting_names_the_kind_of_a_node_that_never_was():
    bench = Bench()
    bench.submit(robots=["google"], policy="learned")
    bench.tick()
    assert bench.log[-1].names == ("retarget for google", "policy for learned")


def test_problem_of_a_node_aborts_with_its_words():
    bench = Bench()
    configure = one(EpisodeConfigure, bench.submit())
    problem = Problem(code="E-X", happened="no model", expected="a file", action="get it")
    out = bench.ready(configure, kinds={"policy"}, problem=problem)
    text = "node_problem: policy policy: no model; a file; get it"
    assert one(EpisodeAbort, out).reason == text
    assert one(AttemptEnded, out).reason == text


def test_silent_nodes_are_named_after_the_ready_timeout():
    bench = Bench(ready_timeout_s=20.0)
    configure = one(EpisodeConfigure, bench.submit())
    bench.ready(configure, kinds={"sim", "gripper"})
    assert bench.tick(19.0) == []
    out = bench.tick(1.5)
    assert (
        one(EpisodeAbort, out).reason
        == "node_timeout: policy policy, retarget retarget-panda did not get ready within 20 s"
    )


def test_cell_that_hangs_is_given_up():
    bench = Bench()
    bench.ready(one(EpisodeConfigure, bench.submit()))
    for _ in range(4):
        assert bench.tick(20.0) == []
        bench.beat("sim-0")
    bench.tick(20.0)
    assert one(EpisodeAbort, bench.tick(11.0)).reason.startswith(
        "node_timeout: sim sim-0 gave no sign of life"
    )


def test_messages_of_another_epoch_or_cell_do_not_count():
    bench = Bench(cells=2)
    configure = one(EpisodeConfigure, bench.submit())
    for update in ({"epoch": 99}, {"cell": "sim-1"}):
        other = configure.header.model_copy(update=update)
        stray = configure.model_copy(update={"header": other})
        assert bench.ready(stray) == []
        assert bench.end(stray) == []
    bench.ready(configure)
    assert one(TrialEnded, bench.end(configure)).status == "success"


def test_ready_of_a_node_that_was_not_asked_does_not_count():
    bench = Bench()
    configure = one(EpisodeConfigure, bench.submit())
    others = configure.model_copy(update={"nodes": {kind: "other" for kind in configure.nodes}})
    assert bench.ready(others) == []


def test_second_result_and_early_result_are_ignored():
    bench = Bench()
    configure = one(EpisodeConfigure, bench.submit())
    assert bench.end(configure) == []
    bench.ready(configure)
    assert bench.ready(configure) == []
    assert len(only(TrialEnded, bench.end(configure))) == 1
    assert bench.end(configure) == []


def test_picture_belongs_to_the_running_trial():
    bench = Bench()
    configure = one(EpisodeConfigure, bench.submit(pictures=True))
    assert configure.pictures
    bench.ready(configure)
    picture = make_picture(configure.header)
    assert one(PictureArrived, bench.give(picture)).trial.id == 0
    bench.end(configure)
    assert bench.give(picture) == []


def test_cancel_stops_what_runs_and_drops_the_rest():
    bench = Bench()
    configure = one(EpisodeConfigure, bench.submit(trials=3))
    bench.ready(configure)
    out = bench.give(CancelEvaluation("e-1"))
    assert one(EpisodeAbort, out).header.epoch == configure.header.epoch
    assert one(EvaluationEnded, out).status == "cancelled"
    assert bench.end(configure) == []
    assert bench.tick(10.0) == []
    assert bench.give(CancelEvaluation("e-1")) == []


def test_second_evaluation_uses_what_the_first_cannot():
    bench = Bench(robots=("spot",))
    assert bench.submit("e-1", robots=["panda"]) == []
    assert one(EpisodeConfigure, bench.submit("e-2", robots=["spot"])).robot == "spot"


def test_submitted_without_trials_is_done_at_once():
    bench = Bench()
    request = EvaluationRequest(tasks=["lid"], robots=["panda"], policy="expert")
    assert bench.give(SubmitEvaluation("e-1", request, ())) == [EvaluationEnded("e-1", "done")]


def test_undescribed_node_is_asked_each_second_and_not_used():
    bench = Bench(robots=())
    assert bench.give(NodeUp("retarget", "retarget-panda")) == [AskDescription("retarget-panda")]
    assert bench.submit() == []
    assert bench.tick(0.5) == []
    assert bench.tick(0.6) == [AskDescription("retarget-panda")]
    assert only(EpisodeConfigure, bench.give(describe("retarget", "retarget-panda"))) != []


def test_nodes_are_shown_with_their_counters_also_when_lost():
    bench = Bench()
    bench.beat("sim-0")
    bench.down(("policy", "policy"))
    nodes = {info.node: info for info in bench.log[-1].nodes}
    assert nodes["sim-0"].metrics["gaps"] == 0
    assert (nodes["policy"].alive, nodes["sim-0"].alive) == (False, True)


def test_epochs_grow_also_within_a_millisecond():
    next_epoch = growing_epochs()
    epochs = [next_epoch() for _ in range(100)]
    assert all(a < b for a, b in itertools.pairwise(epochs))
    assert growing_epochs()() >= epochs[0]


@pytest.mark.parametrize("seed", [0, 2**53 - 1])
def test_seeds_are_a_function_of_seed_and_index(seed):
    seeds = [trial_seed(seed, index) for index in range(1000)]
    assert seeds == [trial_seed(seed, index) for index in range(1000)]
    assert len(set(seeds)) == 1000
    assert all(0 <= value < 2**32 for value in seeds)
