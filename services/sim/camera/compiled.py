"""How the camera's kernels are compiled.

Kernels are plain Python that Numba turns into machine code on first use and keeps in a cache,
beside the code or, where that is read-only, in the user's cache folder. They use neither fast-math
nor threads, so the same input gives the same bits wherever the same code runs.

Numba looks only at the file of an entry kernel to decide whether its cached code is still good. An
entry kernel is therefore built by a function that hands it `digest_sources()`: a free variable is
part of the cache's key, so that a change in any of the files compiles anew.
"""

from __future__ import annotations

import hashlib
from pathlib import Path

from numba import njit

# Without `_nrt` arrays are passed as plain pointers: kernels allocate nothing, and counting
# references took half of their time.
device = njit(error_model="numpy", no_cpython_wrapper=True, no_cfunc_wrapper=True, _nrt=False)
"""Marks a function that kernels call. Only they can: Python finds no way in and crashes."""

inlined = njit(
    error_model="numpy",
    forceinline=True,
    no_cpython_wrapper=True,
    no_cfunc_wrapper=True,
    _nrt=False,
)
"""Marks a small function that becomes part of the loop that calls it."""

stage = njit(error_model="numpy", inline="always", _nrt=False)
"""Marks a stage of a kernel: it is pasted into its caller before anything is compiled.

Numba optimises a function again in each of its callers, and again in theirs, so that deep calls
make compiling slow. What calls the heavy functions is therefore a stage.
"""

entry = njit(cache=True, nogil=True, error_model="numpy", no_cfunc_wrapper=True, _nrt=False)
"""Marks a kernel that Python calls."""


def digest_sources(*more: Path) -> int:
    """63 bits of the SHA-256 of all files of this folder and of more: the version of a kernel."""
    digest = hashlib.sha256()
    for folder in (Path(__file__).parent, *more):
        for path in sorted(folder.glob("*.py")):
            digest.update(path.name.encode() + b"\0" + path.read_bytes() + b"\0")
    return int.from_bytes(digest.digest()[:8], "big") >> 1
