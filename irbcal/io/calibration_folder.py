"""The calibration folder: calibrated URDF, joint origins, ``calibration.json``, report; and signatures of it.

Points and poses of a large calibration are NumPy's files (npz) beside ``calibration.json``, which has their hashes:
many points as JSON are large and slow. What is read is the same: one schema, sections `points` and `poses`. Such a
file is numbers and text alone: objects (pickle) and compressed arrays, which could grow without bound, are refused.

A seal says that nothing was changed by accident; whoever may write a folder can renew it. A signature (Ed25519, RFC
8032, by the package cryptography) is made with a private key, and checked by anybody with the public one. That of a
folder stands in ``signature.json`` in it and covers the seal, which has the hashes of everything else; that of a file
stands beside it, ``NAME.signature.json``, and covers its content.
"""

from __future__ import annotations

import base64
import hashlib
import json
import os
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager, nullcontext
from dataclasses import dataclass
from io import BytesIO
from pathlib import Path
from tempfile import TemporaryDirectory
from types import ModuleType
from typing import Any, Literal
from zipfile import ZIP_STORED, ZipFile

import numpy as np
from numpy.typing import NDArray
from pydantic import ValidationError
from pydantic_core import to_json

from irbcal.errors import CalibrationError, OptionError
from irbcal.io import integrity, joint_origins
from irbcal.io.integrity import contradictions, refuse_absurd
from irbcal.io.schema import Record, Seal
from irbcal.names import comment
from irbcal.overwriting import MARK
from irbcal.safe_files import read_bytes, recover, write_set, write_together
from irbcal.section import Base64, Section, Sha256
from irbcal.wording import inflected

FEWEST_POSES_IN_TABLE_FILES = 2_000
"""Poses from which on they and their points stand beside ``calibration.json``."""
SCHEMA = "irbcal-calibration-1"
TABLE_FILES = {"points": "calibration.points.npz", "poses": "calibration.poses.npz"}
SIGN_COLUMN = "came_from"
"""A column of characters."""
NAMES_ENDING = ".names"
"""Of the array that has the words of a column of names."""


def without_tables(record: Record) -> tuple[dict[str, Any], dict[str, bytes]]:
    """What stands in ``calibration.json``, and the files beside it.

    Returns
    -------
    document : dict
        For JSON, without its seal.
    files : dict of str to bytes
        Empty where there are few poses.
    """
    if len(record.poses.pose) < FEWEST_POSES_IN_TABLE_FILES:
        return record.model_dump(mode="json"), {}
    files = {file: _columns_as_bytes(getattr(record, name)) for name, file in TABLE_FILES.items()}
    references = {name: _reference(file, files[file]) for name, file in TABLE_FILES.items()}
    document = record.model_dump(mode="json", exclude=set(TABLE_FILES)) | references
    return document, files


def with_tables(document: Mapping[str, Any], folder: Path) -> Mapping[str, Any]:
    """The content of a ``calibration.json`` with the tables that stand beside it.

    Parameters
    ----------
    document : dict
        As JSON has it.
    folder : Path

    Raises
    ------
    CalibrationError
        If a table is missing, is not the one that the file names, or cannot be read.
    """
    if not _beside(document):
        return document
    return dict(document) | {name: _read_table(document.get(name), folder, file) for name, file in TABLE_FILES.items()}


def _beside(document: Any) -> bool:
    """Whether tables stand in files of their own."""
    points = document.get("points") if isinstance(document, dict) else None
    return isinstance(points, dict) and "file" in points


def _reference(name: str, content: bytes) -> dict[str, str]:
    return {"file": name, "sha256": hashlib.sha256(content).hexdigest()}


def _columns_as_bytes(table: Section) -> bytes:
    """A section of columns as npz; columns for each joint are numbered."""
    columns: dict[str, NDArray[Any]] = {}
    for name, values in table:
        if name == SIGN_COLUMN or (values and isinstance(values[0], list)):
            columns |= {key: array for k, column in enumerate(values) for key, array in _arrays(f"{name}.{k}", column)}
        elif values:
            columns |= dict(_arrays(name, values))
    buffer = BytesIO()
    np.savez(buffer, allow_pickle=False, **columns)
    with ZipFile(buffer, "a") as archive:
        archive.comment = MARK
    return buffer.getvalue()


