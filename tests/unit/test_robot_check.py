"""What the robot check finds, on good robots and on spoiled ones, and what it measures them by."""

import functools
import re

import numpy as np
import pytest

from common.errors import InvalidValue, UnknownName
from common.robots import list_robots, load_robot
from common.se3 import apply_differential, distance, make_pose, pose_from_wire
from common.tasks import load_task
from common.tasks.recording import COLUMNS, Recording, list_recordings, load_recording
from common.tasks.workspaces import REGIONS, Region
from services.retarget.check import margins
from services.retarget.check.inverse import REACHED_M, REACHED_RAD, InverseKinematics
from services.retarget.check.kinematics import check_kinematics
from services.retarget.check.legs import check_legs
from services.retarget.check.masses import check_masses
from services.retarget.check.postures import draw_posture
from services.retarget.check.ranges import check_ranges
from services.retarget.check.reach import check_reach
from services.retarget.check.report import Finding, RobotReport
from services.retarget.check.robot import check_robot
from services.retarget.model import build_pinocchio_model
from services.retarget.robot_model import RobotModel

GROUPS = ["kinematics", "ranges", "masses", "legs", "reach", "margins"]

report_of = functools.cache(lambda name: check_robot(load_robot(name)))


def pick(findings, name: str) -> Finding:
    (found,) = [finding for finding in findings if finding.name == name]
    return found


@pytest.fixture
def panda() -> RobotModel:
    return RobotModel(load_robot("panda"))


@pytest.mark.parametrize("name", list_robots())
def test_every_robot_passes_every_check(name):
    report = report_of(name)
    assert [f.text for f in report.findings if f.status == "problem"] == []
    assert list(dict.fromkeys(finding.group for finding in report.findings)) == GROUPS


def test_what_does_not_apply_is_skipped_and_says_why():
    hand = {f.group: f for f in report_of("abstract").findings}
    assert {group for group in GROUPS if hand[group].status == "skipped"} == {*GROUPS} - {"masses"}
    assert hand["reach"].text == "a free hand has no joints"
    skipped = [f.group for f in report_of("panda").findings if f.status == "skipped"]
    assert skipped == ["legs"]


def test_numbers_of_a_known_robot():
    findings = report_of("panda").findings
    assert pick(findings, "total").values["mass_kg"] == pytest.approx(16.6919, abs=1e-4)
    assert pick(findings, "positions").values["difference"] < 1e-12
    assert pick(findings, "Jacobian").values["difference"] < 1e-12
    start = pick(findings, "start")
    assert start.values["joint"] == "joint5"
    assert start.values["margin"] == pytest.approx(2.8973 - 2.632474, abs=1e-6)
    assert start.text == "nearest to a limit: joint5 0.265 rad (5% of its range)"


def test_report_as_text_and_data():
    good = Finding(group="a", name="x", status="ok", text="fine", values={"n": 1.0})
    bad = Finding(group="a", name="longer", status="problem", text="joint q is bent")
    report = RobotReport(robot="r", title="R", findings=[good, bad])
    assert report.to_text() == (
        "r: R\n\na\n  ok       x       fine\n  problem  longer  joint q is bent\n\n1 problem\n"
    )
    data = report.to_json()
    assert data["ok"] is False
    assert data["findings"][0]["values"] == {"n": 1.0}


def test_a_moved_body_is_named(panda):
    whole = build_pinocchio_model(panda.mj, robot="panda")
    panda.mj.body_pos[panda.mj.body("link5").id, 0] += 1e-6
    findings = check_kinematics(panda.mj, whole, tool_site="tool")
    found = pick(findings, "positions")
    assert found.status == "problem"
    assert re.search(r"1\.0e-06 m \(link[567]\), allowed 1e-09", found.text)
    assert pick(findings, "rotations").status == "ok"


def test_a_turned_axis_is_named(panda):
    whole = build_pinocchio_model(panda.mj, robot="panda")
    panda.mj.jnt_axis[panda.mj.joint("joint7").id] = [np.sin(1e-6), 0.0, np.cos(1e-6)]
    found = pick(check_kinematics(panda.mj, whole, tool_site="tool"), "Jacobian")
    assert found.status == "problem"
    assert "column of joint7" in found.text


