"""`python -m services.policy`: the policy service as a process."""

from __future__ import annotations

import argparse
import sys

from common.process import add_bus_options, run_service
from services.policy.reactor import PolicyReactor


def main() -> int:
    """Serve policies until SIGTERM."""
    parser = argparse.ArgumentParser(prog="services.policy", description=__doc__)
    add_bus_options(parser, default_node="policy")
    args = parser.parse_args()
    return run_service(lambda: PolicyReactor(node=args.node), args)


if __name__ == "__main__":
    sys.exit(main())
