"""`legato robot list` and `check`: what they print, and how a bad robot file is told of."""

import json
import re
import shutil
import sys
from pathlib import Path

import pytest

from client import main as cli
from common.robots import list_robots, load_robot
from common.robots.loader import ROBOTS_FOLDER


@pytest.fixture
def run(capsys):
    """Run a command line; give exit code, standard output and standard error."""

    def call(*arguments: str) -> tuple[int, str, str]:
        code = cli.run(arguments)
        captured = capsys.readouterr()
        return code, captured.out, captured.err

    return call


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """A robot of one's own, outside the package."""
    shutil.copytree(ROBOTS_FOLDER / "panda", tmp_path / "mine")
    return tmp_path / "mine"


def edit(path: Path, pattern: str, replacement: str) -> None:
    text, count = re.subn(pattern, replacement, path.read_text(), count=1)
    assert count == 1
    path.write_text(text)


def test_list(run):
    code, out, err = run("robot", "list")
    assert (code, err) == (0, "")
    rows = {line.split()[0]: line for line in out.splitlines()[2:]}
    assert list(rows) == list_robots()
    assert re.search(r"Franka Emika Panda +joints +7 +16\.7 +1\.0\d", rows["panda"])
    assert re.search(r"free_hand +0 +1\.0 +any", rows["abstract"])


def test_list_as_json_hides_no_robot_for_a_bad_one(run, folder, monkeypatch):
    edit(folder / "robot.toml", "velocity_limit = 2.175\n", "")
    robots = {"abstract": ROBOTS_FOLDER, "mine": folder.parent}
    monkeypatch.setattr("client.verbs.robot.list_robots", lambda: list(robots))
    monkeypatch.setattr(
        "client.verbs.robot.load_robot", lambda name: load_robot(name, folder=robots[name])
    )
    code, out, err = run("robot", "list", "--json")
    assert code == 1
    shown = json.loads(out)
    assert shown["robots"][0]["name"] == "abstract"
    assert shown["robots"][0]["reach_m"] is None
    assert shown["problems"][0]["code"] == "E-ROBOT-FILE"
    assert err.startswith("E-ROBOT-FILE  robot mine: joints.0.velocity_limit")


def test_check_by_name_and_by_folder(run, folder):
    code, by_name, err = run("robot", "check", "panda")
    assert (code, err) == (0, "")
    assert by_name.startswith("panda: Franka Emika Panda\n\nkinematics\n  ok ")
    assert by_name.endswith("\nno problem\n")
    code, by_folder, _ = run("robot", "check", str(folder))
    assert code == 0
    assert by_folder == by_name.replace("panda: ", "mine: ", 1)


def test_check_as_json_tells_a_problem_with_exit_code_1(run, folder):
    edit(folder / "model.xml", 'name="joint3" range="[^"]*"', 'name="joint3"')
    code, out, err = run("robot", "check", str(folder), "--json")
    assert (code, err) == (1, "")
    report = json.loads(out)
    assert report["ok"] is False
    (problem,) = [f for f in report["findings"] if f["status"] == "problem"]
    assert problem["text"] == "no range in model.xml: joint3"
    (joints,) = [f for f in report["findings"] if f["name"] == "lid joints"]
    assert joints["values"]["margins"]["joint3"] is None


@pytest.mark.parametrize(
    ("file", "pattern", "replacement", "told"),
    [
        ("robot.toml", "velocity_limit = 2.175\n", "", r"velocity_limit: Field required \(of join"),
        ("robot.toml", "kp = 4500.0", "kp = nan", r"kp: .* finite number \(of joint1\)"),
        ("robot.toml", 'title = "', 'walls = [3]\ntitle = "', "walls.0: "),
        ("robot.toml", r"bias = -2.6\d*", "bias = 1.0", "joint joint4: bias 1 is outside"),
        ("model.xml", r'<joint name="joint7"[^/]*/>', "", "joint joint7: is missing in model.xml"),
        ("model.xml", 'name="joint3" range="[^"]*"', 'name="joint3" range="2 -2"', "joint joint3"),
        ("model.xml", 'name="joint3"', 'name="joint3" axis="0 1 0"', "start: the tool is 0.6"),
        ("model.xml", 'name="joint3"', 'name="joint3" axis="0 0 0"', "axis too small .*'joint3'"),
        ("model.xml", 'name="joint3"', 'name="joint3" axis="0 nan 0"', "joint joint3: joint axis"),
        ("model.xml", 'site name="tool"', 'site name="hook"', "site tool: is missing"),
        ("model.xml", r'(name="link3"(.|\n)*?)mass="[^"]*"', r'\1mass="-1"', "mass .*'link3'"),
        (
            "model.xml",
            r'(name="link3"(.|\n)*?)mass="[^"]*"',
            r'\1mass="inf"',
            "body link3: inertia",
        ),
        ("model.xml", 'full(inertia)="[^"]*"', r'diag\1="1 1 9"', "A [+] B >= C.*'link0'"),
        ("model.xml", 'body name="link3"', "body", "body in link2: has no name"),
        ("model.xml", 'joint name="joint3"', "joint", "joint of body link3: has no name"),
        ("model.xml", "</mujoco>", "", "model.xml: XML parse error"),
        ("model.xml", 'type="hinge"', 'type="hinges"', "keyword: 'hinges', Element 'joint'"),
    ],
)
def test_a_bad_file_is_one_line_that_names_the_element(
    run, folder, file, pattern, replacement, told
):
    edit(folder / file, pattern, replacement)
    code, out, err = run("robot", "check", str(folder))
    assert (code, out) == (1, "")
    assert err.startswith("E-ROBOT-FILE  robot mine: ")
    assert err.endswith("correct the files in the folder mine\n")
    assert err.count("\n") == 1
    assert re.search(told, err)


def test_a_leg_without_length_is_refused(run, tmp_path):
    folder = tmp_path / "dog"
    shutil.copytree(ROBOTS_FOLDER / "spot", folder)
    edit(folder / "model.xml", r'(site name="foot_fl"[^>]*?) pos="[^"]*"', r"\1")
    code, _, err = run("robot", "check", str(folder))
    assert code == 1
    assert err.startswith("E-ROBOT-FILE  robot dog: leg fl: thigh or shank has no length")


@pytest.mark.parametrize(
    ("spoil", "told"),
    [
        (lambda folder: (folder / "robot.toml").unlink(), "robot.toml: the file is missing"),
        (lambda folder: (folder / "model.xml").unlink(), "model.xml: the file is missing"),
        (lambda folder: (folder / "robot.toml").write_bytes(b"\xff"), "robot.toml: 'utf-8'"),
    ],
)
def test_a_folder_without_a_readable_file(run, folder, spoil, told):
    spoil(folder)
    code, _, err = run("robot", "check", str(folder))
    assert code == 1
    assert err.startswith(f"E-ROBOT-FILE  robot mine: {told}")


def test_check_of_an_unknown_name_suggests_one(run):
    code, out, err = run("robot", "check", "pnda")
    assert (code, out) == (2, "")
    assert err.startswith('E-UNKNOWN-NAME  no robot "pnda"    did you mean: panda')


@pytest.mark.parametrize("arguments", [("list",), ("check", "panda")])
def test_without_the_packages_the_extra_is_named(run, monkeypatch, arguments):
    monkeypatch.setitem(sys.modules, "services.retarget.check", None)
    code, _, err = run("robot", *arguments)
    assert code == 2
    assert err.startswith("E-MISSING-EXTRA")
    assert "pip install 'legato[retarget]'" in err
