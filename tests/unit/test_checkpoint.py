from __future__ import annotations

import hashlib
import json
import re
import shutil
from pathlib import Path

import pytest
import torch

from common.errors import InvalidValue, NotWritable
from services.policy.learning import checkpoint_weights, onnx_export
from services.policy.learning.checkpoint import (
    EvaluationRow,
    load_checkpoint,
    save_checkpoint,
    with_evaluation,
)
from services.policy.learning.checkpoint_errors import (
    CheckpointError,
    DamagedCheckpoint,
    ExportDiffers,
    MissingStatistics,
    NoCheckpoint,
    ShapesDiffer,
    UnsupportedCheckpoint,
)
from services.policy.learning.checkpoint_weights import load_network
from services.policy.learning.presets import PRESETS
from tests.checkpoints import (
    make_card,
    make_config,
    make_network,
    make_statistics,
    write_checkpoint,
)

FILES = {"model.safetensors", "model.onnx", "config.json", "stats.json", "card.json", "README.md"}


@pytest.fixture(scope="module")
def saved(tmp_path_factory) -> Path:
    return write_checkpoint(tmp_path_factory.mktemp("saved") / "small")


@pytest.fixture
def folder(saved: Path, tmp_path: Path) -> Path:
    """A copy to break."""
    return Path(shutil.copytree(saved, tmp_path / "small"))


def edit(path: Path, **changes: object) -> None:
    path.write_text(json.dumps(json.loads(path.read_text()) | changes))


def seal(folder: Path) -> None:
    """Make the hashes fit what the files are now."""

    def sha(path: Path) -> str:
        return hashlib.sha256(path.read_bytes()).hexdigest()

    names = ("model.safetensors", "config.json", "stats.json")
    lines = "".join(f"{name} {sha(folder / name)}\n" for name in names)
    whole = hashlib.sha256(lines.encode()).hexdigest()
    edit(folder / "card.json", sha256=whole, graph_sha256=sha(folder / "model.onnx"))


def test_what_is_saved_is_loaded(tmp_path: Path):
    network = make_network()
    config, statistics, card = make_config(network), make_statistics(), make_card()
    folder = tmp_path / "new" / "small"
    sha256 = save_checkpoint(folder, network, config=config, statistics=statistics, card=card)
    assert {path.name for path in folder.iterdir()} == FILES
    assert [path.name for path in folder.parent.iterdir()] == ["small"]
    loaded = load_checkpoint(folder)
    assert (loaded.sha256, loaded.config, loaded.statistics) == (sha256, config, statistics)
    assert loaded.card == card
    weights = load_network(loaded).state_dict()
    assert weights.keys() == network.state_dict().keys()
    for name, tensor in network.state_dict().items():
        assert torch.equal(weights[name], tensor)


def test_the_hash_is_that_of_weights_config_and_statistics(tmp_path: Path, saved: Path):
    same = write_checkpoint(tmp_path / "same")
    others = [
        write_checkpoint(tmp_path / "weights", seed=1),
        write_checkpoint(tmp_path / "config", tasks=("lid", "cup")),
    ]
    hashes = [load_checkpoint(each).sha256 for each in (saved, same, *others)]
    assert hashes[0] == hashes[1]
    assert len(set(hashes)) == 3


def test_saving_leaves_network_and_random_numbers_alone(tmp_path: Path):
    network = make_network(history={"dropout": 0.5}).train()
    before = {name: tensor.clone() for name, tensor in network.state_dict().items()}
    random = torch.get_rng_state()
    save_checkpoint(
        tmp_path / "small",
        network,
        config=make_config(network),
        statistics=make_statistics(),
        card=make_card(),
    )
    load_network(load_checkpoint(tmp_path / "small"))
    assert network.training
    assert torch.equal(torch.get_rng_state(), random)
    assert all(torch.equal(before[name], each) for name, each in network.state_dict().items())


def test_a_failed_save_leaves_the_old_checkpoint(folder: Path, monkeypatch):
    before = load_checkpoint(folder)

    def export(path: Path, *_: object) -> None:
        path.write_bytes(b"part of a graph")
        raise ExportDiffers("means", 1.0, 1e-5)

    monkeypatch.setattr(onnx_export, "export_graph", export)
    network = make_network(seed=5)
    with pytest.raises(ExportDiffers):
        save_checkpoint(
            folder,
            network,
            config=make_config(network),
            statistics=make_statistics(),
            card=make_card(),
        )
    assert load_checkpoint(folder) == before
    assert [path.name for path in folder.parent.iterdir()] == ["small"]


def test_a_wrong_graph_is_not_kept(tmp_path: Path, monkeypatch):
    """The comparison sees a graph whose weights are not the network's."""
    other = make_network(seed=9)
    real = checkpoint_weights.write_weights
    monkeypatch.setattr(
        checkpoint_weights, "write_weights", lambda path, _network: real(path, other)
    )
    with pytest.raises(ExportDiffers):
        write_checkpoint(tmp_path / "small")
    assert list(tmp_path.iterdir()) == []


