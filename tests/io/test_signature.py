"""A laboratory's signature: good for what was signed with that key, and for nothing else."""

import base64
import json
import shutil
import subprocess

import pytest

import irbcal
from irbcal.errors import CalibrationError, OptionError
from irbcal.io import calibration_folder, integrity

pytest.importorskip("cryptography")


@pytest.fixture
def signed(folder, tmp_path):
    """A signed calibration, the public key, and that of another laboratory."""
    out = tmp_path / "calibration"
    shutil.copytree(folder, out)
    for name in ("lab", "other"):
        irbcal.sign(out, tmp_path / f"{name}.pem", new_key=True)
    irbcal.sign(out, tmp_path / "lab.pem")
    return out, tmp_path / "lab.pub", tmp_path / "other.pub"


def test_the_signature_of_a_folder(signed):
    folder, key, other = signed
    assert irbcal.verify(folder).signature == "unchecked"
    assert "--public-key" in irbcal.verify(folder).summary()
    assert irbcal.verify(folder, public_key=key).signature == "good"
    found = irbcal.verify(folder, public_key=other)
    assert not found
    assert found.differences == ("it was not signed with this key",)
    assert (key.with_suffix(".pem").stat().st_mode & 0o777) == 0o600


def test_a_new_seal_is_no_signature(signed):
    folder, key, _ = signed
    content = json.loads((folder / "calibration.json").read_text())
    content["notes"].append("trust me")
    (folder / "calibration.json").write_text(json.dumps(integrity.sealed(content)))
    unproven = irbcal.verify(folder)
    assert unproven
    assert unproven.signature == "stale"
    found = irbcal.verify(folder, public_key=key)
    assert found.signature == "bad"
    assert found.differences == ("it was changed after it was signed",)
    (folder / "report.html").write_text("another page")
    irbcal.verify(folder, reseal="a page")
    assert not irbcal.verify(folder, public_key=key)
    (folder / "signature.json").unlink()
    assert irbcal.verify(folder, public_key=key).differences == ("it is not signed",)


def test_a_new_page_says_that_it_is_not_signed(signed, program):
    folder, key, _ = signed
    assert "irbcal sign" not in program("report", folder)  # the same page
    (folder / "report.html").write_text("another page of irbcal")
    irbcal.verify(folder, reseal="a page")
    irbcal.sign(folder, key.with_suffix(".pem"))
    assert "irbcal sign" in program("report", folder)
    assert program("report", folder, "--json")["signature"] == "stale"
    assert "sign it again" in irbcal.verify(folder).summary()
    irbcal.sign(folder, key.with_suffix(".pem"))
    assert irbcal.verify(folder).signature == "unchecked"


def test_openssl_agrees(signed, tmp_path):
    """Another implementation verifies what is written: layout, kind and SHA-256, a line each."""
    if shutil.which("openssl") is None:
        pytest.skip("no openssl")
    folder, key, _ = signed
    content = json.loads((folder / "signature.json").read_text())
    (tmp_path / "message").write_text(f"irbcal-signature-1\ncalibration\n{content['sha256']}\n")
    (tmp_path / "value").write_bytes(base64.b64decode(content["signature"]))
    call = ["openssl", "pkeyutl", "-verify", "-pubin", "-inkey", key, "-rawin", "-in", "message", "-sigfile", "value"]
    done = subprocess.run(call, cwd=tmp_path, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr


def test_the_signature_of_a_certificate(signed, program, tmp_path):
    _, key, other = signed
    page = tmp_path / "certificate.html"
    page.write_text("<p>PASS</p>")
    out = irbcal.sign(page, tmp_path / "lab.pem")
    assert out.name == "certificate.html.signature.json"
    assert "signed with this key" in program("verify", page, "--public-key", key)
    assert not irbcal.verify(page, public_key=other)
    page.write_text("<p>FAIL</p>")
    assert irbcal.verify(page, public_key=key).explanation == "it was changed after it was signed"
    out.write_text("{}")
    assert not irbcal.verify(page, public_key=key)


def test_what_is_refused(signed, tmp_path):
    folder, key, _ = signed
    private = key.with_suffix(".pem")
    with pytest.raises(OptionError, match="not replaced"):
        irbcal.sign(folder, private, new_key=True)
    with pytest.raises(OptionError, match="expected a private key"):
        irbcal.sign(folder, key)
    with pytest.raises(OptionError, match="expected a public key"):
        irbcal.verify(folder, public_key=private)
    with pytest.raises(OptionError, match="no such file"):
        irbcal.sign(folder, tmp_path / "none.pem")
    with pytest.raises(OptionError, match="public_key: expected no URDF"):
        irbcal.verify(folder, folder / "calibrated.urdf", public_key=key)
    (folder / "report.html").unlink()
    with pytest.raises(CalibrationError, match=r"this is not signed: report\.html is missing"):
        irbcal.sign(folder, private)


def test_a_key_made_for_a_signature_that_fails_is_gone(tmp_path, monkeypatch):
    (tmp_path / "page.html").write_text("<p>")
    monkeypatch.setattr(calibration_folder, "write_set", refuse)
    with pytest.raises(CalibrationError):
        irbcal.sign(tmp_path / "page.html", tmp_path / "lab.pem", new_key=True)
    assert [path.name for path in tmp_path.iterdir()] == ["page.html"]
    (tmp_path / "lab.pub").write_text("another's")
    with pytest.raises(OptionError, match="is not replaced"):
        irbcal.sign(tmp_path / "page.html", tmp_path / "lab.pem", new_key=True)
    assert sorted(path.name for path in tmp_path.iterdir()) == ["lab.pub", "page.html"]


def refuse(contents):
    raise CalibrationError("cannot write to this folder")
