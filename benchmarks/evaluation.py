"""Speed of an evaluation: in one process and over processes, with the split by stage.

Run: python -m benchmarks.evaluation [--trials 5] [--robot panda]

Both ways run the same trials with the same seeds, in turn; medians over trials are printed.
"""

from __future__ import annotations

import argparse
import io
import sys
import tempfile
import threading
from pathlib import Path
from statistics import median

from benchmarks.machine import describe_machine
from client.api import LegatoClient
from client.deployment import Deployment, find_free_ports
from client.offline import run_in_process
from client.progress import LineProgress
from client.readiness import wait_until_ready
from client.supervisor import open_deployment
from common.api import EvaluationRequest
from common.messages import TrialResult

STAGES = ("physics", "camera", "retarget", "policy", "bus and rest")


def run_inline(request: EvaluationRequest) -> list[TrialResult]:
    """Run an evaluation in this process."""
    record = run_in_process(request, progress=LineProgress(io.StringIO()), stop=threading.Event())
    return [trial.result for trial in record.trials if trial.result is not None]


def run_over_processes(client: LegatoClient, request: EvaluationRequest) -> list[TrialResult]:
    """Run an evaluation over the processes of a deployment."""
    evaluation = client.submit(request).id
    client.wait(evaluation)
    return [t.result for t in client.trials(evaluation) if t.result is not None]


def stage_shares(result: TrialResult) -> dict[str, float]:
    """Wall milliseconds per 100 ms of simulated time, by stage."""
    per_frame = 100.0 / result.sim_time_s
    s = result.wall_times
    rest = s.waiting_s - s.solve_s - s.inference_s
    values = (s.physics_s, s.camera_s, s.solve_s, s.inference_s, rest)
    return {name: per_frame * value for name, value in zip(STAGES, values, strict=True)}


def print_rows(rows: dict[str, list[TrialResult]]) -> None:
    """Print the table: real-time factor and milliseconds per 100 ms simulated."""
    print(f"{'':14s}{'trials':>7s}{'x real time':>13s}" + "".join(f"{n:>14s}" for n in STAGES))
    for name, results in rows.items():
        factor = median(r.sim_time_s / r.wall_time_s for r in results)
        shares = [stage_shares(r) for r in results]
        cells = "".join(f"{median(s[n] for s in shares):11.2f} ms" for n in STAGES)
        print(f"{name:14s}{len(results):7d}{factor:13.1f}{cells}")


def main() -> int:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--trials", type=int, default=5)
    parser.add_argument("--robot", action="append", help="default: abstract and panda")
    args = parser.parse_args()
    robots = args.robot or ["abstract", "panda"]
    print(describe_machine(("mujoco-core", "pin", "piqp", "numpy", "eclipse-zenoh")))
    print("columns by stage: wall time per 100 ms simulated, as the simulation spends it\n")
    router_port, rest_port = find_free_ports(2)
    with tempfile.TemporaryDirectory() as folder:
        deployment = Deployment(
            robots=tuple(robots),
            rest_port=rest_port,
            router_port=router_port,
            namespace="benchmark",
            data=Path(folder),
        )
        with open_deployment(deployment) as supervisor, LegatoClient(deployment.url) as client:
            supervisor.start()
            wait_until_ready(client, deployment, given_up=lambda: supervisor.given_up)
            for robot in robots:
                rows: dict[str, list[TrialResult]] = {"in process": [], "processes": []}
                for trial in range(args.trials):
                    request = EvaluationRequest(
                        tasks=["lid"],
                        robots=[robot],
                        policy="expert",
                        trials=1,
                        seed=trial,
                        pictures=False,
                    )
                    rows["in process"] += run_inline(request)
                    rows["processes"] += run_over_processes(client, request)
                print(f"{robot}, lid, expert, stereo 128x128 fisheye at 10 Hz, lockstep")
                print_rows(rows)
                print()
    return 0


if __name__ == "__main__":
    sys.exit(main())
