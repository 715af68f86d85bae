"""Lets torchvision be imported beside a PyTorch that its compiled part was not built for.

Run: python -m benchmarks.torchvision_operators MODULE [ARGUMENTS], as if it were python -m MODULE.

The package on PyPI is built for CUDA. Beside PyTorch for the CPU its Python part works (ResNets,
transforms), but ends its own import when it describes two operators that only the compiled part
has. Here these are declared, without a body: whoever called one would get an error.
"""

from __future__ import annotations

import importlib.util
import runpy
import sys
from pathlib import Path

import torch

_SIGNATURE = "(Tensor dets, Tensor scores, float iou_threshold) -> Tensor"
_DECLARED: list[torch.library.Library] = []


def declare_missing() -> None:
    """Declare the operators unless the compiled part can be loaded; call it before the import.

    Raises:
        ModuleNotFoundError: torchvision is not installed.
    """
    found = importlib.util.find_spec("torchvision")
    if found is None or found.origin is None:
        raise ModuleNotFoundError("torchvision is not installed")
    try:
        for library in Path(found.origin).parent.glob("_C*.so"):
            torch.ops.load_library(library)
    except OSError:
        library = torch.library.Library("torchvision", "DEF")
        for name in ("nms", "qnms"):
            library.define(name + _SIGNATURE)
        # They are gone as soon as the library is.
        _DECLARED.append(library)


if __name__ == "__main__":
    declare_missing()
    del sys.argv[0]
    runpy.run_module(sys.argv[0], run_name="__main__", alter_sys=True)