def _arrays(name: str, column: Sequence[Any]) -> Iterator[tuple[str, NDArray[Any]]]:
    """A column as arrays without objects: numbers (not-a-number for None); words of names, and numbers of these words.

    A text is a column of characters.
    """
    if isinstance(column, str):
        yield name, np.frombuffer(column.encode("ascii"), dtype="S1")
    elif isinstance(column[0], str):
        number_of = {word: k for k, word in enumerate(dict.fromkeys(column))}
        yield f"{name}{NAMES_ENDING}", np.array(list(number_of), dtype=np.str_)
        yield name, np.array([number_of[word] for word in column], dtype=np.int64)
    else:
        kind = type(next((value for value in column if value is not None), 0.0))
        yield name, np.array(column, dtype=kind)


def _read_table(reference: Any, folder: Path, name: str) -> dict[str, list[Any]]:
    """The columns of a table, as JSON would have them."""
    content = read_bytes(folder / name, CalibrationError)
    if reference != _reference(name, content):
        raise CalibrationError("this is not the table that calibration.json was written with", file=folder / name)
    columns: dict[str, list[Any]] = {}
    try:
        with ZipFile(BytesIO(content)) as archive:
            if any(member.compress_type != ZIP_STORED for member in archive.infolist()):
                raise ValueError("a member is compressed")
        with np.load(BytesIO(content), allow_pickle=False) as arrays:
            for label in arrays.files:
                if label.endswith(NAMES_ENDING):
                    continue
                column_name, dot, _ = label.partition(".")
                values = _values(arrays, label)
                if not dot:
                    columns[column_name] = values
                else:
                    columns.setdefault(column_name, []).append(values)
    except Exception as error:  # whatever zipfile and numpy raise on a damaged file
        raise CalibrationError(f"this is no table of a calibration: {error}", file=folder / name) from None
    return columns


def _values(arrays: Mapping[str, NDArray[Any]], label: str) -> Any:
    """A column as JSON has it; names share their words, of which a long table has few."""
    column = arrays[label]
    if column.ndim != 1 or column.dtype.kind not in "bifS":
        raise ValueError(f"column {label} is not of numbers or characters")
    if column.dtype.kind == "S":
        return column.tobytes().decode("ascii")
    names = f"{label}{NAMES_ENDING}"
    if names in arrays:
        if column.dtype.kind != "i" or (column < 0).any():
            raise ValueError(f"column {label} has a name that is not among its names")
        return arrays[names].astype(object)[column].tolist()
    absent = np.isnan(column) if column.dtype.kind == "f" else np.zeros(len(column), dtype=bool)
    if not absent.any():
        return column.tolist()
    values = column.astype(object)
    values[absent] = None
    return values.tolist()


URDF_NAME, JSON_NAME, REPORT_NAME = "calibrated.urdf", "calibration.json", "report.html"
ORIGINS_NAME = "joint_origins.yaml"
NOT_ONE = "not a calibration folder: "
SIGNATURE_NAME = "signature.json"
FILE_NAMES = (URDF_NAME, ORIGINS_NAME, JSON_NAME, REPORT_NAME)
MOVING_FILES = (URDF_NAME, ORIGINS_NAME)
"""By which robots move: looked at whenever a folder is opened."""
NO_SEAL = "calibration.json has no seal"


@dataclass(frozen=True, repr=False)
class Saved:
    """A calibration folder as read, once."""

    folder: Path
    record: Record
    """Content of ``calibration.json``."""
    urdf: bytes
    """Content of ``calibrated.urdf``."""

    def __repr__(self) -> str:
        return f"<Saved {self.folder}: {self.record!r}>"


