"""What is in the images: packages of the lock, and for clusters everything but PyTorch."""

from __future__ import annotations

import json
import re
import shutil

import pytest
from packaging.utils import canonicalize_name

from tests.compose.projects import ROOT, build, docker
from tests.locked import read_entries, version_of

pytestmark = [pytest.mark.compose, pytest.mark.usefixtures("images")]

OWN: dict[str, set[str]] = {
    "router": set(),
    "gripper": set(),
    "sim": {"mujoco-core", "numba"},
    "retarget": {"mujoco-core", "pin", "piqp", "scipy"},
    "policy": {"onnxruntime"},
    "control": {"fastapi", "sqlalchemy"},
}
OWN["eval"] = set.union({"cryptography"}, *OWN.values())
"""Of the packages that are some extra's own, those that an image has."""


@pytest.fixture(scope="session")
def eval_image(images, tmp_path_factory) -> str:
    done = build("eval", tmp_path_factory.mktemp("eval"))
    assert done.returncode == 0, done.stderr
    return "legato-eval"


def installed(target: str) -> dict[str, str]:
    """Versions of the packages in an image, by name, without our own."""
    command = "cd /venv/lib/python3*/site-packages && ls -d *.dist-info"
    listed = docker("run", "--rm", "--entrypoint=sh", f"legato-{target}", "-c", command).split()
    pairs = (name.removesuffix(".dist-info").rsplit("-", 1) for name in listed)
    return {canonicalize_name(name): version for name, version in pairs if name != "legato"}


@pytest.mark.usefixtures("eval_image")
@pytest.mark.parametrize("target", OWN)
def test_an_image_has_its_own_part_of_the_lock(target):
    lock = read_entries((ROOT / "requirements.lock").read_text())
    found = installed(target)
    assert "eclipse-zenoh" in found
    assert found == {name: version_of(lock[name][0]) for name in found}
    assert found.keys() & OWN["eval"] == OWN[target]


HASH = re.compile(r"sha256:[0-9a-f]{4}")


@pytest.mark.parametrize(
    ("file", "change", "complaint"),
    [
        ("requirements.lock", lambda text: HASH.sub("sha256:0000", text), "DO NOT MATCH THE HASH"),
        ("requirements.lock", lambda _: "", "In --require-hashes mode"),
        ("requirements-build.lock", lambda text: HASH.sub("sha256:0000", text), "DO NOT MATCH"),
    ],
    ids=["other files", "not locked", "other tools"],
)
def test_what_is_not_in_the_lock_ends_the_build(tmp_path, file, change, complaint):
    context = tmp_path / "context"
    context.mkdir()
    for name in (
        "Dockerfile",
        "pyproject.toml",
        "constraints.txt",
        "requirements.lock",
        "requirements-build.lock",
    ):
        shutil.copy(ROOT / name, context)
    (context / file).write_text(change((ROOT / file).read_text()))
    done = build("core", tmp_path, context=context)
    assert done.returncode != 0
    assert complaint in done.stderr + done.stdout


def test_the_image_for_clusters_evaluates(eval_image, tmp_path):
    tmp_path.chmod(0o777)
    hardened = ["--read-only", "--tmpfs=/tmp:size=64m", "--cap-drop=ALL", "--network=none"]
    grid = ["--task=lid", "--robot=panda", "--policy=expert", "--trials=1", "--shard=0/1"]
    docker(
        "run",
        "--rm",
        *hardened,
        f"--volume={tmp_path}:/out",
        eval_image,
        "eval",
        *grid,
        "--out=/out",
    )
    (file,) = tmp_path.glob("*.jsonl")
    trial = json.loads(file.read_text().splitlines()[1])
    assert trial["trial"]["status"] == "success"
