"""One evaluation over real processes, as metrics and logs show it."""

from __future__ import annotations

import json
import threading
from collections import defaultdict
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import pytest

from client.deployment import Deployment
from common.api import Evaluation, EvaluationRequest
from common.metrics import METRICS
from common.metrics import table as t
from tests.deployments import first_of_free_ports, running, wait_until_done
from tests.metrics_scrape import Scrape, scrape

pytestmark = pytest.mark.processes

TRIALS = 2


@dataclass(frozen=True)
class Observed:
    """What one evaluation has left behind, while its processes were still there."""

    deployment: Deployment
    evaluation: Evaluation
    scrapes: dict[str, Scrape]
    targets: list[dict[str, object]]


def wait_until(condition: Callable[[], bool]) -> None:
    pause = threading.Event()
    for _ in range(600):
        if condition():
            return
        pause.wait(0.1)
    raise AssertionError("waited in vain")


@pytest.fixture(scope="module")
def observed(tmp_path_factory) -> Observed:
    folder = tmp_path_factory.mktemp("observed")
    request = EvaluationRequest(
        tasks=["lid"], robots=["abstract"], policy="expert", trials=TRIALS, pictures=False
    )
    with running(folder, robots=("abstract",), metrics_port=first_of_free_ports()) as (
        deployment,
        _,
        client,
    ):
        evaluation = wait_until_done(client, client.submit(request).id, timeout_s=600.0)
        ports = {
            spec.node: port
            for spec, port in zip(deployment.processes(), deployment.metrics_ports(), strict=True)
        }
        # What services count themselves follows with the next heartbeat.
        wait_until(lambda: scrape(ports["control"]).value(t.TRIALS, outcome="success") == TRIALS)
        wait_until(lambda: scrape(ports["sim-0"]).value(t.EPISODES, outcome="success") == TRIALS)
        scrapes = {node: scrape(port) for node, port in ports.items()}
        targets = json.loads(deployment.targets.read_text())
    return Observed(deployment, evaluation, scrapes, targets)


def test_every_metric_comes_from_the_process_that_has_it(observed: Observed):
    kinds = {spec.node: spec.kind for spec in observed.deployment.processes()}
    for node, found in observed.scrapes.items():
        shown = {name for name in found.names if name.startswith("legato_")}
        expected = {
            f"{each.name}_count" if each.kind == "histogram" else each.name
            for each in METRICS
            if each.belongs_to(kinds[node])
        }
        # The router takes part in nothing: it has no topic to be counted by.
        if kinds[node] == "router":
            by_topic = {each.name for each in METRICS if each.labels == ("topic",)}
            expected -= by_topic - {t.PUBLISHED.name}
        histograms = {f"{each.name}_bucket" for each in METRICS if each.kind == "histogram"}
        histograms |= {f"{each.name}_sum" for each in METRICS if each.kind == "histogram"}
        assert shown - histograms == expected, node


def test_what_is_counted_is_what_happened(observed: Observed):
    sim, policy = observed.scrapes["sim-0"], observed.scrapes["policy"]
    retarget, control = observed.scrapes["retarget-abstract"], observed.scrapes["control"]
    # On a machine that stood still for 0.4 s messages were sent twice and counted once or twice.
    twice = sim.value(t.RESENDS)
    ticks = sim.value(t.PUBLISHED, topic="robot/state")
    frames = sim.value(t.PUBLISHED, topic="camera/stereo")

    def is_all_of(count: float, sent: float) -> bool:
        return sent - twice <= count <= sent

    assert (frames - TRIALS - twice) * 10 < ticks <= frames * 10 + twice
    assert is_all_of(sim.count(t.COMMAND_AGE), ticks)
    assert is_all_of(sim.count(t.ACTION_AGE), frames)
    assert is_all_of(policy.count(t.OBSERVATION_AGE), frames)
    assert is_all_of(policy.count(t.INFERENCE), frames)
    assert policy.count(t.INFERENCE) == policy.count(t.BATCH)
    # One status per frame period; the last one may be cut off by the end of the episode.
    assert ticks - 10 * TRIALS - twice < retarget.count(t.SOLVE, robot="abstract") <= ticks
    assert is_all_of(retarget.value(t.RECEIVED, topic="robot/state"), ticks)
    assert retarget.value(t.MISSING, topic="robot/state") <= twice
    assert control.value(t.PEER_ALIVE, peer="policy") == 1
    assert control.value(t.PENDING_TRIALS) == 0


def test_prometheus_is_told_where_to_ask(observed: Observed):
    nodes = [spec.node for spec in observed.deployment.processes()]
    ports = observed.deployment.metrics_ports()
    assert observed.targets == [
        {"targets": [f"127.0.0.1:{port}"], "labels": {"process": node}}
        for node, port in zip(nodes, ports, strict=True)
    ]


def read_log(path: Path) -> list[dict[str, object]]:
    return [json.loads(line) for line in path.read_text().splitlines()]


def test_one_evaluation_is_found_in_the_logs_of_all_processes(observed: Observed):
    found: defaultdict[str, list[dict[str, object]]] = defaultdict(list)
    for path in sorted(observed.deployment.logs.glob("*.log")):
        for line in read_log(path):
            if line.get("evaluation") == observed.evaluation.id:
                found[str(line["service"])].append(line)
    assert set(found) == {"control", "sim-0", "retarget-abstract", "gripper", "policy"}
    epochs = defaultdict(set)
    for node, lines in found.items():
        trials = [line["trial"] for line in lines if "trial" in line]
        assert sorted(set(trials)) == list(range(TRIALS)), node
        # A line per turn, not per tick.
        assert len(lines) <= 3 * TRIALS + 2, node
        for line in lines:
            if "epoch" in line:
                assert line["cell"] == "sim-0"
                epochs[line["trial"]].add(line["epoch"])
    # All processes speak of the same run of the cell.
    assert [len(epochs[trial]) for trial in range(TRIALS)] == [1] * TRIALS
