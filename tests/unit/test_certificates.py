"""The authority and its certificates, by OpenSSL's judgement where it is there."""

from __future__ import annotations

import json
import shutil
import stat
import subprocess

import pytest
from cryptography import x509
from cryptography.x509.oid import ExtendedKeyUsageOID as Purpose
from cryptography.x509.oid import NameOID

from client import main as cli
from client.certificates import create_authority, open_authority
from common.bus.access import ROLES, role_named
from common.errors import BadCertificate, InvalidValue

FILES = {"ca.pem", "cert.pem", "key.pem"}


@pytest.fixture
def folder(tmp_path):
    create_authority(tmp_path / "certs", hosts=["robot.lab", "10.0.0.5", "fd00::1"], days=30)
    return tmp_path / "certs"


def certificate(folder, role):
    return x509.load_pem_x509_certificate((folder / role / "cert.pem").read_bytes())


def extension(folder, role, kind):
    return certificate(folder, role).extensions.get_extension_for_class(kind).value


def test_every_role_has_a_folder_of_its_own(folder):
    roles = {role.name for role in ROLES}
    assert {path.name for path in folder.iterdir()} == roles | {"ca.pem", "ca.key"}
    for role in roles:
        assert {path.name for path in (folder / role).iterdir()} == FILES
        subject = certificate(folder, role).subject.get_attributes_for_oid(NameOID.COMMON_NAME)
        assert [each.value for each in subject] == [role]
    keys = {(folder / role / "key.pem").read_bytes() for role in roles}
    assert len(keys) == len(roles)


def test_keys_are_for_their_owner_only(folder):
    keys = [folder / "ca.key", *folder.glob("*/key.pem")]
    assert len(keys) == len(ROLES) + 1
    assert {stat.S_IMODE(key.stat().st_mode) for key in keys} == {0o600}


@pytest.mark.parametrize("role", [role.name for role in ROLES])
def test_the_authority_has_signed_it(folder, role):
    authority = x509.load_pem_x509_certificate((folder / "ca.pem").read_bytes())
    certificate(folder, role).verify_directly_issued_by(authority)
    if shutil.which("openssl") is not None:
        purpose = "sslserver" if role == "router" else "sslclient"
        arguments = ("verify", "-x509_strict", "-purpose", purpose, "-CAfile")
        files = (folder / "ca.pem", folder / role / "cert.pem")
        done = subprocess.run(["openssl", *arguments, *files], capture_output=True, text=True)
        assert done.returncode == 0, done.stderr


def test_only_a_router_can_pass_for_one(folder):
    serves = {
        role.name
        for role in ROLES
        if Purpose.SERVER_AUTH in extension(folder, role.name, x509.ExtendedKeyUsage)
    }
    assert serves == {"router"}
    names = extension(folder, "router", x509.SubjectAlternativeName)
    assert names.get_values_for_type(x509.DNSName) == ["localhost", "router", "robot.lab"]
    addresses = [str(each) for each in names.get_values_for_type(x509.IPAddress)]
    assert addresses == ["127.0.0.1", "::1", "10.0.0.5", "fd00::1"]


def test_no_role_can_sign(folder):
    for role in ROLES:
        assert not extension(folder, role.name, x509.BasicConstraints).ca
        assert not extension(folder, role.name, x509.KeyUsage).key_cert_sign


def test_nothing_is_overwritten(folder):
    before = {path: path.read_bytes() for path in folder.rglob("*.*")}
    with pytest.raises(InvalidValue, match="legato certs add"):
        create_authority(folder, hosts=[], days=1)
    with pytest.raises(InvalidValue, match="a name without a certificate"):
        open_authority(folder).issue(role_named("sim"), name="sim", hosts=[], days=1)
    assert {path: path.read_bytes() for path in folder.rglob("*.*")} == before


def test_a_host_is_added_later(folder):
    added = open_authority(folder).issue(
        role_named("router"), name="router-2", hosts=["new.lab"], days=1
    )
    assert (added / "ca.pem").read_bytes() == (folder / "ca.pem").read_bytes()
    names = extension(folder, "router-2", x509.SubjectAlternativeName)
    assert "new.lab" in names.get_values_for_type(x509.DNSName)


@pytest.mark.parametrize("host", ["robot lab", "robot:7447", "", "münchen.lab", "tls/robot"])
def test_what_is_no_host_is_refused(tmp_path, host):
    with pytest.raises(InvalidValue, match="--host"):
        create_authority(tmp_path / "certs", hosts=[host], days=1)
    assert not (tmp_path / "certs").exists()


def test_only_routers_have_hosts(folder):
    with pytest.raises(InvalidValue, match="only routers"):
        open_authority(folder).issue(role_named("sim"), name="sim-2", hosts=["a.lab"], days=1)


@pytest.mark.parametrize(
    ("spoil", "problem"),
    [
        (lambda key: key.unlink(), "No such file"),
        (lambda key: key.write_text("no key"), "not a certificate and key"),
    ],
)
def test_an_authority_without_its_key_adds_nothing(folder, spoil, problem):
    spoil(folder / "ca.key")
    with pytest.raises(BadCertificate, match=problem):
        open_authority(folder)


