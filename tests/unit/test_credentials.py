"""Certificates are judged before anything is connected."""

from __future__ import annotations

import shutil
import socket

import pytest
from cryptography.hazmat.primitives import serialization

from common.bus import BusSettings, Credentials
from common.bus.grants import Grant, now
from common.errors import BadCertificate, BadGrants, InvalidValue
from tests.certificates import EXPIRED, FOREIGN, make_certificates, unchecked


@pytest.fixture(scope="module")
def certs(tmp_path_factory):
    return make_certificates(tmp_path_factory.mktemp("credentials") / "certs")


@pytest.fixture
def sim(certs, tmp_path):
    """A copy that may be spoiled."""
    return shutil.copytree(certs / "sim", tmp_path / "sim")


@pytest.mark.parametrize("role", ["router", "sim", "viewer"])
def test_what_legato_makes_is_good(certs, role):
    assert Credentials.from_folder(certs / role).certificate == certs / role / "cert.pem"


def test_it_says_in_which_cells_it_has_rights(sim):
    assert Credentials.from_folder(sim).cells == ("*",)
    grant = Grant(name="sim-a", role="sim", cells=("a", "b*"), created=now())
    (sim / "grant.json").write_text(grant.model_dump_json())
    assert Credentials.from_folder(sim).cells == ("a", "b*")
    (sim / "grant.json").write_text("{}")
    with pytest.raises(BadGrants, match=r"grant\.json"):
        Credentials.from_folder(sim)


@pytest.mark.parametrize("name", ["ca.pem", "cert.pem", "key.pem"])
def test_a_missing_file_is_named(sim, name):
    (sim / name).unlink()
    with pytest.raises(BadCertificate, match="No such file") as caught:
        Credentials.from_folder(sim)
    assert caught.value.path == str(sim / name)


@pytest.mark.parametrize("name", ["ca.pem", "cert.pem", "key.pem"])
def test_an_unreadable_file_is_named(sim, name):
    (sim / name).unlink()
    # A folder: whoever runs the tests may be allowed to read every file.
    (sim / name).mkdir()
    with pytest.raises(BadCertificate, match="Is a directory") as caught:
        Credentials.from_folder(sim)
    assert caught.value.path == str(sim / name)


@pytest.mark.parametrize(
    ("name", "problem"),
    [
        ("ca.pem", "not a certificate"),
        ("cert.pem", "not a certificate and key"),
        ("key.pem", "not a certificate and key"),
    ],
)
def test_a_damaged_file_is_refused(sim, name, problem):
    (sim / name).write_text("-----BEGIN NOTHING-----")
    with pytest.raises(BadCertificate, match=problem):
        Credentials.from_folder(sim)


def test_the_key_of_another_is_refused(certs, sim):
    shutil.copy(certs / "policy" / "key.pem", sim)
    with pytest.raises(BadCertificate, match=r"its key is not that of cert\.pem"):
        Credentials.from_folder(sim)


def test_a_key_under_a_password_is_refused_without_asking(sim):
    key = serialization.load_pem_private_key((sim / "key.pem").read_bytes(), password=None)
    locked = key.private_bytes(
        serialization.Encoding.PEM,
        serialization.PrivateFormat.PKCS8,
        serialization.BestAvailableEncryption(b"secret"),
    )
    (sim / "key.pem").write_bytes(locked)
    with pytest.raises(BadCertificate, match="not a certificate and key"):
        Credentials.from_folder(sim)


@pytest.mark.parametrize(
    ("name", "problem"), [(EXPIRED, "expired"), (FOREIGN, "unable to get local issuer|signature")]
)
def test_what_others_would_refuse_is_refused_here(certs, name, problem):
    with pytest.raises(BadCertificate, match=problem):
        Credentials.from_folder(certs / name)


def test_encryption_and_certificates_go_together(certs):
    with pytest.raises(InvalidValue, match="--certs"):
        BusSettings(endpoint="tls/robot.lab:7447")
    with pytest.raises(InvalidValue, match="--endpoint"):
        BusSettings(credentials=unchecked(certs / "sim"))
    with pytest.raises(InvalidValue, match="--endpoint"):
        BusSettings(endpoint="tls/robot.lab", credentials=unchecked(certs / "sim"))


def test_a_router_that_is_not_there_is_told_from_one_that_refuses(certs):
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        port = taken.getsockname()[1]
    own = Credentials.from_folder(certs / "sim")
    assert own.find_problem("127.0.0.1", port) == "Connection refused"
    with socket.create_server(("127.0.0.1", 0)) as plain:
        assert "said nothing" in own.find_problem("127.0.0.1", plain.getsockname()[1])
