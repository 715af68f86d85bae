"""What services measure: messages in, samples out, no Prometheus."""

from __future__ import annotations

import re
from collections.abc import Iterable

import pytest

from common import messages as m
from common.bus import Bus, BusSettings, open_session
from common.metrics import METRICS, Increase, Metric, Sample
from common.metrics import table as t
from common.service import Host, Reactor
from services.policy.reactor import OLDEST_OBSERVATION_S, PolicyReactor
from services.retarget.reactor import RetargetReactor
from tests import retarget_runs
from tests.unit import test_scheduler as scheduling
from tests.unit import test_sim_reactor as simulation
from tests.unit.test_serving import frame

BOUNDED = {"topic", "robot", "outcome", "limit", "code", "peer_kind", "peer", "kind", "version"}
KINDS = {"every", "sim", "retarget", "gripper", "policy", "control"}
LOST_PEERS = 64


def values(samples: Iterable[Sample], metric: Metric) -> dict[tuple[str, ...], float]:
    return {each.labels: each.value for each in samples if each.metric is metric}


def test_the_table_keeps_the_conventions_of_prometheus():
    names = [metric.name for metric in METRICS]
    assert len(names) == len(set(names)) > 25
    for metric in METRICS:
        assert re.fullmatch(r"legato(_[a-z]+)+", metric.name)
        assert metric.name.endswith("_total") == (metric.kind == "counter"), metric.name
        assert bool(metric.buckets) == (metric.kind == "histogram"), metric.name
        assert list(metric.buckets) == sorted(set(metric.buckets)), metric.name
        assert set(metric.of.split(", ")) <= KINDS, metric.name
        assert set(metric.labels) <= BOUNDED, metric.name


def test_totals_that_begin_anew_become_increments():
    increase = Increase()
    told = [("a", 1, 2), ("a", 1, 5), ("b", 1, 1), ("a", 1, 4), ("a", 2, 3), ("a", 1, 9)]
    assert [increase.since_last(*each) for each in told] == [2, 3, 1, 0, 3, 0]


def test_nobody_is_asked_where_nothing_is_exported():
    class Silent(Reactor):
        kind = "gripper"
        inputs = ()

        def handle(self, messages):
            return ()

        def measure(self, given, returned, began_ns):
            raise AssertionError("asked")

        levels = measure

    with open_session(BusSettings("in_process")) as session, Bus(session) as bus:
        host = Host(Silent(), bus, node="silent")
        host.start()
        host.tick(1)
        assert host.metrics().handled == 1


def test_ages_at_the_robot_are_of_its_own_clock():
    reactor, _ = simulation.started()
    given = [simulation.command(0, t_ns=1_000), simulation.action(0), simulation.motor(0)]
    found = list(reactor.measure(given, [], began_ns=4_001_000))
    assert values(found, t.COMMAND_AGE) == {(): pytest.approx(4e-3)}
    assert values(found, t.ACTION_AGE) == {(): pytest.approx(4_001_000e-9)}
    assert len(found) == 2


def test_a_simulation_counts_over_episodes():
    reactor, _ = simulation.started(mode="realtime")

    def held() -> float:
        return values(reactor.levels(), t.HELD_TICKS)[()]

    assert held() == 0
    for now_ms in range(0, 60, 10):
        reactor.handle([m.Tick(1_000_000_000 + now_ms * simulation.MS)])
    first = held()
    # Nobody commands: every tick is held.
    assert first == 6
    reactor.handle([simulation.configure(mode="realtime")])
    assert held() == first
    reactor.handle([m.EpisodeStart(header=simulation.header())])
    reactor.handle([m.Tick(2_000_000_000)])
    assert held() == first + 1


def test_a_simulation_shows_what_its_guard_did_over_episodes():
    reactor, _ = simulation.started(robot="panda")

    def clamped() -> dict[tuple[str, ...], float]:
        return values(reactor.levels(), t.CLAMPED_TICKS)

    none = {("position",): 0, ("velocity",): 0, ("acceleration",): 0}
    assert clamped() == none
    far = [0.0, 0.5, -0.9, -2.0, 2.6, 1.0, -1.8]
    leap = simulation.command(0, far).model_copy(update={"velocities": [0.0] * 7})
    reactor.handle([simulation.action(0), leap, simulation.motor(0)])
    assert clamped() == none | {("velocity",): 1, ("acceleration",): 1}
    reactor.handle([simulation.configure(robot="panda")])
    assert clamped() == none | {("velocity",): 1, ("acceleration",): 1}


def test_a_simulation_counts_coasted_ticks_and_faults_by_their_code():
    reactor, _ = simulation.started(mode="realtime")

    def faults() -> dict[str, float]:
        return {code: n for (code,), n in values(reactor.levels(), t.FAULTS).items() if n}

    assert set(values(reactor.levels(), t.FAULTS)) >= {("E-STALE-COMMAND",), ("E-EMERGENCY-STOP",)}
    reactor.handle([simulation.command(0)])
    for now_ms in range(0, 200, 10):
        reactor.handle([m.Tick(1_000_000_000 + now_ms * simulation.MS)])
    # One tick follows the command, five are within its age limit.
    assert values(reactor.levels(), t.COASTED_TICKS) == {(): 5}
    assert faults() == {"E-STALE-COMMAND": 1}
    for _ in range(2):
        reactor.handle([m.SafetyStop(header=simulation.header(), by="button")])
    assert faults() == {"E-STALE-COMMAND": 1, "E-EMERGENCY-STOP": 1}


