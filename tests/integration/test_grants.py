"""Certificates with rights in some cells: what they are worth on the bus, and once revoked."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path

import pytest

from client import main as cli
from common import messages as m
from common.bus.grants import read_grants
from common.topics import topic_of
from tests.certificates import make_certificates
from tests.secure_bus import WAIT_S, Deployment, free_port, say, wait_until

A, B = "cell/a", "cell/b-1"
EVERYTHING = {"stolen sees", "stolen acts", "good sees", "good acts"}


def frame(cell: str) -> m.StereoFrame:
    return m.StereoFrame.model_construct(header=m.Header(cell=cell, epoch=1))


def action(cell: str) -> m.PolicyAction:
    return m.PolicyAction.model_construct(header=m.Header(cell=cell, epoch=1))


def add(certs: Path, role: str, name: str, *cells: str) -> None:
    arguments = ["certs", "add", role, f"--name={name}", f"--out={certs}"]
    assert cli.run([*arguments, *(f"--cell={cell}" for cell in cells)]) == 0


@pytest.fixture(scope="module")
def certs(tmp_path_factory) -> Path:
    folder = make_certificates(tmp_path_factory.mktemp("grants") / "certs")
    add(folder, "policy", "policy-a", "a")
    add(folder, "policy", "policy-b", "b-*")
    add(folder, "sim", "sim-a", "a")
    return folder


@pytest.fixture
def deployment(certs) -> Iterator[Deployment]:
    grants = read_grants(certs / "router").grants
    with ExitStack() as stack:
        deployment = Deployment(certs, stack)
        deployment.open_router(grants)
        yield deployment


def test_a_policy_sees_the_cameras_of_its_cells_only(deployment):
    sim, _ = deployment.join("sim")
    bus, seen_by_a = deployment.join("policy-a")
    # By name too, not only among all cells.
    bus.subscribe(topic_of(m.StereoFrame), seen_by_a, owner="b-1")
    _, seen_by_b = deployment.join("policy-b")
    # In this order they would come.
    wait_until(
        lambda: bool(seen_by_a.keys and seen_by_b.keys),
        again=lambda: say_each(sim, frame("b-1"), frame("a"), frame("b-1")),
    )
    assert set(seen_by_a.keys) == {f"{A}/camera/stereo"}
    assert set(seen_by_b.keys) == {f"{B}/camera/stereo"}


def test_a_policy_acts_in_its_cells_only(deployment):
    _, sim = deployment.join("sim")
    first, _ = deployment.join("policy-a")
    wait_until(lambda: sim.keys != [], again=lambda: say_each(first, action("b-1"), action("a")))
    assert set(sim.keys) == {f"{A}/policy/action"}
    second, _ = deployment.join("policy-b")
    wait_until(
        lambda: f"{B}/policy/action" in sim.keys,
        again=lambda: say_each(second, action("a"), action("b-1")),
    )
    assert set(sim.keys) == {f"{A}/policy/action", f"{B}/policy/action"}


def test_nobody_acts_in_all_cells_by_a_wildcard(deployment):
    _, sim = deployment.join("sim")
    everywhere = "cell/*/policy/action"

    def speak(who: str) -> None:
        for owner in ("*", "b-$*", "a"):
            say(buses[who], action("a"), owner=owner)

    buses = {who: deployment.join(who)[0] for who in ("policy-a", "policy")}
    wait_until(lambda: sim.keys != [], again=lambda: speak("policy-a"))
    assert set(sim.keys) == {f"{A}/policy/action"}
    # Of somebody with rights in all cells it would have come.
    wait_until(lambda: everywhere in sim.keys, again=lambda: speak("policy"))


def test_other_rights_are_those_of_the_role(deployment):
    control, heard = deployment.join("control")
    policy, _ = deployment.join("policy-a")
    metrics = m.NodeMetrics.model_construct(header=m.Header())
    command = m.RobotCommand.model_construct(header=m.Header(cell="a", epoch=1))
    _, sim = deployment.join("sim-a")

    def speak() -> None:
        say(policy, metrics, owner="sim-0")
        say(policy, metrics, owner="policy-gpu1")
        say_each(policy, command, action("a"))

    wait_until(lambda: bool(heard.keys and sim.keys), again=speak)
    assert set(heard.keys) == {"metrics/policy-gpu1"}
    assert set(sim.keys) == {f"{A}/policy/action"}
    configure = [
        m.EpisodeConfigure.model_construct(header=m.Header(cell=cell, epoch=1))
        for cell in ("b-1", "a")
    ]
    wait_until(
        lambda: f"{A}/episode/configure" in sim.keys, again=lambda: say_each(control, *configure)
    )
    assert f"{B}/episode/configure" not in sim.keys


@pytest.mark.processes
def test_a_revoked_certificate_is_worth_nothing_once_the_router_has_started_again(tmp_path, capsys):
    certs = make_certificates(tmp_path / "certs")
    add(certs, "policy", "policy-good", "a")
    add(certs, "policy", "policy-stolen", "*")
    with ExitStack() as stack:
        deployment = Deployment(certs, stack)
        with router_process(deployment):
            assert talk(deployment, until=EVERYTHING) == EVERYTHING
        assert cli.run(["certs", "revoke", "policy-stolen", f"--out={certs}"]) == 0
        assert "start it again" in capsys.readouterr().out
        with router_process(deployment):
            left = {"good sees", "good acts"}
            assert talk(deployment, until=left) == left


@pytest.mark.processes
def test_a_router_does_not_guess_at_rights(tmp_path):
    certs = make_certificates(tmp_path / "certs")
    add(certs, "policy", "policy-a", "a")
    file = certs / "router" / "grants.json"
    file.write_text(file.read_text().replace('"cells"', '"cell"'))
    arguments = (f"--listen=127.0.0.1:{free_port()}", f"--certs={certs / 'router'}")
    done = subprocess.run(
        [sys.executable, "-m", "services.router", *arguments],
        capture_output=True,
        text=True,
        timeout=120,
    )
    assert done.returncode == 1
    last = done.stderr.splitlines()[-1]
    assert last.startswith("E-GRANTS ")
    assert str(file) in last
    assert "grants.0.cells: Field required" in last


def say_each(bus, *messages: m.Message) -> None:
    """Each on the key of the cell that it speaks of."""
    for message in messages:
        say(bus, message, owner=message.header.cell)


def talk(deployment: Deployment, *, until: set[str]) -> set[str]:
    """What works, among two policies that see and act, once `until` has several times."""
    with ExitStack() as stack:
        here = Deployment(deployment.certs, stack, deployment.port)
        sim, acted = here.join("sim")
        stolen, seen_by_stolen = here.join("policy-stolen")
        good, seen_by_good = here.join("policy-good")

        def speak() -> None:
            say_each(sim, frame("b-1"), frame("a"))
            say_each(stolen, action("b-1"))
            say_each(good, action("a"))

        def count() -> dict[str, int]:
            return {
                "stolen sees": seen_by_stolen.keys.count(f"{B}/camera/stereo"),
                "stolen acts": acted.keys.count(f"{B}/policy/action"),
                "good sees": seen_by_good.keys.count(f"{A}/camera/stereo"),
                "good acts": acted.keys.count(f"{A}/policy/action"),
            }

        # The others have tried as often by then.
        wait_until(lambda: all(count()[what] >= 3 for what in until), again=speak)
        return {what for what, times in count().items() if times}


@contextmanager
def router_process(deployment: Deployment) -> Iterator[None]:
    process = subprocess.Popen(
        [
            *(sys.executable, "-m", "services.router", "--log-level=ERROR"),
            *(f"--listen=127.0.0.1:{deployment.port}", f"--namespace={deployment.namespace}"),
            f"--certs={deployment.certs / 'router'}",
        ]
    )
    try:
        yield
    finally:
        process.terminate()
        assert process.wait(WAIT_S) == 0