def write(folder: str | Path, record: Record, urdf_bytes: bytes, report: str) -> None:
    """Write a calibration folder: all its files, or none; what `read` would refuse is not written.

    Parameters
    ----------
    folder : str or Path
        Made if absent; other files in it are left alone.
    record : Record
    urdf_bytes : bytes
        The corrected URDF.
    report : str
        The page for people.

    Raises
    ------
    CalibrationError
        If the folder cannot be written, or could not be read again.
    """
    document, tables = without_tables(record)
    files = {
        URDF_NAME: urdf_bytes,
        ORIGINS_NAME: joint_origins.to_yaml(record).encode("utf-8"),
        REPORT_NAME: report.encode("utf-8"),
        **tables,
    }
    files[JSON_NAME] = _text(integrity.sealed(document, integrity.hashes(files)))
    _refuse_unreadable(files, Path(folder))
    write_together(folder, files)
    for name in {*TABLE_FILES.values(), SIGNATURE_NAME} - set(files):  # of a calibration that was here before
        (Path(folder) / name).unlink(missing_ok=True)


def with_page(folder: str | Path, page: bytes) -> dict[str, bytes]:
    """The files to write for a new ``report.html``: the page, and ``calibration.json`` whose seal lists it.

    Raises
    ------
    CalibrationError
        As `read`: what was changed is not sealed again.
    """
    read(folder)
    content = _read(folder_of(folder))[1]
    listed = content[integrity.KEY]["files"] | integrity.hashes({REPORT_NAME: page})
    return {REPORT_NAME: page, JSON_NAME: _text(integrity.sealed(content, listed))}


def _refuse_unreadable(files: Mapping[str, bytes], folder: Path) -> None:
    """Read files as they would stand in a folder; an earlier calibration there is still whole."""
    with TemporaryDirectory(prefix="irbcal-") as draft:
        for name, content in files.items():
            (Path(draft) / name).write_bytes(content)
        try:
            read(draft)
        except CalibrationError as error:
            reason = str(error).removeprefix(f"{error.file}: ")
            raise CalibrationError(
                f"not written, because no command could open it: {reason}", file=folder, parameter=error.parameter
            ) from None


def _text(document: dict[str, Any]) -> bytes:
    return to_json(document, indent=1) + b"\n"


def folder_of(path: str | os.PathLike[str]) -> Path:
    """The folder that is meant by a path: of its ``calibration.json`` or the URDF beside that, too."""
    path = Path(path)
    whole = path.name == JSON_NAME or (path.name == URDF_NAME and path.with_name(JSON_NAME).is_file())
    return path.parent if whole and not path.is_dir() else path


def read(folder: str | Path) -> Saved:
    """Read a calibration folder.

    Parameters
    ----------
    folder : str or Path
        The folder, or the ``calibration.json`` in it.

    Raises
    ------
    CalibrationError
        If a file is missing or damaged, a number is absurd, or what robots move by is not as irbcal sealed it.
    """
    folder = folder_of(folder)
    recover(folder)
    saved, content = _read(folder)
    moving = [name for name in MOVING_FILES if os.path.lexists(folder / name)]
    if _changed_files(folder, saved.record, moving):
        recover(folder)  # somebody is writing it just now: the lock waits until all files are new
        saved, content = _read(folder)
    if saved.record.seal is None:
        raise CalibrationError(
            f"{NO_SEAL}: a file of unknown origin must not move a robot (irbcal verify FOLDER --reseal WHY seals it)",
            file=folder / JSON_NAME,
        )
    changed = [*integrity.broken(content), *_changed_files(folder, saved.record, moving)]
    if changed:
        raise CalibrationError(
            f"{', '.join(changed)} {inflected(len(changed), 'was', 'were')} changed after irbcal wrote it: a damaged "
            "file must not move a robot (irbcal verify FOLDER tells more, --reseal accepts a deliberate change)",
            file=folder / JSON_NAME,
        )
    against = _contradictions(saved)  # a seal can be renewed by whoever can write the file
    if against:
        raise CalibrationError("; ".join(against), file=folder / JSON_NAME)
    return saved


