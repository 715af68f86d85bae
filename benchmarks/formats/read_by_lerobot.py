"""Reads a LeRobotDataset with lerobot and writes what it found; runs in lerobot's environment.

Run by `python -m benchmarks.formats`; imports nothing of LEGATO.
"""

from __future__ import annotations

import argparse
import json
import sys
from importlib.metadata import version
from pathlib import Path

import numpy as np
from lerobot.datasets.compute_stats import aggregate_stats
from lerobot.datasets.lerobot_dataset import LeRobotDataset
from lerobot.datasets.utils import dataset_to_policy_features

from benchmarks.formats.video_reader import install

EYES = ("observation.images.left", "observation.images.right")
PACKAGES = ("lerobot", "datasets", "torch", "torchvision", "av", "pyarrow")


def main() -> int:
    """Read and write."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folder", type=Path, help="of the LeRobotDataset")
    parser.add_argument("out", type=Path, help="file to write (.npz)")
    parser.add_argument("--stride", type=int, default=7, help="rows between two decoded images")
    args = parser.parse_args()

    install()
    dataset = LeRobotDataset("local/legato", root=args.folder, video_backend="pyav")
    rows = range(0, len(dataset), args.stride)
    items = [dataset[row] for row in rows]
    # It refuses statistics of wrong shapes.
    statistics = aggregate_stats([dataset.meta.stats])
    columns = dataset.hf_dataset.with_format("numpy")[:]
    described = {
        "version": dataset.meta.info["codebase_version"],
        "tasks": sorted({item["task"] for item in items}),
        "features": sorted(dataset_to_policy_features(dataset.features)),
        "packages": {name: version(name) for name in PACKAGES},
    }
    np.savez(
        args.out,
        described=json.dumps(described),
        action=np.stack(columns["action"]),
        state=np.stack(columns["observation.state"]),
        episode=columns["episode_index"],
        timestamp=columns["timestamp"],
        rows=np.array(rows),
        images=np.stack([[item[eye].numpy() for eye in EYES] for item in items]),
        action_mean=statistics["action"]["mean"],
        left_mean=statistics[EYES[0]]["mean"],
    )
    return 0


if __name__ == "__main__":
    sys.exit(main())