@pytest.mark.parametrize(
    ("field", "value", "name", "text"),
    [
        ("body_mass", -1.0, "bodies", "no positive mass: link3"),
        ("body_inertia", [1.0, 1.0, 3.0], "inertias", "no body has the inertia of link3"),
        ("body_inertia", [-1.0, 1.0, 1.0], "inertias", "no body has the inertia of link3"),
        ("body_mass", 5.0, "total", "differ by 1."),
    ],
)
def test_masses_that_cannot_be_are_named(panda, field, value, name, text):
    whole = build_pinocchio_model(panda.mj, robot="panda")
    getattr(panda.mj, field)[panda.mj.body("link3").id] = value
    found = pick(check_masses(panda.mj, whole), name)
    assert found.status == "problem"
    assert text in found.text


def test_a_start_near_its_limit_is_a_problem(panda):
    panda.upper[4] = panda.spec.joints[4].start + 1e-3
    found = pick(check_ranges(panda), "start")
    assert found.status == "problem"
    assert found.text.endswith("joint5 0.001 rad (0% of its range), expected at least 1%")


def test_a_body_range_beyond_the_legs_is_a_problem():
    model = RobotModel(load_robot("spot"))
    assert {finding.status for finding in check_legs(model)} == {"ok"}
    model.upper[[joint.name for joint in model.spec.joints].index("body_z")] += 0.5
    for finding in check_legs(model):
        assert finding.status == "problem"
        assert finding.text.startswith("body at (")
        assert "m away where the leg spans" in finding.text


def test_inverse_kinematics_finds_what_forward_kinematics_made(panda):
    inverse, random = InverseKinematics(panda, starts=16), np.random.default_rng(5)
    for _ in range(30):
        T_world_tool = panda.compute_tool_pose(draw_posture(panda.lower, panda.upper, random))
        q = inverse.solve(T_world_tool)
        assert q is not None
        error_m, error_rad = distance(T_world_tool, panda.compute_tool_pose(q))
        assert error_m <= REACHED_M
        assert error_rad <= REACHED_RAD
        assert (q >= panda.lower).all()
        assert (q <= panda.upper).all()
    assert inverse.solve(make_pose(np.eye(3), [1.6, 0.0, 0.8])) is None


def test_a_region_out_of_reach_is_a_problem_and_says_where(panda):
    far = Region(
        task="lid",
        name="grasp",
        x_m=(0.6, 1.8),
        y_m=(0.0, 0.0),
        z_m=0.8,
        yaw_rad=(0.0, 0.0),
        point_m=(0.0, 0.0, 0.0),
        turn_rad=(0.0, 0.0),
        pitch_rad=(0.5, 0.5),
        width_m=0.02,
    )
    (finding,) = check_reach(panda, [far])
    assert finding.status == "problem"
    assert finding.values["points_share"] == pytest.approx(1 / 3)
    assert finding.text.startswith(
        "1 of 3 points, 1 of 3 poses (33%); not with the object at x 1.2"
    )


@pytest.mark.parametrize("region", REGIONS, ids=lambda region: f"{region.task}-{region.name}")
def test_the_pads_are_where_the_object_is_held(region):
    """At their opening the pads are 0.27 to 0.29 m ahead of the tool frame, along its x axis."""
    for T_world_object in region.list_objects():
        p_world_point = (T_world_object @ [*region.point_m, 1.0])[:3]
        for turn in region.list_turns():
            T = region.place_tool(T_world_object, turn)
            assert T[:3, :3].T @ T[:3, :3] == pytest.approx(np.eye(3), abs=1e-12)
            assert T[2, 0] == pytest.approx(-np.sin(turn.pitch_rad))
            level = T[:3, 0] * [1, 1, 0] / np.cos(turn.pitch_rad)
            on_axis = p_world_point - region.before_m * level - T[:3, 3]
            assert on_axis / np.linalg.norm(on_axis) == pytest.approx(T[:3, 0], abs=1e-9)
            assert 0.27 < np.linalg.norm(on_axis) < 0.29


def test_the_regions_of_the_lid_are_its_spawn_ranges():
    grasp, place = (region for region in REGIONS if region.task == "lid")
    seen = {"lid": [], "pot": []}
    for seed in range(2000):
        for spawned in load_task("lid").spawn(np.random.default_rng(seed)):
            if spawned.name in seen:
                T = spawned.T_world_object
                seen[spawned.name].append([*T[:3, 3], np.arctan2(T[1, 0], T[0, 0])])
    lid, pot = np.array(seen["lid"]), np.array(seen["pot"])
    for column, (least, largest) in enumerate((grasp.x_m, grasp.y_m)):
        # Corners are rare: two draws add up.
        assert lid[:, column].min() == pytest.approx(least, abs=0.01)
        assert lid[:, column].max() == pytest.approx(largest, abs=0.01)
        assert least <= lid[:, column].min() <= lid[:, column].max() <= largest
    assert (lid[:, 3].min(), lid[:, 3].max()) == pytest.approx(grasp.yaw_rad, abs=1e-2)
    assert (pot[:, 0].min(), pot[:, 0].max()) == pytest.approx(place.x_m, abs=1e-3)
    assert (pot[:, 1].min(), pot[:, 1].max()) == pytest.approx(place.y_m, abs=1e-3)
    assert lid[0, 2] == pytest.approx(grasp.z_m, abs=1e-3)
    assert pot[0, 2] + 0.090 == pytest.approx(place.z_m, abs=2e-3)


