"""Whether lerobot reads what `legato data export --to lerobot` writes.

Run: python -m benchmarks.formats FOLDER [--episodes 4] [--codec av1]

FOLDER is a recorded data set, e.g. runs/demonstrations/lid-abstract-0. Makes lerobot's environment
when it is missing (see requirements.txt). Exit code 1 if anything differs.
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
import tempfile
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.environments import ROOT, ensure_environment
from benchmarks.subset import copy_episodes
from common.datasets import EpisodeStore
from common.formats.labels import read_labels
from common.formats.lerobot import export_lerobot

REQUIREMENTS = Path(__file__).with_name("requirements.txt")
LEAST_PSNR_DB = 30.0


def compare(found: Mapping[str, Any], store: EpisodeStore) -> list[tuple[str, bool, str]]:
    """What was read beside what was exported: name, whether it is equal, figure."""
    labels = np.concatenate([read_labels(episode, store.spec) for episode in store])
    lengths = store.spans()[:, 1]
    images = np.asarray(store.column("images"))[found["rows"]].astype(float) / 255.0
    error = found["images"] - images[:, :, None]
    psnr = -10.0 * np.log10(np.mean(np.square(error)))
    times = np.concatenate([np.arange(length) / store.spec.rate_hz for length in lengths])
    left = np.asarray(store.column("images")[:, 0])
    mean_error = float(np.abs(found["left_mean"].reshape(-1) - left.mean() / 255.0).max())
    return [
        ("actions, bit for bit", np.array_equal(found["action"], labels.astype(np.float32)), ""),
        ("episodes", np.array_equal(np.bincount(found["episode"]), lengths), f"{len(lengths)}"),
        ("times", bool(np.allclose(found["timestamp"], times, atol=1e-4)), f"{times[-1]:.1f} s"),
        ("mean of actions", bool(np.allclose(found["action_mean"], labels.mean(axis=0))), ""),
        ("mean of images", mean_error < 1e-6, f"differs by {mean_error:.1e}"),
        (
            f"{len(images)} stereo pairs",
            bool(psnr > LEAST_PSNR_DB),
            f"PSNR {psnr:.1f} dB (asked: {LEAST_PSNR_DB:g}), largest error {abs(error).max():.2f}",
        ),
    ]


def read_by_lerobot(python: Path, folder: Path, out: Path) -> Mapping[str, Any]:
    """What lerobot reads, in an environment of its own.

    Raises:
        SystemExit: It cannot.
    """
    module = ("benchmarks.torchvision_operators", "benchmarks.formats.read_by_lerobot")
    command = [str(python), "-m", *module, str(folder), str(out)]
    # It would ask the hub for a newer version.
    offline = {"HF_HUB_OFFLINE": "1", "HF_HOME": str(out.parent / "hub")}
    ended = subprocess.run(command, cwd=ROOT, env=os.environ | offline, check=False)
    if ended.returncode != 0:
        raise SystemExit("lerobot does not read it")
    return np.load(out)


def main() -> int:
    """Export, read, compare."""
    parser = argparse.ArgumentParser(prog="benchmarks.formats", description=__doc__)
    parser.add_argument("folder", type=Path, help="of a data set")
    parser.add_argument("--episodes", type=int, default=4)
    parser.add_argument("--codec", choices=("av1", "h264"), default="av1")
    args = parser.parse_args()
    os.environ.setdefault("SVT_LOG", "1")

    python = ensure_environment(".venv-lerobot", REQUIREMENTS, size="1.3 GB")
    with tempfile.TemporaryDirectory() as temporary:
        work = Path(temporary)
        store = copy_episodes(EpisodeStore.open(args.folder), work / "some", args.episodes)
        export_lerobot(store, work / "lerobot", codec=args.codec)
        found = read_by_lerobot(python, work / "lerobot", work / "found.npz")
        described = json.loads(str(found["described"]))
        results = compare(found, store)
    print("read with " + ", ".join(f"{name} {v}" for name, v in described["packages"].items()))
    print(f"{described['version']}, task {described['tasks']}, {', '.join(described['features'])}")
    for name, equal, figure in results:
        print(f"{'ok  ' if equal else 'FAIL'}  {name:24s} {figure}")
    return 0 if all(equal for _, equal, _ in results) else 1


if __name__ == "__main__":
    sys.exit(main())