def test_the_command_line_says_what_goes_where(tmp_path, capsys):
    out = tmp_path / "certs"
    assert cli.run(["certs", "create", "--out", str(out), "--host", "robot.lab"]) == 0
    told = capsys.readouterr().out
    assert all(f"{out / role.name} " in told for role in ROLES)
    assert f"{out / 'ca.key'}" in told
    assert cli.run(["certs", "add", "policy", "--out", str(out), "--name", "gpu-2"]) == 0
    assert f"{out / 'gpu-2'} " in capsys.readouterr().out
    assert cli.run(["certs", "add", "policy", "--out", str(out)]) == 2
    assert cli.run(["certs", "add", "polcy", "--out", str(out)]) == 2
    assert cli.run(["certs", "add", "sim", "--out", str(out), "--name", "a/b"]) == 2
    assert cli.run(["certs", "add", "sim", "--out", str(out), "--days", "0"]) == 2
    assert {path.name for path in out.iterdir() if path.is_dir()} == {
        *(role.name for role in ROLES),
        "gpu-2",
    }


def test_rights_in_some_cells_are_given_listed_and_revoked(folder, capsys):
    out = f"--out={folder}"
    add = ["certs", "add", "policy", "--name=policy-gpu1", "--cell=sim-lab1", "--cell=sim-b*"]
    assert cli.run([*add, out]) == 0
    told = capsys.readouterr().out
    assert f"{folder / 'policy-gpu1'} " in told
    assert f"the router reads {folder / 'router' / 'grants.json'} when it starts" in told
    assert {path.name for path in (folder / "policy-gpu1").iterdir()} == FILES | {"grant.json"}
    subject = certificate(folder, "policy-gpu1").subject
    names = subject.get_attributes_for_oid(NameOID.COMMON_NAME)
    assert [each.value for each in names] == ["policy-gpu1"]
    assert listed(out, capsys)["policy-gpu1"] == ("policy", ["sim-lab1", "sim-b*"], False)
    assert cli.run(["certs", "revoke", "policy-gpu1", out]) == 0
    assert "start it again" in capsys.readouterr().out
    shutil.rmtree(folder / "policy-gpu1")
    rows = listed(out, capsys)
    assert rows.pop("policy-gpu1") == ("policy", ["sim-lab1", "sim-b*"], True)
    assert rows == {role.name: (role.name, ["*"], False) for role in ROLES}
    assert cli.run(["certs", "list", out]) == 0
    (row,) = (row for row in capsys.readouterr().out.splitlines() if "gpu1" in row)
    assert row.split()[:5] == ["policy-gpu1", "policy", "sim-lab1", "sim-b*", "?"]
    assert cli.run([*add, out]) == 2
    assert "never had" in capsys.readouterr().err


def listed(out, capsys):
    capsys.readouterr()
    assert cli.run(["certs", "list", "--json", out]) == 0
    rows = json.loads(capsys.readouterr().out)["certificates"]
    return {row["name"]: (row["role"], row["cells"], row["revoked"] is not None) for row in rows}


def test_a_role_cannot_be_revoked_singly(folder, capsys):
    assert cli.run(["certs", "add", "policy", "--name=gpu-2", f"--out={folder}"]) == 0
    for name in ("policy", "gpu-2"):
        assert cli.run(["certs", "revoke", name, f"--out={folder}"]) == 2
        error = capsys.readouterr().err
        assert error.startswith(f"E-NOT-REVOCABLE  the certificate {name} ")
        assert "legato certs create" in error
    assert cli.run(["certs", "revoke", "gpu-3", f"--out={folder}"]) == 2
    assert "E-UNKNOWN-NAME" in capsys.readouterr().err
    assert not (folder / "router" / "grants.json").exists()


@pytest.mark.parametrize(
    ("wrong", "problem"),
    [
        (("policy", "--cell=a"), "--name is None"),
        (("policy", "--cell=a", "--name=sim"), "--name is 'sim'"),
        (("policy", "--cell=a", "--name=a/b"), "--name is 'a/b'"),
        (("policy", "--cell=a*b", "--name=p"), "--cell is 'a*b'"),
        (("policy", "--cell=a", "--name=p", "--host=h"), "only routers"),
        (
            ("control", "--cell=a", "--name=p"),
            "only sim, retarget, gripper, policy, expert, viewer",
        ),
        (("router", "--cell=a", "--name=p"), "only sim, retarget, gripper, policy, expert, viewer"),
    ],
)
def test_rights_in_some_cells_that_cannot_be_meant(folder, capsys, wrong, problem):
    assert cli.run(["certs", "add", *wrong, f"--out={folder}"]) == 2
    assert problem in capsys.readouterr().err
    assert not (folder / "router" / "grants.json").exists()


def test_a_list_needs_an_authority_and_good_certificates(folder, tmp_path, capsys):
    assert cli.run(["certs", "list", f"--out={tmp_path / 'none'}"]) == 2
    assert "legato certs create" in capsys.readouterr().err
    (folder / "sim" / "cert.pem").write_text("nothing")
    assert cli.run(["certs", "list", f"--out={folder}"]) == 2
    assert "E-CERTIFICATE" in capsys.readouterr().err
