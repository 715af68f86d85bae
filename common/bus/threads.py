"""Threads that Python has not started, on which Zenoh calls back."""

from __future__ import annotations

import ctypes
import threading


class KeptThreads:
    """Lets a foreign thread keep what Python needs to run on it, from one callback to the next.

    Python makes a thread state, and with the first frame a stack of 16 kB, for every call on a
    thread that it does not know, and returns both to the system when the call ends: about half of
    the time of a callback that stores some bytes. `PyGILState_Ensure` without its counterpart makes
    the state stay for as long as the thread, as that of a thread of Python's own does.

    Source: Python/C API, "Non-Python created threads".
    """

    def __init__(self) -> None:
        self._seen = threading.local()

    def keep(self) -> None:
        """Keep the state of the thread that calls; of no effect from the second call on."""
        if not hasattr(self._seen, "kept"):
            self._seen.kept = True
            ctypes.pythonapi.PyGILState_Ensure()
