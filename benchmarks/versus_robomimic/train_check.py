"""robomimic's own training script on an exported file; prints the losses as one JSON object.

Run by `python -m benchmarks.versus_robomimic`, in robomimic's environment; imports nothing of
LEGATO.
"""

from __future__ import annotations

import argparse
import contextlib
import io
import json
import re
import sys
import warnings
from pathlib import Path

import torch
from robomimic.scripts.train import train

from benchmarks.versus_robomimic.robomimic_config import make_config

_EPOCH = re.compile(r"^(Train|Validation) Epoch \d+\n(\{.*?^\})", re.MULTILINE | re.DOTALL)


def main() -> int:
    """Train and print."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("data", type=Path)
    parser.add_argument("output", type=Path)
    parser.add_argument("--epochs", type=int, default=2)
    parser.add_argument("--updates", type=int, default=10, help="per epoch")
    args = parser.parse_args()

    config = make_config(args.data, output=args.output, batch=4, cache="low_dim")
    with config.values_unlocked():
        config.experiment.validate = True
        config.train.hdf5_validation_filter_key = "valid"
        config.train.num_epochs = args.epochs
        config.experiment.epoch_every_n_steps = args.updates
        config.experiment.validation_epoch_every_n_steps = 1
    config.lock()
    warnings.simplefilter("ignore", UserWarning)
    printed = io.StringIO()
    with contextlib.redirect_stdout(printed):
        train(config, device=torch.device("cpu"))
    losses: dict[str, list[float]] = {"Train": [], "Validation": []}
    for kind, log in _EPOCH.findall(printed.getvalue()):
        losses[kind].append(json.loads(log)["Loss"])
    print(json.dumps(losses))
    return 0


if __name__ == "__main__":
    sys.exit(main())
