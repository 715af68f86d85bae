"""The command line of the policy service, up to the reactor."""

from __future__ import annotations

import argparse
from pathlib import Path

import pytest

from common.errors import InvalidValue
from services.policy import __main__ as main_module
from services.policy.learning.checkpoint_errors import NoSuchDevice
from tests.checkpoints import write_checkpoint


@pytest.fixture(scope="module")
def base(tmp_path_factory) -> Path:
    base = tmp_path_factory.mktemp("served")
    write_checkpoint(base / "one")
    return base


def options(**changes: object) -> argparse.Namespace:
    usual: dict[str, object] = {
        "node": "policy",
        "checkpoints": None,
        "backend": "onnx",
        "device": "cpu",
        "threads": 1,
        "decoding": "most-likely",
    }
    return argparse.Namespace(**usual | changes)


@pytest.mark.parametrize("backend", ["onnx", "torch"])
def test_checkpoints_and_shipped_policies_are_served(base: Path, monkeypatch, backend: str):
    monkeypatch.setattr(main_module, "find_shipped", lambda: {"shipped": base / "one"})
    reactor = main_module.make_reactor(options(checkpoints=base, backend=backend))
    assert {"expert", "one", "shipped"} <= set(reactor.offers()["policies"])
    described = reactor.checkpoints()
    assert described["one"].sha256 == described["shipped"].sha256
    assert described["one"].runtime.split()[0] in (backend, f"{backend}runtime")


def test_a_folder_that_is_not_there_is_refused(tmp_path: Path):
    with pytest.raises(InvalidValue, match="--checkpoints"):
        main_module.make_reactor(options(checkpoints=tmp_path / "none"))


def test_a_device_that_is_not_there_is_refused(base: Path):
    with pytest.raises(NoSuchDevice):
        main_module.make_reactor(options(checkpoints=base, backend="torch", device="cuda:99"))