def test_the_recording_is_a_demonstration_of_the_lid():
    recording = load_recording("lid")
    assert list_recordings() == ["lid"]
    start_m, start_rad = distance(
        pose_from_wire(load_robot("panda").T_world_start), recording.T_world_setpoint[0]
    )
    assert max(start_m, start_rad) < 1e-4
    closed = np.flatnonzero(recording.grasp)
    assert (np.diff(closed) == 1).all()
    assert 0 < closed[0] < closed[-1] < len(recording.grasp) - 1
    T = recording.T_world_setpoint[0]
    for action, T_wanted, grasp in zip(
        recording.list_actions(),
        recording.T_world_setpoint[1:],
        recording.grasp[1:],
        strict=True,
    ):
        assert np.linalg.norm(action.translation_m) < 0.03
        T = apply_differential(T, action.translation_m, action.rotation_rad)
        assert max(distance(T, T_wanted)) < 1e-7
        assert action.grasp == grasp


@pytest.mark.parametrize(
    ("lines", "field"),
    [
        (["t,x", "0.0,0"], "lid.csv"),
        ([",".join(COLUMNS), "0.0,0,0,0,1,0,0,0,0"], "lid.csv"),
        ([",".join(COLUMNS), "0.0,0,0,0,1,0,0,0,0", "0.2,0,0,0,1,0,0,0,0"], "lid.csv, line 3"),
        ([",".join(COLUMNS), "0.0,0,0,0,1,0,0,0,0", "0.1,0,0,0,1,1,0,0,0"], "lid.csv, line 3"),
        ([",".join(COLUMNS), "0.0,0,0,0,1,0,0,0,2", "0.1,0,0,0,1,0,0,0,0"], "lid.csv, line 2"),
        ([",".join(COLUMNS), "0.0,nan,0,0,1,0,0,0,0", "0.1,0,0,0,1,0,0,0,0"], "lid.csv, line 2"),
        ([",".join(COLUMNS), "0.0,0,0,0,1,0,0,0", "0.1,0,0,0,1,0,0,0,0"], "lid.csv, line 2"),
        ([",".join(COLUMNS), "0.0,a,0,0,1,0,0,0,0", "0.1,0,0,0,1,0,0,0,0"], "lid.csv, line 2"),
        ([], "lid.csv"),
    ],
)
def test_a_recording_that_is_none_is_refused(tmp_path, lines, field):
    (tmp_path / "lid.csv").write_text("\n".join(lines))
    with pytest.raises(InvalidValue) as caught:
        load_recording("lid", folder=tmp_path)
    assert caught.value.field == field


def test_a_task_without_recording_is_named():
    with pytest.raises(UnknownName, match="known: lid"):
        load_recording("lidd")


def test_margins_tell_every_joint():
    found = pick(report_of("panda").findings, "lid joints")
    names = [joint.name for joint in load_robot("panda").joints]
    assert sorted(found.values["margins"]) == names
    assert found.values["margin"] == found.values["margins"][found.values["joint"]]
    assert found.values["at_limit_share"] == {}


def test_a_demonstration_that_cannot_be_followed_is_a_problem(panda, monkeypatch):
    T_start = panda.compute_tool_pose(np.array(panda.spec.start_positions))
    poses = [apply_differential(T_start, [0.03 * i, 0.0, 0.0], [0.0] * 3) for i in range(60)]
    monkeypatch.setattr(
        margins, "load_recording", lambda task: Recording(task, tuple(poses), (False,) * 60)
    )
    findings = margins.check_margins(panda)
    hand = pick(findings, "lid hand")
    assert hand.status == "problem"
    assert hand.values["largest_m"] > margins.LARGEST_LIMIT_M
    assert pick(findings, "lid bounds").values["held_back_share"] > 0.5
    joints = pick(findings, "lid joints")
    assert joints.status == "ok"
    assert joints.values["at_limit_share"]
    assert "share of time at a limit: " in joints.text
