"""A deployment in real time for a long while: latency from camera to joint command, and growth.

Run: python -m benchmarks.soak --minutes 60 [--robot panda] [--policy legato-lid]

Starts all processes as `legato up` does, runs evaluations one after the other in real-time mode,
and looks once a second at what every process takes. Ctrl-C ends it early, with its report. Exit
code: 0 when nothing grows, 1 when something does, died, or cannot be told yet.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
import time
from collections import Counter
from dataclasses import dataclass, field
from pathlib import Path

from benchmarks.machine import describe_machine
from benchmarks.soak.growth import Growth, measure_growth
from benchmarks.soak.latency import TOPICS, ArrivalTap, LatencyMatcher
from benchmarks.soak.processes import LEAST, LIMITS_PER_HOUR, QUANTITIES, Sampler
from client.api import LegatoClient
from client.deployment import Deployment, find_free_ports
from client.readiness import wait_until_ready
from client.supervisor import Supervisor, open_deployment
from client.tap import open_tap
from common.api import EvaluationRequest
from common.bus import BusSettings
from common.messages import TrialResult
from common.statistics import quantile

SAMPLE_S = 1.0
TELL_S = 60.0
READY_S = 300.0
"""The camera may have to be compiled first, on a busy machine."""
TRIALS = 5
"""Per evaluation."""


@dataclass
class Soak:
    """What was measured."""

    sampler: Sampler = field(default_factory=Sampler)
    matcher: LatencyMatcher = field(default_factory=LatencyMatcher)
    tap: ArrivalTap = field(default_factory=ArrivalTap)
    outcomes: Counter[str] = field(default_factory=Counter[str])
    results: list[TrialResult] = field(default_factory=list[TrialResult])
    evaluations: int = 0
    lasted_s: float = 0.0

    def observe(self, supervisor: Supervisor) -> None:
        """Take one sample of everything."""
        self.sampler.sample(time.monotonic(), supervisor.pids)
        for arrived_ns, message in self.tap.take_all():
            self.matcher.take(arrived_ns, message)

    def keep(self, client: LegatoClient, evaluation: str) -> None:
        """Count what an evaluation's trials have come to."""
        self.evaluations += 1
        for trial in client.trials(evaluation):
            self.outcomes[trial.status] += 1
            if trial.result is not None:
                self.results.append(trial.result)


def run(soak: Soak, args: argparse.Namespace, folder: Path) -> None:
    """Evaluate and observe until the time is over or Ctrl-C."""
    router_port, rest_port = find_free_ports(2)
    deployment = Deployment(
        robots=(args.robot,),
        router_port=router_port,
        rest_port=rest_port,
        namespace=f"soak-{rest_port}",
        data=folder,
    )
    bus = BusSettings(endpoint=deployment.endpoint, namespace=deployment.namespace)
    with (
        open_deployment(deployment) as supervisor,
        LegatoClient(deployment.url, timeout_s=60.0) as client,
    ):
        supervisor.start()
        wait_until_ready(
            client, deployment, given_up=lambda: supervisor.given_up, deadline_s=READY_S
        )
        with open_tap(bus, soak.tap, TOPICS):
            try:
                evaluate_for(soak, args, supervisor, client)
            except KeyboardInterrupt:
                sys.stderr.write("interrupted: what was measured until now follows\n")


def evaluate_for(
    soak: Soak, args: argparse.Namespace, supervisor: Supervisor, client: LegatoClient
) -> None:
    """One evaluation after the other, one sample a second."""
    began_s = next_s = time.monotonic()
    told_s, seed, running = began_s, 0, ""
    while soak.lasted_s < 60.0 * args.minutes:
        if not running or client.evaluation(running).status != "running":
            if running:
                soak.keep(client, running)
            running = client.submit(make_request(args, seed)).id
            seed += TRIALS
        soak.observe(supervisor)
        next_s = max(next_s + SAMPLE_S, time.monotonic())
        time.sleep(max(0.0, next_s - time.monotonic()))
        soak.lasted_s = time.monotonic() - began_s
        if time.monotonic() - told_s >= TELL_S:
            told_s = time.monotonic()
            sys.stderr.write(f"{soak.lasted_s / 60:.0f} min: {describe_latency(soak)}\n")


