"""Signatures by a laboratory's key: who vouches for a calibration folder, or for a file such as a certificate.

A seal says that nothing was changed by accident; whoever may write a folder can renew it. A signature (Ed25519, RFC
8032, by the package cryptography) is made with a private key, and checked by anybody with the public one. That of a
folder stands in ``signature.json`` in it and covers the seal, which has the hashes of everything else; that of a file
stands beside it, ``NAME.signature.json``, and covers its content.
"""

from __future__ import annotations

import base64
import os
from pathlib import Path
from types import ModuleType
from typing import Literal

from pydantic import ValidationError

from irbcal.atomic import write_set
from irbcal.errors import CalibrationError, OptionError
from irbcal.io import calibration_folder, integrity
from irbcal.io.calibration_folder import JSON_NAME, SIGNATURE_NAME, folder_of
from irbcal.reading import read_bytes
from irbcal.section import Base64, Section, Sha256

SCHEMA = "irbcal-signature-1"
LARGEST = 10_000
"""Bytes of a key or a signature."""


class Signature(Section):
    """What stands in the file of a signature: of what, its SHA-256, and the signature of both in base64."""

    schema_name: Literal["irbcal-signature-1"]
    of: Literal["calibration", "file"]
    sha256: Sha256
    signature: Base64

    def message(self) -> bytes:
        """What is signed: layout, kind and SHA-256, a line each."""
        return f"{self.schema_name}\n{self.of}\n{self.sha256}\n".encode()


def sign(path: str | os.PathLike[str], key: str | os.PathLike[str], *, new_key: bool = False) -> Path:
    """Sign a calibration folder or a file, such as a certificate.

    Parameters
    ----------
    path : str or Path
        Calibration folder, or any file.
    key : str or Path
        Private Ed25519 key, PEM (PKCS 8) without a passphrase.
    new_key : bool
        Make the key first, and the public one beside it with the ending ``.pub``.

    Returns
    -------
    Path
        The file of the signature.

    Raises
    ------
    CalibrationError
        If the folder is not as it was sealed, or there is no such file.
    OptionError
        If the key cannot be used, a key would be replaced, or the package cryptography is not installed.
    """
    serialization, ed25519 = _keys()
    kind, sha256, out = _content(Path(path))
    if new_key:
        _new_key(Path(key))
    try:
        private = serialization.load_pem_private_key(read_bytes(key, OptionError, limit_bytes=LARGEST), None)
    except (ValueError, TypeError) as error:
        raise OptionError(f"key: {key}: expected a private key in PEM: {error}", parameter="key") from None
    if not isinstance(private, ed25519.Ed25519PrivateKey):
        raise OptionError(f"key: {key}: expected an Ed25519 key", parameter="key")
    unsigned = Signature(schema_name=SCHEMA, of=kind, sha256=sha256, signature="")
    value = base64.b64encode(private.sign(unsigned.message())).decode("ascii")
    write_set({out: (unsigned.model_copy(update={"signature": value}).model_dump_json(indent=1) + "\n").encode()})
    return out


def fault_of(path: str | os.PathLike[str], public_key: str | os.PathLike[str] | None = None) -> str | None:
    """What is wrong with the signature of a folder or a file, as a part of a sentence; None if nothing is.

    Parameters
    ----------
    path : str or Path
    public_key : str or Path, optional
        PEM. Without it, whether the signature is of what stands there now, not whose it is.

    Raises
    ------
    CalibrationError
        If there is no such folder or file.
    OptionError
        If the key cannot be used, or the package cryptography is not installed.
    """
    kind, sha256, file = _content(Path(path), check_files=False)
    if not os.path.lexists(file):
        return "it is not signed"
    try:
        signature = Signature.model_validate_json(read_bytes(file, CalibrationError, limit_bytes=LARGEST))
        value = base64.b64decode(signature.signature)
    except (ValidationError, ValueError):
        return f"{file.name} is no signature"
    if (signature.of, signature.sha256) != (kind, sha256):
        return "it was changed after it was signed"
    if public_key is None:
        return None
    serialization, ed25519 = _keys()
    from cryptography.exceptions import InvalidSignature

    try:
        public = serialization.load_pem_public_key(read_bytes(public_key, OptionError, limit_bytes=LARGEST))
    except (ValueError, TypeError) as error:
        raise OptionError(f"public_key: {public_key}: expected a public key in PEM: {error}") from None
    if not isinstance(public, ed25519.Ed25519PublicKey):
        raise OptionError(f"public_key: {public_key}: expected an Ed25519 key", parameter="public_key")
    try:
        public.verify(value, signature.message())
    except InvalidSignature:
        return "it was not signed with this key"
    return None


def _content(path: Path, check_files: bool = True) -> tuple[Literal["calibration", "file"], str, Path]:
    """What a signature is of: kind, SHA-256, and where the signature stands."""
    folder = folder_of(path)
    if not folder.is_dir() and path.name != JSON_NAME:
        data = read_bytes(path, CalibrationError)
        return "file", integrity.hashes({"": data})[""], path.with_name(f"{path.name}.signature.json")
    check = calibration_folder.checked(folder)
    if check_files and check.differences:
        raise CalibrationError(f"this is not signed: {'; '.join(check.differences)}", file=folder)
    section = check.record.seal
    return (
        "calibration",
        integrity.digest(None if section is None else section.model_dump(mode="json")),
        folder / SIGNATURE_NAME,
    )


def _keys() -> tuple[ModuleType, ModuleType]:
    """How keys are written, and Ed25519.

    Raises
    ------
    OptionError
        If the package is not installed.
    """
    try:
        from cryptography.hazmat.primitives import serialization
        from cryptography.hazmat.primitives.asymmetric import ed25519
    except ImportError:
        raise OptionError(
            "signatures need the package cryptography, which is not installed here: pip install 'irbcal[sign]'",
            parameter="key",
        ) from None
    return serialization, ed25519


def _new_key(path: Path) -> None:
    """A new private key, for its owner's eyes only, and the public key beside it."""
    how, ed25519 = _keys()
    private = ed25519.Ed25519PrivateKey.generate()
    secret = private.private_bytes(how.Encoding.PEM, how.PrivateFormat.PKCS8, how.NoEncryption())
    public = private.public_key().public_bytes(how.Encoding.PEM, how.PublicFormat.SubjectPublicKeyInfo)
    for file, content, mode in ((path, secret, 0o600), (path.with_suffix(".pub"), public, 0o644)):
        try:
            with open(os.open(file, os.O_WRONLY | os.O_CREAT | os.O_EXCL, mode), "wb") as stream:
                stream.write(content)
        except FileExistsError:
            raise OptionError("key: there is a key of this name, which is not replaced", file=file) from None
        except OSError as error:
            raise OptionError(f"key: cannot write it: {error.strerror}", file=file) from None
