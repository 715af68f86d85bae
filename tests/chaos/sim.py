"""`python -m tests.chaos.sim --trial-s 3`: the simulation, but one of its tasks is over soon.

A test of faults is about many trials, not about long ones: the cup task ends at its time limit,
as a failure, after seconds. The other tasks keep their limits.
"""

from __future__ import annotations

import argparse

from common.process import end_process
from common.tasks import TASKS
from common.tasks.cup import CupTask
from services.sim.__main__ import main

if __name__ == "__main__":
    parser = argparse.ArgumentParser(add_help=False, allow_abbrev=False)
    parser.add_argument("--trial-s", type=float, required=True)
    own, arguments = parser.parse_known_args()
    short = CupTask(time_limit_s=own.trial_s)
    TASKS[short.name] = short
    end_process(main(arguments))
