"""`python -m tests.chaos.sim`: the simulation as it is, but one of its tasks is over soon.

A test of faults is about many trials, not about long ones: the cup task ends at its time limit,
as a failure, after seconds. The other tasks keep their limits.
"""

from __future__ import annotations

from common.process import end_process
from common.tasks import TASKS
from common.tasks.cup import CupTask
from services.sim.__main__ import main

SHORT = CupTask(time_limit_s=3.0)

if __name__ == "__main__":
    TASKS[SHORT.name] = SHORT
    end_process(main())
