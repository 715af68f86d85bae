"""What all tests share."""

import os

# Threads that wait for each other by spinning starve each other on busy cores; small networks gain
# nothing from a second one. Before torch is imported, which reads it once.
os.environ.setdefault("OMP_NUM_THREADS", "1")

from hypothesis import settings

# No test asserts how long something took: a busy machine may stand still at any moment.
settings.register_profile("legato", deadline=None)
settings.load_profile("legato")