def contents(folder: str | Path) -> tuple[tuple[str, bytes], ...] | None:
    """Names and bytes of all files that `read` looks at; None where one of them cannot be read.

    Folders with equal contents give the same calibration.
    """
    folder = folder_of(folder)
    recover(folder)
    names = [name for name in (JSON_NAME, URDF_NAME, ORIGINS_NAME, *TABLE_FILES.values()) if (folder / name).exists()]
    try:
        return tuple((name, read_bytes(folder / name, CalibrationError)) for name in names)
    except CalibrationError:
        return None


@dataclass(frozen=True)
class FolderCheck:
    """What `checked` finds in a calibration folder."""

    record: Record
    differences: tuple[str, ...]
    """What is not as it was written, or contradicts itself: a part of a sentence each."""
    files: tuple[str, ...]
    """Those that are as they were written."""
    unlisted: tuple[str, ...]
    """Files in the folder that the seal does not list: nothing is known of them."""


def checked(folder: str | Path) -> FolderCheck:
    """Look at every part and every file of a calibration folder.

    Raises
    ------
    CalibrationError
        If it is no calibration folder.
    """
    folder = folder_of(folder)
    saved, content = _read(folder)
    section = saved.record.seal
    if section is None:
        differences, listed, changed = [NO_SEAL], {}, {}
    else:
        listed = section.files
        changed = _changed_files(folder, saved.record, dict.fromkeys((*listed, *MOVING_FILES)))
        differences = [f"{name} was changed after it was written" for name in integrity.broken(content)]
        differences += [f"{name} {how}" for name, how in changed.items()]
    return FolderCheck(
        saved.record,
        (*differences, *_contradictions(saved)),
        tuple(name for name in (JSON_NAME, *listed) if name not in changed),
        _unlisted(folder, listed),
    )


def _unlisted(folder: Path, listed: Iterable[str]) -> tuple[str, ...]:
    """Files in a folder that a seal does not list."""
    names = sorted(path.name for path in folder.iterdir() if not path.name.startswith("."))
    return tuple(name for name in names if name not in {JSON_NAME, SIGNATURE_NAME, *listed})


def _contradictions(saved: Saved) -> list[str]:
    try:
        origins = read_bytes(saved.folder / ORIGINS_NAME, CalibrationError)
    except CalibrationError:
        origins = None
    return contradictions(saved.record, saved.urdf, origins)


def _changed_files(folder: Path, record: Record, names: Iterable[str]) -> dict[str, str]:
    """Files that are not as the seal lists them, with what is wrong."""
    listed = {} if record.seal is None else record.seal.files
    changes = {}
    for name in names:
        if name not in listed:
            changes[name] = "is not listed in the seal"
            continue
        try:
            content = read_bytes(folder / name, CalibrationError)
        except CalibrationError:
            changes[name] = "cannot be read" if os.path.lexists(folder / name) else "is missing"
            continue
        if hashlib.sha256(content).hexdigest() != listed[name]:
            changes[name] = "was changed after it was written"
    return changes


def reseal(folder: str | Path, reason: str) -> FolderCheck:
    """Accept deliberate changes of a ``calibration.json``.

    Parameters
    ----------
    folder : str or Path
    reason : str
        One line for its history.

    Returns
    -------
    FolderCheck
        Of the folder as it is written; it is not read again.

    Raises
    ------
    CalibrationError
        If there is nothing to accept, or what it says now contradicts itself.
    """
    folder = folder_of(folder)
    saved, content = _read(folder)
    against = _contradictions(saved)
    if against:
        raise CalibrationError(f"this cannot be accepted: {'; '.join(against)}", file=folder / JSON_NAME)
    names = {*FILE_NAMES, *TABLE_FILES.values()} - {JSON_NAME}
    files = {name: read_bytes(folder / name, CalibrationError) for name in names if (folder / name).is_file()}
    document = integrity.resealed(content, integrity.hashes(files), comment(reason))
    write_together(folder, {JSON_NAME: _text(document)})
    sealed = saved.record.model_copy(update={integrity.KEY: Seal.model_validate(document[integrity.KEY])})
    return FolderCheck(sealed, (), (JSON_NAME, *sorted(files)), _unlisted(folder, files))


