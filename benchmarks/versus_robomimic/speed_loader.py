"""Batches of robomimic's loader, timed; prints one JSON object.

Run by `python -m benchmarks.loader`, in robomimic's environment; imports nothing of LEGATO. Data
set, its cache and the batches are robomimic's: `SequenceDataset` in PyTorch's `DataLoader`, in one
process.
"""

from __future__ import annotations

import argparse
import contextlib
import io
import json
import sys
import time
import warnings
from itertools import islice
from pathlib import Path

import torch

from benchmarks.versus_robomimic.robomimic_config import WINDOW, make_config
from benchmarks.versus_robomimic.speed_robomimic import prepare


def main() -> int:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("data", type=Path)
    parser.add_argument("output", type=Path)
    parser.add_argument("--cache", choices=("all", "low_dim"), default="all")
    parser.add_argument("--updates", type=int, default=10)
    parser.add_argument("--batch", type=int, default=16)
    args = parser.parse_args()

    torch.set_num_threads(1)
    warnings.simplefilter("ignore", UserWarning)
    config = make_config(args.data, output=args.output, batch=args.batch, cache=args.cache)
    config.lock()
    with contextlib.redirect_stdout(io.StringIO()):
        _, loader = prepare(config)
    times: list[tuple[float, float]] = []
    while len(times) <= args.updates:
        began_s, began_cpu_s = time.perf_counter(), time.process_time()
        for _ in islice(loader, args.updates + 1 - len(times)):
            now_s, now_cpu_s = time.perf_counter(), time.process_time()
            times.append((now_s - began_s, now_cpu_s - began_cpu_s))
            began_s, began_cpu_s = now_s, now_cpu_s
    # The first one warms up.
    print(json.dumps({"frames": args.batch * WINDOW, "times": times[1:]}))
    return 0


if __name__ == "__main__":
    sys.exit(main())