def test_saving_refuses_another_network_and_a_folder_of_something_else(tmp_path: Path):
    network = make_network()
    rest = {"statistics": make_statistics(), "card": make_card()}
    other = make_config(make_network(window=7))
    with pytest.raises(InvalidValue, match=r"config\.network"):
        save_checkpoint(tmp_path / "small", network, config=other, **rest)
    (tmp_path / "photos").mkdir()
    with pytest.raises(InvalidValue, match="photos"):
        save_checkpoint(tmp_path / "photos", network, config=make_config(network), **rest)
    (tmp_path / "file").touch()
    with pytest.raises(NotWritable):
        save_checkpoint(tmp_path / "file" / "x", network, config=make_config(network), **rest)


def test_evaluations_go_to_the_card_and_not_into_the_hash(folder: Path):
    before = load_checkpoint(folder)
    row = EvaluationRow.of(
        robot="panda", task="lid", successes=45, trials=50, conditions="80 ms | lag"
    )
    after = with_evaluation(folder, [row])
    assert after.sha256 == before.sha256
    assert after.card.evaluations == (row,)
    assert load_checkpoint(folder) == after
    assert 0.78 < row.low95 < 0.79
    readme = (folder / "README.md").read_text()
    assert "| lid | panda | 45 / 50 | 78.6% – 95.7% | 80 ms \\| lag |" in readme
    assert before.sha256 in readme
    assert with_evaluation(folder, []).card == before.card


@pytest.mark.parametrize("name", sorted(FILES - {"README.md", "stats.json"}))
def test_a_missing_file_is_named(folder: Path, name: str):
    (folder / name).unlink()
    with pytest.raises(NoCheckpoint, match=re.escape(name)):
        load_checkpoint(folder)


def test_a_missing_folder_is_named(tmp_path: Path):
    with pytest.raises(NoCheckpoint, match="folder of that name"):
        load_checkpoint(tmp_path / "none")


def test_missing_statistics_are_never_made_up(folder: Path):
    (folder / "stats.json").unlink()
    with pytest.raises(MissingStatistics, match="no unit") as caught:
        load_checkpoint(folder)
    assert caught.value.code == "E-MISSING-STATISTICS"


@pytest.mark.parametrize(
    ("field", "value", "what"),
    [
        ("schema_version", 2, "schema"),
        ("action", "absolute-pose-v1", "action convention"),
        ("action", None, "action convention"),
    ],
)
def test_another_schema_or_convention_is_refused(folder: Path, field, value, what):
    edit(folder / "config.json", **{field: value})
    seal(folder)
    with pytest.raises(UnsupportedCheckpoint, match=what) as caught:
        load_checkpoint(folder)
    assert caught.value.got == value


@pytest.mark.parametrize("name", sorted(FILES - {"README.md", "card.json"}))
def test_a_changed_file_is_seen(folder: Path, name: str):
    path = folder / name
    changed = bytearray(path.read_bytes())
    if path.suffix == ".json":
        changed += b"\n"
    else:
        changed[-1] ^= 1
    path.write_bytes(changed)
    with pytest.raises(DamagedCheckpoint, match=re.escape(name)):
        load_checkpoint(folder)


@pytest.mark.parametrize("text", ["", "[]", "{", '{"schema_version": 1}'])
def test_what_is_not_a_config_is_refused(folder: Path, text: str):
    (folder / "config.json").write_text(text)
    with pytest.raises(CheckpointError):
        load_checkpoint(folder)


@pytest.mark.parametrize("name", ["stats.json", "card.json"])
def test_unknown_fields_are_refused(folder: Path, name: str):
    edit(folder / name, surprise=1)
    with pytest.raises(DamagedCheckpoint, match="surprise"):
        load_checkpoint(folder)


def test_weights_of_other_shapes_are_refused(folder: Path, tmp_path: Path):
    other = write_checkpoint(tmp_path / "other", mlp={"layers": 2, "width": 24})
    shutil.copy(other / "model.safetensors", folder)
    seal(folder)
    with pytest.raises(ShapesDiffer, match=r"grasp\.weight") as caught:
        load_network(load_checkpoint(folder))
    assert "24" in caught.value.got_shape


def test_weights_that_are_cut_off_are_refused(folder: Path):
    path = folder / "model.safetensors"
    path.write_bytes(path.read_bytes()[:-100])
    seal(folder)
    with pytest.raises(DamagedCheckpoint, match="safetensors"):
        load_network(load_checkpoint(folder))


def test_the_image_size_is_said_once():
    with pytest.raises(ValueError, match=r"image\.px"):
        make_config(make_network(), image={"px": 128})


def test_a_shipped_policy_is_at_most_20_mb(tmp_path: Path):
    network = checkpoint_weights.PolicyNetwork(PRESETS["legato-compact"])
    folder = tmp_path / "tiny"
    save_checkpoint(
        folder,
        network,
        config=make_config(network),
        statistics=make_statistics(),
        card=make_card(),
    )
    assert sum(path.stat().st_size for path in folder.iterdir()) < 20e6
