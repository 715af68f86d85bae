"""`python -m services.sim.camera`: compile the camera's kernels now, for installers."""

from __future__ import annotations

import sys

from services.sim.camera.warm_up import warm_up


def main() -> int:
    """Compile, or load what is compiled."""
    sys.stdout.write(f"camera ready after {warm_up():.1f} s\n")
    return 0


if __name__ == "__main__":
    sys.exit(main())
