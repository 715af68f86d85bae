"""`python -m services.policy --checkpoints DIR`: the policy service as a process."""

from __future__ import annotations

import argparse
from pathlib import Path

from common.errors import InvalidValue
from common.process import add_bus_options, end_process, run_service
from services.policy.reactor import PolicyReactor
from services.policy.serving.library import (
    Library,
    ServingOptions,
    find_checkpoints,
    find_shipped,
)


def main() -> int:
    """Serve policies until SIGTERM."""
    parser = argparse.ArgumentParser(prog="services.policy", description=__doc__)
    parser.add_argument(
        "--checkpoints",
        type=Path,
        default=None,
        help="folder whose checkpoints are served beside those that come with LEGATO",
    )
    parser.add_argument(
        "--backend",
        choices=("onnx", "torch"),
        default="onnx",
        help="what runs the networks (%(default)s)",
    )
    parser.add_argument("--device", default="cpu", help="cpu, or cuda:0 with torch (%(default)s)")
    parser.add_argument(
        "--threads", type=int, default=1, help="passes at the same time, with onnx (%(default)s)"
    )
    parser.add_argument(
        "--decoding",
        choices=("most-likely", "sample"),
        default="most-likely",
        help="from a mixture to an action (%(default)s)",
    )
    add_bus_options(parser, default_node="policy")
    args = parser.parse_args()
    return run_service(lambda: make_reactor(args), args)


def make_reactor(args: argparse.Namespace) -> PolicyReactor:
    """The service, with every checkpoint loaded and warm.

    Raises:
        CheckpointError: One of them cannot be used.
        InvalidValue: `--checkpoints` is no folder.
        MissingExtra: The backend is not installed.
        NoSuchDevice: The device is not there.
    """
    options = ServingOptions(
        backend=args.backend, device=args.device, threads=args.threads, decoding=args.decoding
    )
    folder: Path | None = args.checkpoints
    if folder is not None and not folder.is_dir():
        raise InvalidValue("--checkpoints", str(folder), "a folder")
    library = Library(options, base=folder)
    library.load_all(find_shipped())
    if folder is not None:
        library.load_all(find_checkpoints(folder))
    return PolicyReactor(node=args.node, library=library)


if __name__ == "__main__":
    end_process(main())
