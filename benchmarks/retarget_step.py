"""Time of one retargeting step, message in to messages out, without the bus.

Run: python -m benchmarks.retarget_step
"""

from __future__ import annotations

import os

os.environ["OPENBLAS_NUM_THREADS"] = "1"

import time

import numpy as np

from services.retarget.reactor import RetargetReactor
from tests.retarget_runs import NODE, action, configure, state, wandering_actions

TICKS = 2000


def main() -> None:
    reactor = RetargetReactor(node=NODE, robots=["panda", "abstract"])
    for epoch, robot in enumerate(("abstract", "panda"), start=1):
        reactor.handle([configure(robot, epoch=epoch)])
        steps = list(wandering_actions(TICKS // 10))
        positions, times_ns, errors_m = None, [], []
        for tick in range(TICKS):
            due = tick if tick % 10 == 0 else -1
            if due >= 0:
                reactor.handle([action(due, steps[tick // 10], epoch=epoch)])
            message = state(tick, robot, due=due, epoch=epoch, positions=positions)
            started = time.thread_time_ns()
            status, command = reactor.handle([message])
            times_ns.append(time.thread_time_ns() - started)
            positions = command.positions
            errors_m.append(status.hand_error_m)
        lowest, median, p99 = np.percentile(times_ns, [0, 50, 99]) * 1e-3
        error_mm = 1e3 * np.sqrt(np.mean(np.square(errors_m)))
        print(
            f"{robot:9} step: least {lowest:.0f} us, median {median:.0f} us, p99 {p99:.0f} us;"
            f" hand error {error_mm:.3f} mm rms"
        )


if __name__ == "__main__":
    main()
