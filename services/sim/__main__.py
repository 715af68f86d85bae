"""`python -m services.sim --node sim-0`: one simulated cell as a process."""

from __future__ import annotations

import argparse
import contextlib
import os
from collections.abc import Sequence
from pathlib import Path


def main(argv: Sequence[str] | None = None) -> int:
    """Run a simulated cell until SIGTERM."""
    # Threads of a BLAS library fight with the other processes for the cores.
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    from common.process import add_bus_options, run_service
    from common.robots.menagerie import VARIABLE, find_menagerie

    parser = argparse.ArgumentParser(prog="services.sim", description=__doc__)
    add_bus_options(parser, default_node="sim-0")
    parser.add_argument(
        "--meshes",
        type=Path,
        default=find_menagerie(),
        help=f"copy of MuJoCo Menagerie for pictures of episodes (default: {VARIABLE}, if set)",
    )
    parser.add_argument(
        "--tool-log",
        type=Path,
        default=None,
        help="write the tool's pose after every tick to this CSV file (docs/safety.md)",
    )
    args = parser.parse_args(argv)

    from services.sim.reactor import SimReactor
    from services.sim.tool_log import ToolLog

    with contextlib.ExitStack() as stack:

        def make_reactor() -> SimReactor:
            log = None if args.tool_log is None else stack.enter_context(ToolLog(args.tool_log))
            return SimReactor(node=args.node, meshes=args.meshes, tool_log=log)

        return run_service(make_reactor, args)


if __name__ == "__main__":
    from common.process import end_process

    end_process(main())
