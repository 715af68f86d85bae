"""Run the retargeting service as a process."""

from __future__ import annotations

import argparse
import os
from collections.abc import Sequence

from common.errors import MissingExtra
from common.process import add_bus_options, end_process, run_service
from common.robots import list_robots
from common.service import Reactor


def main(arguments: Sequence[str] | None = None) -> int:
    """Read the command line and serve until told to stop."""
    # Matrices of a few rows: a second BLAS thread only costs. Read when numpy is first imported.
    os.environ["OPENBLAS_NUM_THREADS"] = "1"
    parser = argparse.ArgumentParser(prog="python -m services.retarget", description=__doc__)
    parser.add_argument(
        "--robot",
        action="append",
        metavar="NAME",
        help=f"robot to serve, may be given several times (known: {', '.join(list_robots())})",
    )
    add_bus_options(parser, default_node="retarget")
    args = parser.parse_args(arguments)
    robots: list[str] = args.robot or list_robots()

    def make_reactor() -> Reactor:
        try:
            from services.retarget.reactor import RetargetReactor
        except ModuleNotFoundError as error:
            raise MissingExtra(str(error.name), "retarget") from error
        return RetargetReactor(node=args.node, robots=robots)

    return run_service(make_reactor, args)


if __name__ == "__main__":
    end_process(main())
