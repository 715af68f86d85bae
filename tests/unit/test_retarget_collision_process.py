"""Distances must not depend on what a process computed before."""

import subprocess
import sys

_FIRST_BOXES = """
import coal, numpy as np
import services.retarget.collision
place = [coal.Transform3s(np.eye(3), np.array([x, 0.0, 0.0])) for x in (0.0, 0.5)]
box = coal.Box(0.1, 0.2, 0.3)
print(coal.distance(box, place[0], box, place[1], coal.DistanceRequest(), coal.DistanceResult()))
"""


def test_boxes_are_as_large_as_they_are():
    """A first question along an axis would make coal widen every box by 1e-10 from then on."""
    done = subprocess.run(
        [sys.executable, "-c", _FIRST_BOXES], capture_output=True, text=True, check=True
    )
    assert float(done.stdout) == 0.4
