"""Updates of LEGATO's trainer, timed; prints one JSON object.

Run by `python -m benchmarks.versus_robomimic`. Loader, losses and update are those of
`legato train`.
"""

from __future__ import annotations

import argparse
import json
import sys
import time
from importlib.metadata import version
from pathlib import Path

import torch

from services.policy.learning.normalization import ActionStatistics
from services.policy.learning.presets import load_preset
from services.policy.training.config import TrainingConfig
from services.policy.training.data import load_training_data
from services.policy.training.device import place
from services.policy.training.trainer import Trainer
from services.policy.training.windows import WindowLoader

PACKAGES = ("torch", "numpy")


def main() -> int:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--preset", default="bc-rnn-paper")
    parser.add_argument("--precision", choices=("bf16", "fp32"), default="bf16")
    parser.add_argument("--updates", type=int, default=3)
    parser.add_argument("--batch", type=int, default=16)
    parser.add_argument("--threads", type=int, default=2)
    args = parser.parse_args()

    torch.set_num_threads(args.threads)
    config = TrainingConfig(
        network=load_preset(args.preset),
        batch_windows=args.batch,
        precision=args.precision,
        # All episodes, as robomimic takes them.
        validation_share=0.0,
        longest_episode_s=1e3,
    )
    data = load_training_data([args.folder], config)
    loader = WindowLoader(data, config)
    trainer = Trainer(config, ActionStatistics.of(data.training_actions()), place("cpu"))
    report = trainer.update(loader.batch(0), 0)
    wall_s, cpu_s = time.perf_counter(), time.process_time()
    for update in range(1, 1 + args.updates):
        report = trainer.update(loader.batch(update), update)
    wall_s, cpu_s = time.perf_counter() - wall_s, time.process_time() - cpu_s
    measured = {
        "timesteps": args.updates * args.batch * config.network.window,
        "wall_s": wall_s,
        "cpu_s": cpu_s,
        "parameters": sum(p.numel() for p in trainer.network.parameters() if p.requires_grad),
        "loss": report.loss,
        "versions": {name: version(name) for name in PACKAGES},
    }
    print(json.dumps(measured))
    return 0


if __name__ == "__main__":
    sys.exit(main())
