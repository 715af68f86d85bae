from __future__ import annotations

import ast
import json
from pathlib import Path

import pytest
from pydantic import TypeAdapter, ValidationError

from common.errors import UnknownName
from services.policy.learning.config import (
    BcRnnConfig,
    EncoderConfig,
    InvariantLossConfig,
    LegatoConfig,
    LegatoSe3Config,
    PaperForm,
    PolicyConfig,
)
from services.policy.learning.network import PolicyNetwork
from services.policy.learning.presets import PRESETS, load_preset


def count_parameters(name: str) -> int:
    return sum(p.numel() for p in PolicyNetwork(load_preset(name)).parameters())


def test_the_papers_network_has_its_size():
    config = load_preset("legato-paper")
    assert count_parameters("legato-paper") == 33_881_218
    assert (config.lstm.layers, config.lstm.width) == (2, 400)
    assert (config.mlp.layers, config.mlp.width) == (3, 2048)
    assert (config.mixture.modes, config.history.steps) == (5, 2)
    assert (config.encoder.width, config.encoder.input_px, config.encoder.map_px) == (64, 128, 4)
    assert isinstance(config, LegatoConfig)
    assert config.loss.nll == config.loss.grasp.weight == config.loss.invariant.weight == 1.0


@pytest.mark.parametrize(
    ("name", "millions"),
    [
        ("legato-compact", 1.59),
        ("legato-small", 13.18),
        ("legato-medium", 13.18),
        ("legato-large", 17.37),
        ("bc-rnn-paper", 33.90),
    ],
)
def test_sizes_of_the_presets(name: str, millions: float):
    assert round(count_parameters(name) / 1e6, 2) == millions


def test_parts_of_the_papers_network():
    network = PolicyNetwork(load_preset("legato-paper"))
    sizes = {
        name: sum(parameter.numel() for parameter in child.parameters())
        for name, child in network.named_children()
    }
    assert network.lstm.input_size == 140
    assert sizes["left"] == sizes["right"] == 11_190_816
    assert sizes["lstm"] == 2_150_400
    assert sizes["mlp"] + sizes["mixture"] + sizes["grasp"] == 9_349_186


@pytest.mark.parametrize("name", sorted(PRESETS))
def test_presets_survive_json(name: str):
    config = load_preset(name)
    text = config.model_dump_json()
    assert TypeAdapter(PolicyConfig).validate_json(text) == config
    assert name.startswith(f"{config.method}-")


def test_methods_differ_in_head_and_terms():
    legato, se3, bc_rnn = LegatoConfig(), LegatoSe3Config(), BcRnnConfig()
    assert legato.loss.invariant is not None
    assert se3.loss.invariant is None
    assert bc_rnn.loss.grasp is None
    assert bc_rnn.loss.invariant is None
    assert (legato.head, bc_rnn.head) == ("separate-grasp", "grasp-in-mixture")
    assert (legato.mixture.std_floor, bc_rnn.mixture.std_floor) == (0.01, 1e-4)


def test_unknown_preset():
    with pytest.raises(UnknownName, match="did you mean: legato-compact"):
        load_preset("legato-compat")


@pytest.mark.parametrize(
    "fields",
    [
        {"width": 64},
        {"encoder": {"input_px": 96}},
        {"encoder": {"input_px": 128, "map_px": 2}},
        {"encoder": {"stages": 3, "map_px": 4}},
        {"history": {"steps": -1}},
        {"history": {"dropout": 1.0}},
        {"loss": {"nll": float("nan")}},
        {"loss": {"invariant": None}},
        {"loss": {"invariant": {"form": {"form": "paper", "epsilon_m": 1e-3}}}},
        {"loss": {"invariant": {"form": {"form": "paper"}, "history_steps": 1}}},
        {"method": "legato-se3"},
    ],
    ids=json.dumps,
)
def test_what_cannot_be_meant_is_refused(fields: dict[str, object]):
    with pytest.raises(ValidationError):
        LegatoConfig.model_validate(fields)


def test_configs_are_frozen():
    with pytest.raises(ValidationError):
        setattr(LegatoConfig(), "window", 10)  # noqa: B010


def test_a_folded_encoder_has_the_stages_of_half_the_side():
    folded = EncoderConfig.model_validate({"fold": 2, "stages": 3, "map_px": 8})
    halved = EncoderConfig.model_validate({"input_px": 64, "stages": 3, "map_px": 8})
    assert folded.halving_stages == halved.halving_stages == 1
    with pytest.raises(ValidationError):
        EncoderConfig.model_validate({"fold": 2, "stages": 3, "map_px": 2})


@pytest.mark.parametrize(
    ("input_px", "map_px", "halving"),
    [(128, 4, 3), (128, 8, 2), (64, 2, 3), (64, 8, 1), (64, 16, 0)],
)
def test_stages_that_halve(input_px: int, map_px: int, halving: int):
    fields = {"input_px": input_px, "map_px": map_px}
    assert EncoderConfig.model_validate(fields).halving_stages == halving


def test_the_full_form_is_the_default():
    config = InvariantLossConfig.model_validate({"form": {"form": "paper"}})
    assert config.form == PaperForm(full=True)


def imported(path: Path) -> set[str]:
    """Modules that a file imports when it is loaded, not when a function of it runs."""
    names: set[str] = set()
    for node in ast.parse(path.read_text()).body:
        if isinstance(node, ast.Import):
            names |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom) and node.module:
            names.add(node.module)
    return names


def test_torch_stays_in_its_places():
    """The control plane, the simulation and served policies run without it."""
    root = Path(__file__).parents[2]
    policy = root / "services" / "policy"
    files = [
        f for folder in ("common", "services", "client") for f in (root / folder).rglob("*.py")
    ]
    places = {policy / "learning", policy / "training"}
    outside = [f for f in files if not places & set(f.parents)]
    assert len(outside) > 50
    for path in outside:
        if path == policy / "serving" / "torch_backend.py":
            continue
        roots = {name.split(".")[0] for name in imported(path)}
        assert "torch" not in roots, path
        assert not any(name.startswith("services.policy.training") for name in imported(path)), path


@pytest.mark.parametrize("name", ["__init__", "config", "presets", "images", "normalization"])
def test_modules_for_deployment_without_torch(name: str):
    learning = Path(__file__).parents[2] / "services" / "policy" / "learning"
    allowed = {"config", "normalization", "images"}
    for module in imported(learning / f"{name}.py"):
        assert module.split(".")[0] != "torch"
        if module.startswith("services.policy.learning."):
            assert module.rsplit(".", 1)[1] in allowed
