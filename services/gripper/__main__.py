"""`python -m services.gripper`: the gripper driver as a process."""

from __future__ import annotations

import argparse

from common.process import add_bus_options, end_process, run_service
from services.gripper.reactor import GripperReactor


def main() -> int:
    """Run the driver until SIGTERM."""
    parser = argparse.ArgumentParser(prog="services.gripper", description=__doc__)
    add_bus_options(parser, default_node="gripper")
    args = parser.parse_args()
    return run_service(lambda: GripperReactor(node=args.node), args)


if __name__ == "__main__":
    end_process(main())