def test_a_simulation_counts_how_episodes_end():
    reactor, _ = simulation.started(node_deadline_s=1.0)
    given = [m.Tick(0), m.Tick(2_000_000_000)]
    returned = list(reactor.handle(given))
    assert list(reactor.measure(given, returned, 0)) == []
    counted = values(reactor.levels(), t.EPISODES)
    assert counted == {("success",): 0, ("failure",): 0, ("aborted",): 1}


@pytest.mark.parametrize("robot", ["panda", "abstract"])
def test_a_retargeter_shows_every_tick_by_robot(robot):
    reactor = RetargetReactor(node=retarget_runs.NODE, robots=["abstract", "panda"])
    reactor.handle([retarget_runs.configure(robot)])
    samples = []
    for tick in range(10):
        given = [retarget_runs.state(tick, robot)]
        samples += reactor.measure(given, list(reactor.handle(given)), 0)
    for metric in (t.SOLVE, t.HAND_ERROR, t.HAND_TURN):
        shown = [each for each in samples if each.metric is metric]
        assert [each.labels for each in shown] == [(robot,)] * 10
    assert all(each.value >= 0 for each in samples)
    failures = values(reactor.levels(), t.SOLVER_FAILURES)
    assert failures == {("abstract",): 0, ("panda",): 0}


def test_failures_of_a_solver_are_added_once():
    reactor = RetargetReactor(node=retarget_runs.NODE, robots=["abstract"])
    reactor.handle([retarget_runs.configure("abstract")])

    def status(failures: int) -> m.RetargetStatus:
        told = simulation.status(9).model_copy(update={"solver_failures": failures})
        return told.model_copy(update={"header": retarget_runs.header(9)})

    for failures in (1, 1, 3):
        list(reactor.measure([], [status(failures)], 0))
    assert values(reactor.levels(), t.SOLVER_FAILURES) == {("abstract",): 3}
    assert values(reactor.levels(), t.LIMITED_TICKS) == {("abstract",): 6}


def test_a_policy_shows_its_passes_and_how_old_frames_are():
    reactor = PolicyReactor(node="policy")
    for cell in ("a", "b"):
        nodes = {"sim": cell, "policy": "policy"}
        reactor.handle(
            [simulation.configure(header=m.Header(cell=cell, epoch=1), policy="hold", nodes=nodes)]
        )
    given = [frame(0, cell=cell, seed=1) for cell in ("a", "b")]
    returned = list(reactor.handle(given))
    sent_ns = given[0].header.t_mono_ns
    found = list(reactor.measure(given, returned, sent_ns + 2_000_000))
    ages = [each.value for each in found if each.metric is t.OBSERVATION_AGE]
    assert ages == [pytest.approx(2e-3)] * 2
    # A policy that is no network acts for each cell by itself.
    assert [each.value for each in found if each.metric is t.BATCH] == [1, 1]
    passes = [each.value for each in found if each.metric is t.INFERENCE]
    assert passes == [each.inference_s for each in returned]


def test_clocks_of_other_hosts_are_not_compared():
    reactor = PolicyReactor(node="policy")
    given = [frame(0, cell="a", seed=1)]
    reactor.handle(given)
    sent_ns = given[0].header.t_mono_ns
    for began_ns in (sent_ns - 1, sent_ns + int(OLDEST_OBSERVATION_S * 1e9)):
        assert list(reactor.measure(given, [], began_ns)) == []


def test_the_control_plane_counts_trials_and_knows_its_nodes():
    bench = scheduling.Bench()
    scheduler = bench.scheduler

    def level(metric: Metric) -> dict[tuple[str, ...], float]:
        return values(scheduler.levels(), metric)

    bench.submit(trials=3)
    before = len(bench.log)
    bench.tick()
    assert level(t.PENDING_TRIALS) == {(): 2}
    assert level(t.RUNNING_ATTEMPTS) == {(): 1}
    assert level(t.RUNNING_EVALUATIONS) == {(): 1}
    configures = [each for each in bench.log if isinstance(each, m.EpisodeConfigure)]
    bench.run(configures[-1])
    list(scheduler.measure([], bench.log[before:], 0))
    assert level(t.TRIALS) == {("success",): 1, ("failure",): 0, ("aborted",): 0}
    assert level(t.PEER_ALIVE)["policy", "policy"] == 1.0
    bench.down(("policy", "policy"))
    assert level(t.PEER_ALIVE)["policy", "policy"] == 0.0


def test_lost_nodes_do_not_pile_up():
    bench = scheduling.Bench()
    for number in range(500):
        bench.up("sim", f"sim-x{number}")
        bench.down(("sim", f"sim-x{number}"))
    alive = values(bench.scheduler.levels(), t.PEER_ALIVE)
    assert list(alive.values()).count(0.0) == LOST_PEERS
