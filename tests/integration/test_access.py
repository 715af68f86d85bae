"""An encrypted bus: who gets in, and what each role's words are worth there."""

from __future__ import annotations

import json
import time
from collections.abc import Iterator
from contextlib import ExitStack
from pathlib import Path

import pytest
import zenoh

from common import messages as m
from common.bus import BusSettings, Credentials, open_session
from common.errors import RouterRefused, RouterUnreachable
from common.messages import NodeUp
from tests.certificates import EXPIRED, FOREIGN, STRANGER, make_certificates, unchecked
from tests.secure_bus import Deployment, Heard, free_port, say, wait_until

HEADER = m.Header(cell="c", epoch=1, step=1)
COMMAND = m.RobotCommand.model_construct(header=HEADER, positions=[0.5])
ACTION = m.PolicyAction.model_construct(header=HEADER)
STATE = m.RobotState(header=HEADER, positions=[0.0], velocities=[0.0])
FRAME = m.StereoFrame.model_construct(header=HEADER)
TRUTH = m.GroundTruth.model_construct(header=HEADER)


@pytest.fixture(scope="module")
def certs(tmp_path_factory) -> Path:
    return make_certificates(tmp_path_factory.mktemp("access") / "certs")


@pytest.fixture
def deployment(certs) -> Iterator[Deployment]:
    with ExitStack() as stack:
        deployment = Deployment(certs, stack)
        deployment.open_router()
        yield deployment


def test_a_policy_may_act_and_may_not_command(deployment):
    _, sim = deployment.join("sim")
    policy, _ = deployment.join("policy")
    # The action comes last, by its priority too.
    wait_until(
        lambda: "cell/c/policy/action" in sim.keys,
        again=lambda: say(policy, COMMAND, STATE, FRAME, ACTION),
    )
    assert set(sim.keys) == {"cell/c/policy/action"}


def test_the_same_command_of_a_retargeter_is_heard(deployment):
    _, sim = deployment.join("sim")
    retarget, _ = deployment.join("retarget")
    wait_until(lambda: sim.keys != [], again=lambda: say(retarget, COMMAND))
    assert set(sim.keys) == {"cell/c/robot/command"}


def test_a_gripper_may_not_command_the_robot(deployment):
    _, sim = deployment.join("sim")
    gripper, _ = deployment.join("gripper")
    motor = m.MotorCommand.model_construct(header=HEADER)
    wait_until(lambda: sim.keys != [], again=lambda: say(gripper, COMMAND, motor))
    assert set(sim.keys) == {"cell/c/gripper/motor_command"}


def test_only_control_ends_an_episode(deployment):
    _, sim = deployment.join("sim")
    abort = m.EpisodeAbort(header=HEADER, reason="enough")
    policy, _ = deployment.join("policy")
    wait_until(lambda: sim.keys != [], again=lambda: say(policy, abort, ACTION))
    assert set(sim.keys) == {"cell/c/policy/action"}
    control, _ = deployment.join("control")
    wait_until(lambda: "cell/c/episode/abort" in sim.keys, again=lambda: say(control, abort))


def test_everybody_hears_only_what_is_for_them(deployment):
    sim, _ = deployment.join("sim")
    joined = {who: deployment.join(who)[1] for who in ("policy", "expert", "viewer", STRANGER)}
    frame, truth, state = "cell/c/camera/stereo", "cell/c/truth", "cell/c/robot/state"
    expected = {
        "policy": {frame},
        "expert": {frame, truth},
        "viewer": {frame, truth, state},
        STRANGER: set[str](),
    }
    wait_until(
        lambda: all(keys <= set(joined[who].keys) for who, keys in expected.items()),
        again=lambda: say(sim, STATE, TRUTH, FRAME),
    )
    # What must not come cannot be waited for.
    time.sleep(0.3)
    assert {who: set(heard.keys) for who, heard in joined.items()} == expected