def make_request(args: argparse.Namespace, seed: int) -> EvaluationRequest:
    """The next evaluation."""
    return EvaluationRequest(
        tasks=["lid"],
        robots=[args.robot],
        policy=args.policy,
        trials=TRIALS,
        seed=seed,
        mode="realtime",
    )


def describe_latency(soak: Soak) -> str:
    """Percentiles of the latency."""
    latencies = soak.matcher.latencies_s
    if not latencies:
        return "no joint command has answered a frame"
    named = (("p50", 0.5), ("p99", 0.99), ("largest", 1.0))
    told = (f"{name} {1e3 * (quantile(latencies, q) or 0.0):.1f} ms" for name, q in named)
    return f"camera -> joint command {', '.join(told)} ({len(latencies)} frames)"


def print_trials(soak: Soak) -> None:
    """What the evaluations have come to, and what real time has cost them."""
    ticks = sum(result.ticks for result in soak.results)
    held = sum(result.held_ticks for result in soak.results)
    missed = sum(result.missed_frames for result in soak.results)
    counted = ", ".join(f"{count} {status}" for status, count in sorted(soak.outcomes.items()))
    print(f"{soak.lasted_s / 60:.1f} min, {soak.evaluations} evaluations: {counted or 'no trial'}")
    print(
        f"{ticks} ticks in them, {held} without a command young enough; {missed} frames whose "
        f"action came too late; {soak.tap.lost} messages lost by this observer"
    )
    print(describe_latency(soak))


def print_growth(soak: Soak) -> bool:
    """Every process in a row; tell whether none of them grows."""
    print(
        f"\n{'after the warm-up':18s}"
        + "".join(f"{name + ': first, last, per hour [95 %]':>40s}" for name in QUANTITIES)
    )
    growing: list[str] = []
    uncertain: list[str] = []
    for node, series in soak.sampler.series.items():
        row = f"{node:18s}"
        for name in QUANTITIES:
            growth = measure_growth(
                series.times_s,
                series.values[name],
                limit_per_hour=LIMITS_PER_HOUR[name],
                least=LEAST[name],
            )
            row += f"{describe_growth(growth):>40s}"
            if growth is None or not growth.is_certain:
                uncertain.append(f"{node} {name}")
            elif growth.is_growing:
                growing.append(f"{node} {name}")
        print(row)
    limits = ", ".join(f"{limit:g} {name}" for name, limit in LIMITS_PER_HOUR.items())
    print(f"\nallowed per hour: {limits}")
    print(f"grows: {', '.join(growing) or 'nothing'}")
    print(f"not certain yet: {', '.join(uncertain) or 'nothing'}")
    print(f"died: {', '.join(soak.sampler.restarts) or 'nothing'}")
    return not (growing or uncertain or soak.sampler.restarts)


def describe_growth(growth: Growth | None) -> str:
    """One cell of the table."""
    if growth is None:
        return "too short"
    interval = f"{growth.low:+.1f} to {growth.high:+.1f}"
    return f"{growth.first:.1f} {growth.last:.1f} {growth.per_hour:+.1f} [{interval}]"


def main() -> int:
    """Run, measure and print."""
    parser = argparse.ArgumentParser(
        prog="benchmarks.soak",
        description=__doc__,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("--minutes", type=float, default=60.0)
    parser.add_argument("--robot", default="panda")
    parser.add_argument("--policy", default="legato-lid")
    args = parser.parse_args()
    print(describe_machine(("mujoco-core", "pin", "piqp", "numpy", "eclipse-zenoh")))
    print(f"lid task, {args.robot}, {args.policy}, real time at full rates, over processes\n")
    soak = Soak()
    with tempfile.TemporaryDirectory() as folder:
        run(soak, args, Path(folder))
    print_trials(soak)
    return 0 if print_growth(soak) else 1


if __name__ == "__main__":
    sys.exit(main())