def _read(folder: Path) -> tuple[Saved, dict[str, Any]]:
    """A folder as it is, and the content of its ``calibration.json`` as JSON has it."""
    json_path, urdf_path = folder / JSON_NAME, folder / URDF_NAME
    try:
        data = read_bytes(json_path, CalibrationError, prefix=NOT_ONE)
        content = _content(data)
        record = Record.model_validate(with_tables(content, folder)) if content else Record.model_validate_json(data)
        urdf_bytes = read_bytes(urdf_path, CalibrationError, prefix=NOT_ONE)
    except ValidationError as error:
        first = error.errors()[0]
        where = ".".join(str(key) for key in first["loc"]) or "the file"
        raise CalibrationError(f"{where}: {first['msg']}", file=json_path, parameter=where) from None
    tables = {name: dict(getattr(record, name)) for name in TABLE_FILES}
    refuse_absurd(record.model_dump(exclude={integrity.KEY, *TABLE_FILES}) | tables, json_path)
    return Saved(folder, record, urdf_bytes), content


def _content(data: bytes) -> dict[str, Any]:
    """A ``calibration.json`` as JSON has it; empty where it is no JSON, of which pydantic says where it is broken."""
    try:
        content = json.loads(data)
    except (ValueError, RecursionError):
        return {}
    return content if isinstance(content, dict) else {}


SIGNATURE_SCHEMA = "irbcal-signature-1"
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
    kind, sha256, out = _signed_content(Path(path))
    with _new_key(Path(key)) if new_key else nullcontext():
        try:
            private = serialization.load_pem_private_key(read_bytes(key, OptionError, limit_bytes=LARGEST), None)
        except (ValueError, TypeError) as error:
            raise OptionError(f"key: {key}: expected a private key in PEM: {error}", parameter="key") from None
        if not isinstance(private, ed25519.Ed25519PrivateKey):
            raise OptionError(f"key: {key}: expected an Ed25519 key", parameter="key")
        unsigned = Signature(schema_name=SIGNATURE_SCHEMA, of=kind, sha256=sha256, signature="")
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
    kind, sha256, file = _signed_content(Path(path), check_files=False)
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


def _signed_content(path: Path, check_files: bool = True) -> tuple[Literal["calibration", "file"], str, Path]:
    """What a signature is of: kind, SHA-256, and where the signature stands."""
    folder = folder_of(path)
    if not folder.is_dir() and path.name != JSON_NAME:
        data = read_bytes(path, CalibrationError)
        return "file", integrity.hashes({"": data})[""], path.with_name(f"{path.name}.signature.json")
    check = checked(folder)
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


@contextmanager
def _new_key(path: Path) -> Iterator[None]:
    """A new private key, for its owner's eyes only, and the public key beside it; both go where what follows fails."""
    how, ed25519 = _keys()
    private = ed25519.Ed25519PrivateKey.generate()
    secret = private.private_bytes(how.Encoding.PEM, how.PrivateFormat.PKCS8, how.NoEncryption())
    public = private.public_key().public_bytes(how.Encoding.PEM, how.PublicFormat.SubjectPublicKeyInfo)
    with ExitStack() as created:
        for file, content, mode in ((path, secret, 0o600), (path.with_suffix(".pub"), public, 0o644)):
            try:
                handle = os.open(file, os.O_WRONLY | os.O_CREAT | os.O_EXCL, mode)
                created.callback(file.unlink, missing_ok=True)
                with open(handle, "wb") as stream:
                    stream.write(content)
            except FileExistsError:
                raise OptionError("key: there is a key of this name, which is not replaced", file=file) from None
            except OSError as error:
                raise OptionError(f"key: cannot write it: {error.strerror}", file=file) from None
        yield
        created.pop_all()