def test_a_stranger_is_neither_heard_nor_seen(deployment):
    _, viewer = deployment.join("viewer")
    control, _ = deployment.join("control")
    alive = Heard()
    control.watch_alive(alive)
    stranger, _ = deployment.join(STRANGER)
    watching = Heard()
    stranger.watch_alive(watching)
    stranger.declare_alive("sim", "sim-9")
    sim, _ = deployment.join("sim")
    sim.declare_alive("sim", "sim-1")

    def speak() -> None:
        say(stranger, STATE, COMMAND, ACTION, owner="of-stranger")
        say(sim, STATE)

    wait_until(lambda: viewer.keys != [] and alive.events != [], again=speak)
    assert set(viewer.keys) == {"cell/c/robot/state"}
    assert alive.events == [NodeUp("sim", "sim-1")]
    # It sees the token that it declared itself; the router told it of none.
    assert NodeUp("sim", "sim-1") not in watching.events


def test_nobody_passes_for_a_node_of_another_kind(deployment):
    control, heard = deployment.join("control")
    alive = Heard()
    control.watch_alive(alive)
    policy, _ = deployment.join("policy")
    policy.declare_alive("sim", "sim-0")
    policy.declare_alive("policy", "sim-0")
    metrics = m.NodeMetrics.model_construct(header=m.Header())
    policy.declare_alive("policy", "policy-1")

    def speak() -> None:
        say(policy, metrics, owner="sim-0")
        say(policy, metrics, owner="policy-1")

    wait_until(lambda: heard.keys != [] and alive.events != [], again=speak)
    assert set(heard.keys) == {"metrics/policy-1"}
    assert alive.events == [NodeUp("policy", "policy-1")]


def test_only_control_asks_nodes_what_they_are(deployment):
    sim, asked = deployment.join("sim")
    sim.serve_description("sim-0", asked)
    sim.declare_alive("sim", "sim-0")
    control, _ = deployment.join("control")
    alive = Heard()
    control.watch_alive(alive)
    wait_until(lambda: alive.events != [])
    policy, _ = deployment.join("policy")
    policy.ask_description("sim-0", Heard())
    control.ask_description("sim-0", Heard())
    wait_until(lambda: asked.events != [])
    assert len(asked.events) == 1


def test_other_namespaces_are_closed(deployment):
    _, viewer = deployment.join("viewer", namespace="other")
    sim, _ = deployment.join("sim", namespace="other")
    _, own = deployment.join("viewer")
    real, _ = deployment.join("sim")

    def speak() -> None:
        say(sim, STATE)
        say(real, STATE)

    wait_until(lambda: own.keys != [], again=speak)
    assert (set(own.keys), viewer.keys) == ({"cell/c/robot/state"}, [])


def test_without_a_certificate_nobody_gets_in(deployment):
    with (
        pytest.raises(RouterUnreachable),
        open_session(BusSettings("client", f"tcp/127.0.0.1:{deployment.port}"), wait_s=0.1),
    ):
        pass
    config = zenoh.Config()
    for path, value in {
        "mode": "client",
        "scouting/multicast/enabled": False,
        "connect/endpoints": [f"tls/127.0.0.1:{deployment.port}"],
        "connect/timeout_ms": 1000,
        "transport/link/tls/root_ca_certificate": str(deployment.certs / "ca.pem"),
    }.items():
        config.insert_json5(path, json.dumps(value))
    with pytest.raises(zenoh.ZError):
        zenoh.open(config)


@pytest.mark.parametrize(
    ("who", "problem"), [(FOREIGN, "unknown ca|decrypt"), (EXPIRED, "expired")]
)
def test_a_certificate_that_is_not_good_is_refused_and_named(deployment, who, problem):
    with (
        pytest.raises(RouterRefused, match=problem),
        open_session(deployment.settings(who), wait_s=0.1),
    ):
        pass


def test_a_router_under_another_name_is_not_believed(certs):
    address = f"tls/127.0.0.2:{free_port('127.0.0.2')}"
    router = BusSettings("router", address, "lab", unchecked(certs / "router"))
    client = BusSettings("client", address, "lab", unchecked(certs / "sim"))
    with (
        open_session(router),
        pytest.raises(RouterRefused, match=r"IP address mismatch.*127\.0\.0\.2"),
        open_session(client, wait_s=0.1),
    ):
        pass


def test_a_role_cannot_pass_for_the_router(certs):
    address = f"tls/127.0.0.1:{free_port()}"
    impostor = BusSettings("router", address, "lab", unchecked(certs / "policy"))
    client = BusSettings("client", address, "lab", Credentials.from_folder(certs / "sim"))
    with open_session(impostor), pytest.raises(RouterRefused), open_session(client, wait_s=0.1):
        pass
