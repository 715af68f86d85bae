"""Updates of robomimic's BC-RNN, timed; prints one JSON object.

Run by `python -m benchmarks.versus_robomimic`, in robomimic's environment; imports nothing of
LEGATO. Model, loader and the loop are robomimic's.
"""

from __future__ import annotations

import argparse
import contextlib
import io
import json
import sys
import time
import warnings
from importlib.metadata import version
from pathlib import Path
from typing import Any

import robomimic.utils.file_utils as file_utils
import robomimic.utils.obs_utils as obs_utils
import robomimic.utils.train_utils as train_utils
import torch
from robomimic.algo import algo_factory
from torch.utils.data import DataLoader

from benchmarks.versus_robomimic.robomimic_config import WINDOW, make_config

PACKAGES = ("robomimic", "torch", "torchvision", "h5py", "numpy")


def process_gray(images: Any) -> Any:
    """Images with one channel; robomimic's own accept three only."""
    return obs_utils.process_frame(frame=images, channel_dim=1, scale=255.0)


def prepare(config: Any) -> tuple[Any, DataLoader[Any]]:
    """Model and batches as robomimic's training script makes them."""
    obs_utils.ImageModality.set_obs_processor(process_gray)
    obs_utils.initialize_obs_utils_with_config(config)
    shapes = file_utils.get_shape_metadata_from_dataset(
        dataset_path=config.train.data, all_obs_keys=config.all_obs_keys
    )
    model = algo_factory(
        algo_name=config.algo_name,
        config=config,
        obs_key_shapes=shapes["all_shapes"],
        ac_dim=shapes["ac_dim"],
        device=torch.device("cpu"),
    )
    dataset, _ = train_utils.load_data_for_training(config, obs_keys=shapes["all_obs_keys"])
    return model, DataLoader(
        dataset, batch_size=config.train.batch_size, shuffle=True, drop_last=True
    )


def main() -> int:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("data", type=Path)
    parser.add_argument("output", type=Path)
    parser.add_argument("--updates", type=int, default=3)
    parser.add_argument("--batch", type=int, default=16)
    parser.add_argument("--threads", type=int, default=2)
    args = parser.parse_args()

    torch.set_num_threads(args.threads)
    warnings.simplefilter("ignore", UserWarning)
    config = make_config(args.data, output=args.output, batch=args.batch, cache="all")
    config.lock()
    with contextlib.redirect_stdout(io.StringIO()):
        model, loader = prepare(config)
        train_utils.run_epoch(model, loader, epoch=1, num_steps=1)
        wall_s, cpu_s = time.perf_counter(), time.process_time()
        log = train_utils.run_epoch(model, loader, epoch=1, num_steps=args.updates)
        wall_s, cpu_s = time.perf_counter() - wall_s, time.process_time() - cpu_s
    measured = {
        "timesteps": args.updates * args.batch * WINDOW,
        "wall_s": wall_s,
        "cpu_s": cpu_s,
        "parameters": sum(p.numel() for p in model.nets.parameters() if p.requires_grad),
        "loss": log["Loss"],
        "versions": {name: version(name) for name in PACKAGES},
    }
    print(json.dumps(measured))
    return 0


if __name__ == "__main__":
    sys.exit(main())
