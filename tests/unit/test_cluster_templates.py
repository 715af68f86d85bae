"""The templates for clusters: valid for the tools that read them, and for our command line."""

from __future__ import annotations

import os
import re
import subprocess
import sys
from pathlib import Path

import kubernetes_validate
import pytest
import yaml

from client import main as cli
from client.commands import Eval
from client.sharding.shard import Shard
from client.verbs.evaluate import uses_shards

DEPLOY = Path(__file__).parents[2] / "deploy"
SBATCH = DEPLOY / "slurm" / "evaluation.sbatch"
JOB = yaml.safe_load((DEPLOY / "kubernetes" / "evaluation-job.yaml").read_text(encoding="utf-8"))
USED = ["--task", "lid", "--robot", "panda", "--policy", "expert", "--trials", "1000"]


def check_arguments(arguments: list[str], *, shard: Shard) -> None:
    command = cli.parse(Eval, arguments, program="legato eval")
    assert isinstance(command, Eval)
    assert uses_shards(command)
    assert Shard.parse(command.shard or "") == shard
    assert (command.task, command.trials) == (("lid",), 1000)


def submit(tmp_path: Path, *arguments: str, element: str) -> list[str]:
    """Run the script as Slurm does, with something that shows its arguments as `legato`."""
    show = tmp_path / "legato"
    show.write_text('#!/bin/sh\nfor each; do echo "$each"; done\n')
    show.chmod(0o755)
    done = subprocess.run(
        ["bash", SBATCH, *arguments],
        env={
            "PATH": os.environ["PATH"],
            "HOME": str(tmp_path),
            "LEGATO": str(show),
            "SLURM_ARRAY_TASK_ID": element,
        },
        cwd=tmp_path,
        capture_output=True,
        text=True,
        check=True,
        timeout=30,
    )
    return done.stdout.splitlines()


def test_an_element_of_the_slurm_array_runs_its_shard(tmp_path):
    verb, *arguments = submit(tmp_path, *USED, element="3")
    assert verb == "eval"
    check_arguments(arguments, shard=Shard(3, 16))
    assert arguments[-1] == str(tmp_path / "evaluation")


def test_arguments_of_the_slurm_script_stay_whole(tmp_path):
    assert "two words" in submit(tmp_path, "--policy", "two words", element="0")


def test_the_slurm_array_has_an_element_for_every_shard():
    text = SBATCH.read_text(encoding="utf-8")
    last = re.search(r"^#SBATCH --array=0-(\d+)$", text, re.MULTILINE)
    count = re.search(r"^SHARDS=(\d+)", text, re.MULTILINE)
    assert last is not None
    assert count is not None
    assert int(last[1]) + 1 == int(count[1])
    used = re.search(r"^#   sbatch \S+ (.*)$", text, re.MULTILINE)
    assert used is not None
    assert used[1].split() == USED


def test_the_slurm_script_passes_shellcheck():
    program = Path(sys.executable).parent / "shellcheck"
    done = subprocess.run([program, SBATCH], capture_output=True, text=True, timeout=60)
    assert (done.returncode, done.stdout) == (0, "")


@pytest.mark.parametrize("version", ["1.29", "1.33", "1.37"])
def test_the_job_is_one_for_kubernetes(version):
    """1.29 is the first that has all of its fields without a gate that is off by default."""
    kubernetes_validate.validate(JOB, version, strict=True)


def test_an_index_of_the_job_runs_its_shard():
    container = JOB["spec"]["template"]["spec"]["containers"][0]
    # The image's own program is `legato`, with the camera's kernels laid out before it.
    assert "command" not in container
    verb, *arguments = container["args"]
    assert verb == "eval"
    arguments = [word.replace("$(JOB_COMPLETION_INDEX)", "3") for word in arguments]
    check_arguments(arguments, shard=Shard(3, JOB["spec"]["completions"]))
    assert arguments[-len(USED) :] == USED


def test_the_image_of_the_job_is_a_target_of_the_dockerfile():
    container = JOB["spec"]["template"]["spec"]["containers"][0]
    target = container["image"].removeprefix("legato-").removesuffix(":latest")
    dockerfile = (DEPLOY.parent / "Dockerfile").read_text(encoding="utf-8")
    assert re.search(rf"^FROM \w+ AS {target}$", dockerfile, re.MULTILINE)
