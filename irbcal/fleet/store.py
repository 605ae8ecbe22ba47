"""A store of calibrations: SQLite as a file, or PostgreSQL by its URL, by SQLAlchemy Core.

A calibration is added in one transaction, whole or not at all, and once: a second time it is found.
"""

from __future__ import annotations

import hashlib
import json
import math
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field, replace
from datetime import date
from functools import cached_property
from itertools import islice
from pathlib import Path
from typing import TYPE_CHECKING, Any, cast

import numpy as np
from numpy.typing import ArrayLike

try:
    import sqlalchemy as sql
    from sqlalchemy.exc import ArgumentError, DBAPIError, NoSuchModuleError
except ModuleNotFoundError as error:
    raise ModuleNotFoundError(
        "the store of a fleet needs SQLAlchemy: pip install 'irbcal[fleet]'", name=error.name
    ) from None

from irbcal.arrays import FloatArray
from irbcal.errors import CalibrationError, OptionError

if TYPE_CHECKING:
    import pandas as pd
    from sqlalchemy.engine import Connection, Engine

VERSION = 3
"""Of the tables."""
NOT_THERE = "no store of a fleet"
DIALECTS = ("sqlite", "postgresql")
PARTS = ("fit", "level", "terms")
"""Estimates: of the calibration, of a level fitted to its points, and of those terms that robots of a type are compared
by."""
OTHER = "other"
"""Base, targets and what is held."""
READ_AT_A_TIME = 500
"""Calibrations that are read at a time: their covariances take up to 50 kB each."""
ROWS = 10_000
"""Rows of other tables that are read at a time."""

tables = sql.MetaData()
about = sql.Table("irbcal_fleet", tables, sql.Column("version", sql.Integer, primary_key=True))
robots = sql.Table(
    "robots",
    tables,
    sql.Column("id", sql.String(200), primary_key=True),
    sql.Column("serial", sql.String(200), nullable=False),
    sql.Column("type", sql.String(200), nullable=False, index=True),
)
calibrations = sql.Table(
    "calibrations",
    tables,
    sql.Column("number", sql.Integer, primary_key=True),
    sql.Column("robot", sql.ForeignKey("robots.id"), nullable=False),
    sql.Column("fingerprint", sql.String(64), nullable=False),
    sql.Column("measured", sql.Date, nullable=False),
    sql.Column("created", sql.String(40), nullable=False),
    sql.Column("added", sql.String(40), nullable=False),
    sql.Column("folder", sql.Text, nullable=False),
    sql.Column("model", sql.String(40), nullable=False),
    sql.Column("method", sql.String(40), nullable=False),
    sql.Column("simulated", sql.Boolean, nullable=False),
    sql.Column("poses_fit", sql.Integer, nullable=False),
    sql.Column("poses_heldout", sql.Integer, nullable=False),
    sql.Column("nominal_mean_mm", sql.Float),
    sql.Column("heldout_mean_mm", sql.Float),
    sql.Column("heldout_sigma_mm", sql.Float),
    sql.Column("heldout_max_mm", sql.Float),
    sql.Column("trusted", sql.Boolean, nullable=False),
    sql.Column("verdict", sql.Text, nullable=False),
    sql.Column("json_sha256", sql.String(64), nullable=False),
    sql.Column("urdf_sha256", sql.String(64), nullable=False),
    sql.Column("nominal_urdf_sha256", sql.String(64), nullable=False),
    sql.UniqueConstraint("robot", "fingerprint", "measured"),
    sql.Index("calibrations_in_order", "robot", "measured", "created", "number"),
)
parameter_lists = sql.Table(
    "parameter_lists",
    tables,
    sql.Column("number", sql.Integer, primary_key=True),
    sql.Column("sha256", sql.String(64), nullable=False, unique=True),
    sql.Column("content", sql.Text, nullable=False),
)
files = sql.Table(
    "files",
    tables,
    sql.Column("calibration", sql.ForeignKey("calibrations.number"), primary_key=True),
    sql.Column("position", sql.Integer, primary_key=True),
    sql.Column("name", sql.Text, nullable=False),
    sql.Column("sha256", sql.String(64), nullable=False),
)


def _estimates(name: str) -> sql.Table:
    """A table of estimates: little-endian numbers of all parameters of a list, in its order.

    Values have eight bytes, deviations four. The factor L of the covariance ``L L'`` is the lower triangle row by row:
    rounded to four bytes it keeps each variance to 1e-7 of itself, and the covariance without negative directions.
    """
    columns = [sql.Column("factor", sql.LargeBinary, nullable=False)] if name in PARTS else []
    return sql.Table(
        f"estimates_{name}",
        tables,
        sql.Column("calibration", sql.ForeignKey("calibrations.number"), primary_key=True, autoincrement=False),
        sql.Column("list", sql.ForeignKey("parameter_lists.number"), nullable=False),
        sql.Column("value", sql.LargeBinary, nullable=False),
        sql.Column("std", sql.LargeBinary, nullable=False),
        sql.Column("prior", sql.LargeBinary, nullable=False),
        *columns,
    )


estimates = {name: _estimates(name) for name in (*PARTS, OTHER)}


@dataclass(frozen=True)
class ParameterList:
    """Parameters that many estimates have in common."""

    names: tuple[str, ...] = ()
    units: tuple[str, ...] = ()
    natural: tuple[float | None, ...] = ()
    """What is natural on an industrial arm, SI units."""
    states: tuple[str, ...] = ()
    """How each was identified, or that it was held."""

    @cached_property
    def column_of(self) -> Mapping[str, int]:
        """Positions of the parameters by their names."""
        return {name: k for k, name in enumerate(self.names)}

    @cached_property
    def content(self) -> str:
        """As the store has it."""
        rows = zip(self.names, self.units, self.natural, self.states, strict=True)
        return json.dumps(list(rows), ensure_ascii=False, separators=(",", ":"))

    @cached_property
    def sha256(self) -> str:
        """Of the content."""
        return hashlib.sha256(self.content.encode()).hexdigest()

    @staticmethod
    def from_text(content: str) -> ParameterList:
        """From what the store has."""
        try:
            rows = json.loads(content)
            for name, unit, natural, state in rows:
                texts = isinstance(name, str) and isinstance(unit, str) and isinstance(state, str)
                if not texts or not (natural is None or (isinstance(natural, float) and math.isfinite(natural))):
                    raise ValueError
            columns = [tuple(column) for column in zip(*rows, strict=True)] or [()] * 4
        except (ValueError, TypeError, RecursionError):
            raise _Damaged(f"table parameter_lists, column content: {ascii(content)[:50]}") from None
        return ParameterList(*columns)


@dataclass(frozen=True, eq=False)
class Estimate:
    """Parameters with their covariance."""

    names: tuple[str, ...]
    units: tuple[str, ...]
    values: FloatArray
    prior: FloatArray
    natural: FloatArray
    """Shape (k,). Their values, what was expected of them before (standard deviation; infinite for levels, which expect
    nothing) and what is natural on an industrial arm, SI units.
    """
    covariance: FloatArray
    """Shape (k, k)."""
    std: FloatArray = field(init=False)
    """Shape (k,). Standard deviations."""

    def __post_init__(self) -> None:
        object.__setattr__(self, "std", np.sqrt(np.maximum(np.diagonal(self.covariance), 0.0)))

    @property
    def column_of(self) -> Mapping[str, int]:
        """Positions of the parameters by their names."""
        return {name: k for k, name in enumerate(self.names)}

    def packed(self) -> PackedEstimate:
        """As the store has it."""
        parameters = ParameterList(
            self.names, self.units, tuple(map(float, self.natural)), ("identified",) * len(self.names)
        )
        L = factor_of(self.covariance, self.std)[np.tril_indices(len(self.names))]
        return PackedEstimate(parameters, *map(_bytes, (self.values, self.std, self.prior, L), ("<f8", *3 * ("<f4",))))


def _bytes(numbers: ArrayLike, kind: str) -> bytes:
    return np.asarray(numbers, dtype=kind).tobytes()


def factor_of(covariance: FloatArray, std: FloatArray) -> FloatArray:
    """A lower triangle L with ``L L'`` the covariance, which may have directions that are known exactly."""
    try:
        return np.asarray(np.linalg.cholesky(covariance), dtype=float)
    except np.linalg.LinAlgError:
        size = np.where(std > 0.0, std, 1.0)
        values, vectors = np.linalg.eigh(covariance / np.outer(size, size))
        R = np.linalg.qr((vectors * np.sqrt(np.maximum(values, 0.0))).T)[1]
        return size[:, None] * R.T


@dataclass(frozen=True, eq=False, slots=True)
class PackedEstimate:
    """An estimate in bytes, see `_estimates`; the factor is empty where there is none, or none was asked for."""

    parameters: ParameterList
    value: bytes
    std: bytes
    prior: bytes
    factor: bytes = b""

    def numbers(self, name: str) -> FloatArray:
        """Values, deviations or what was expected, shape (k,)."""
        numbers = np.frombuffer(getattr(self, name), "<f8" if name == "value" else "<f4")
        with np.errstate(invalid="ignore"):  # damaged bytes can be any number that is none
            return numbers.astype(float)

    def estimate(self) -> Estimate:
        """With its covariance."""
        names = self.parameters.names
        (covariance,) = covariances([self.factor], len(names))
        value, prior = self.numbers("value"), self.numbers("prior")
        return Estimate(names, self.parameters.units, value, prior, np.array(self.parameters.natural), covariance)


def covariances(factors: Sequence[bytes], k: int) -> FloatArray:
    """Covariances of n estimates of k parameters from their factors, shape (n, k, k)."""
    L = np.zeros((len(factors), k, k))
    rows, columns = np.tril_indices(k)
    with np.errstate(invalid="ignore"):
        L[:, rows, columns] = np.frombuffer(b"".join(factors), "<f4").reshape(len(factors), -1)
    if not np.isfinite(L).all():
        raise _Damaged("a covariance has numbers that are not finite")
    return L @ L.transpose(0, 2, 1)


@dataclass(frozen=True, eq=False, slots=True)
class Dated:
    """An estimate of a calibration, and whose and when."""

    number: int
    """Of the calibration."""
    robot: str
    type: str
    measured: date
    packed: PackedEstimate
    """Without parameters where the calibration has no such estimate."""

    def light(self) -> Dated:
        """The same, values and deviations alone: a fleet's covariances need much memory."""
        packed = PackedEstimate(self.packed.parameters, self.packed.value, self.packed.std, b"")
        return Dated(self.number, self.robot, self.type, self.measured, packed)


NONE = PackedEstimate(ParameterList(), b"", b"", b"")


@dataclass(frozen=True, eq=False)
class Stored:
    """A calibration as the store has it."""

    robot: Mapping[str, str]
    """``id``, ``serial`` and ``type``."""
    calibration: Mapping[str, Any]
    """The columns of the table ``calibrations``."""
    fit: Estimate | None
    """Error parameters and terms of the calibration; None, as the next two, where it was not asked for."""
    level: Estimate | None
    """Those of the arm's own level, fitted to the calibration's points: the same parameters in every calibration; None
    where the calibration was saved without its points.
    """
    terms: Estimate | None = None
    """What its measurements show of the terms by which a type's prior is made (`irbcal.identification.term_sets`)."""
    nuisance: tuple[Mapping[str, Any], ...] = ()
    """Base, targets and what is held: ``name``, ``value``, ``std`` (or None), ``unit`` and ``state`` of each."""
    files: tuple[tuple[str, str], ...] = ()
    """Names and hashes of the data."""

    @property
    def measured(self) -> date:
        """When it was measured; when it was calibrated, where that was not told."""
        return cast(date, self.calibration["measured"])

    def dated(self, part: str = "level") -> Dated:
        """One of its estimates."""
        estimate: Estimate | None = getattr(self, part)
        packed = NONE if estimate is None else estimate.packed()
        number = self.calibration.get("number", 0)
        return Dated(number, self.robot["id"], self.robot["type"], self.measured, packed)

    def packed(self) -> dict[str, PackedEstimate]:
        """All its estimates, and what else is listed, by the names of `estimates`."""
        out = {name: estimate.packed() for name in PARTS if (estimate := getattr(self, name)) is not None}
        if self.nuisance:
            out[OTHER] = _packed_other(self.nuisance)
        return out

    @property
    def key(self) -> tuple[str, str, date]:
        """By what the store knows it again."""
        return self.robot["id"], self.calibration["fingerprint"], self.measured


def _packed_other(rows: Sequence[Mapping[str, Any]]) -> PackedEstimate:
    """What else is listed, as the store has it."""
    names, units, states = (tuple(row[key] for row in rows) for key in ("name", "unit", "state"))
    std = [np.nan if row["std"] is None else row["std"] for row in rows]
    parameters = ParameterList(names, units, (None,) * len(names), states)
    return PackedEstimate(parameters, _bytes([row["value"] for row in rows], "<f8"), _bytes(std, "<f4"), b"")


def _other(packed: PackedEstimate) -> tuple[Mapping[str, Any], ...]:
    """Rows of what else is listed."""
    p = packed.parameters
    numbers = packed.numbers("value").tolist(), packed.numbers("std").tolist()
    return tuple(
        {"name": name, "value": value, "std": None if math.isnan(std) else std, "unit": unit, "state": state}
        for name, value, std, unit, state in zip(p.names, *numbers, p.units, p.states, strict=True)
    )


class Store:
    """A store that is open."""

    def __init__(self, engine: Engine) -> None:
        self.engine = engine
        self._lists: dict[int, ParameterList] = {}

    def add(self, stored: Stored) -> bool:
        """Add a calibration, whole or not at all; whether it was not there yet. See `add_all`."""
        return self.add_all([stored])[0]

    def add_all(self, batch: Sequence[Stored]) -> list[bool]:
        """Add calibrations in one transaction: all of them, or none.

        Returns
        -------
        list of bool
            Of each, whether it was not there yet.

        Raises
        ------
        CalibrationError
            If a robot is there with another serial number or of another type: then those before it are added.
        """
        parts = [stored.packed() for stored in batch]  # outside: who writes keeps others waiting
        batch_start = len(batch)
        try:
            with self.engine.execution_options(writes=True).begin() as link:
                batch_start = self._add_robots(link, batch)
                if batch_start < len(batch):
                    raise self._contradiction(link, batch[batch_start])
                lists = self._add_lists(link, {p.parameters for packed in parts for p in packed.values()})
                numbers = self._add_heads(link, batch)
                out = [number is not None for number in numbers]
                new = [(number, s, p) for number, s, p in zip(numbers, batch, parts, strict=True) if number is not None]
                for name, table in estimates.items():
                    rows = [
                        (number, lists[p.parameters], p.value, p.std, p.prior, p.factor)[: len(table.c)]
                        for number, _, packed in new
                        if (p := packed.get(name)) is not None
                    ]
                    self._fill(link, table, rows)
                self._fill(link, files, [(n, k, *file) for n, stored, _ in new for k, file in enumerate(stored.files)])
        except CalibrationError:
            if batch_start:
                self.add_all(batch[:batch_start])
            raise
        return out

    def _add_robots(self, link: Connection, batch: Sequence[Stored]) -> int:
        """Add robots that are not there; how many calibrations come before the first that contradicts the store."""
        first: dict[str, Mapping[str, str]] = {}
        for stored in batch:
            first.setdefault(stored.robot["id"], stored.robot)
        rows = [dict(first[id]) for id in sorted(first)]  # in order: no two writers wait for each other
        if rows:
            link.execute(self._insert(robots).on_conflict_do_nothing(), rows)
        there = {row["id"]: row for row in _checked(link, sql.select(robots).where(robots.c.id.in_(first)))}
        agree = (there[stored.robot["id"]] == stored.robot for stored in batch)
        return next((k for k, same in enumerate(agree) if not same), len(batch))

    @staticmethod
    def _contradiction(link: Connection, stored: Stored) -> CalibrationError:
        """What the store knows otherwise."""
        robot = stored.robot
        (known,) = _checked(link, sql.select(robots).where(robots.c.id == robot["id"]))
        column = next(name for name in ("serial", "type") if known[name] != robot[name])
        return CalibrationError(
            f"robot {robot['id']} is in the store with {column} {known[column]}, not {robot[column]}: "
            + ("leave --serial out, or" if column == "serial" else "if it is another robot,")
            + " give it another --id",
            file=stored.calibration["folder"],
        )

    def _add_lists(self, link: Connection, wanted: set[ParameterList]) -> dict[ParameterList, int]:
        """Numbers of lists of parameters, which are added where they are not there."""
        by_sha256 = {parameters.sha256: parameters for parameters in wanted}
        if not by_sha256:
            return {}
        chosen = sql.select(parameter_lists.c.sha256, parameter_lists.c.number).where(
            parameter_lists.c.sha256.in_(by_sha256)
        )
        stored = {row[0]: row[1] for row in link.execute(chosen)}
        absent = sorted(set(by_sha256) - set(stored))
        if absent:
            rows = [{"sha256": sha256, "content": by_sha256[sha256].content} for sha256 in absent]
            link.execute(self._insert(parameter_lists).on_conflict_do_nothing(), rows)
            stored = {row[0]: row[1] for row in link.execute(chosen)}
        return {by_sha256[sha256]: number for sha256, number in stored.items()}

    def _add_heads(self, link: Connection, batch: Sequence[Stored]) -> list[int | None]:
        """Numbers of calibrations; None of those that were there."""
        c = calibrations.c
        rows = [dict(stored.calibration) for stored in sorted(batch, key=lambda stored: stored.key)]
        added = self._insert(calibrations).on_conflict_do_nothing()
        returned = link.execute(added.returning(c.number, c.robot, c.fingerprint, c.measured), rows) if rows else ()
        numbers = {tuple(key): number for number, *key in returned}
        return [numbers.pop(stored.key, None) for stored in batch]

    def _fill(self, link: Connection, table: sql.Table, rows: Sequence[tuple[Any, ...]]) -> None:
        """Rows that are new, in the order of the table's columns: PostgreSQL takes them as a stream."""
        if not rows:
            return
        names = [column.name for column in table.c]
        if self.engine.dialect.name != "postgresql":
            link.exec_driver_sql(
                f"insert into {table.name} ({', '.join(names)}) values ({', '.join('?' * len(names))})", list(rows)
            )
            return
        kinds = {sql.Integer: "int4", sql.LargeBinary: "bytea", sql.Text: "text", sql.String: "varchar"}
        cursor: Any = link.connection.cursor()
        with cursor, cursor.copy(f"copy {table.name} ({', '.join(names)}) from stdin (format binary)") as stream:
            stream.set_types([kinds[type(column.type)] for column in table.c])
            for row in rows:
                stream.write_row(row)

    def _insert(self, table: sql.Table) -> Any:
        """An insertion that may find its row there already, in words of this database."""
        if self.engine.dialect.name == "postgresql":
            from sqlalchemy.dialects.postgresql import insert

            return insert(table)
        from sqlalchemy.dialects.sqlite import insert as insert_here

        return insert_here(table)

    def numbers(self, robot: str | None = None, type: str | None = None, *, last: int | None = None) -> list[int]:
        """Numbers of calibrations, robots by their ids, each in the order of its dates.

        Parameters
        ----------
        robot, type : str, optional
            Of one robot, of one type.
        last : int, optional
            So many of each robot; all unless given.
        """
        with self.engine.connect() as link:
            return [number for number, *_ in self._in_order(link, robot, type, last)]

    @staticmethod
    def _in_order(
        link: Connection, robot: str | None, type: str | None, last: int | None
    ) -> list[tuple[int, str, str, date]]:
        """Number, robot, type and date of calibrations, see `numbers`."""
        c = calibrations.c
        chosen = sql.select(c.number, c.robot, robots.c.type, c.measured).join_from(calibrations, robots)
        if robot is not None:
            chosen = chosen.where(robots.c.id == robot)
        if type is not None:
            chosen = chosen.where(robots.c.type == type)
        if last is not None:
            latest_first = c.measured.desc(), c.created.desc(), c.number.desc()
            rank = sql.func.row_number().over(partition_by=c.robot, order_by=latest_first)
            of_robots = sql.select(c.number, rank.label("rank"))
            ranked = (of_robots if robot is None else of_robots.where(c.robot == robot)).subquery()
            chosen = chosen.join(ranked, ranked.c.number == c.number).where(ranked.c.rank <= last)
        return list(map(tuple, _rows(link, chosen.order_by(c.robot, c.measured, c.created, c.number))))

    def calibrations(
        self,
        robot: str | None = None,
        type: str | None = None,
        *,
        last: int | None = None,
        parts: Sequence[str] = PARTS,
    ) -> Iterator[Stored]:
        """Calibrations in the order of `numbers`; read while they are asked for.

        Parameters
        ----------
        robot, type, last
            See `numbers`.
        parts : sequence of str
            The estimates that are read, of `PARTS`; what else is listed and the files come with all of them.
        """
        return self.of_numbers(self.numbers(robot, type, last=last), parts)

    def of_numbers(self, numbers: Sequence[int], parts: Sequence[str] = PARTS) -> Iterator[Stored]:
        """Calibrations by their numbers, in this order; see `calibrations`."""
        everything = set(parts) == set(PARTS)
        with self.engine.connect() as link:
            for k in range(0, len(numbers), READ_AT_A_TIME):
                chunk = numbers[k : k + READ_AT_A_TIME]
                chosen = sql.select(robots.c.serial, robots.c.type, *calibrations.c).join_from(calibrations, robots)
                heads = {row["number"]: row for row in _checked(link, chosen.where(calibrations.c.number.in_(chunk)))}
                packed = {name: self._packed(link, name, chunk) for name in (*parts, *([OTHER] if everything else []))}
                of_files = self._files(link, chunk) if everything else {}
                for number in chunk:
                    if number not in heads:
                        continue
                    if "fit" in parts and number not in packed["fit"]:
                        raise _Damaged(f"calibration {number} has no parameters")
                    head = heads[number]
                    about = {"id": head["robot"], "serial": head.pop("serial"), "type": head.pop("type")}
                    fit, level, terms = (
                        p.estimate() if (p := packed.get(name, {}).get(number)) is not None else None for name in PARTS
                    )
                    other = packed.get(OTHER, {}).get(number, NONE)
                    yield Stored(about, head, fit, level, terms, _other(other), tuple(of_files.get(number, ())))

    def estimates(
        self,
        part: str,
        robot: str | None = None,
        type: str | None = None,
        *,
        last: int | None = None,
        factors: bool = True,
    ) -> Iterator[Dated]:
        """The same estimate of many calibrations, in the order of `numbers`; read while they are asked for.

        Parameters
        ----------
        part : str
            Of `PARTS`.
        robot, type, last
            See `numbers`.
        factors : bool
            Whether covariances are read.
        """
        with self.engine.connect() as link:
            rows = self._in_order(link, robot, type, last)
            for k in range(0, len(rows), READ_AT_A_TIME):
                some = rows[k : k + READ_AT_A_TIME]
                packed = self._packed(link, part, [row[0] for row in some], factors)
                for row in some:
                    yield Dated(*row, packed.get(row[0], NONE))

    def with_factors(self, part: str, light: Sequence[Dated]) -> list[Dated]:
        """Estimates that were read without their factors, with them."""
        out = []
        with self.engine.connect() as link:
            for k in range(0, len(light), READ_AT_A_TIME):
                some = light[k : k + READ_AT_A_TIME]
                packed = self._packed(link, part, [dated.number for dated in some])
                out += [replace(dated, packed=packed.get(dated.number, NONE)) for dated in some]
        return out

    def _packed(
        self, link: Connection, section: str, numbers: Sequence[int], factors: bool = True
    ) -> dict[int, PackedEstimate]:
        """Estimates of some calibrations."""
        table = estimates[section]
        columns = [column for column in table.c if factors or column.name not in ("prior", "factor")]
        out: dict[int, PackedEstimate] = {}
        sizes: dict[int, tuple[int, ...]] = {}
        for number, of_list, *blobs in _rows(link, sql.select(*columns).where(table.c.calibration.in_(numbers))):
            parameters = self._list(link, of_list)
            if of_list not in sizes:
                k = len(parameters.names)
                sizes[of_list] = (8 * k, 4 * k, 4 * k if section in PARTS else 0, 2 * k * (k + 1))[: len(blobs)]
                if section in PARTS and None in parameters.natural:
                    raise _Damaged(f"calibration {number} has parameters without a natural size")
            if tuple(map(len, blobs)) != sizes[of_list]:
                raise _Damaged(f"calibration {number} has not the parameters of its covariance")
            out[number] = PackedEstimate(parameters, *(*blobs, b"", b"")[:4])
        for name, kind in (("value", "<f8"), ("std", "<f4"), ("prior", "<f4"))[: 3 if section in PARTS else 1]:
            numbers_of = np.frombuffer(b"".join([getattr(packed, name) for packed in out.values()]), kind)
            if np.isnan(numbers_of).any() or (name != "prior" and np.isinf(numbers_of).any()):
                raise _Damaged(f"table {table.name}, column {name}: numbers that are none")
        return out

    def _list(self, link: Connection, number: int) -> ParameterList:
        """A list of parameters, read once."""
        if number not in self._lists:
            chosen = sql.select(parameter_lists.c.content, parameter_lists.c.sha256)
            rows = list(_rows(link, chosen.where(parameter_lists.c.number == number)))
            if not rows or hashlib.sha256(rows[0][0].encode()).hexdigest() != rows[0][1]:
                raise _Damaged(f"list of parameters {number} is not there, or not what it was")
            self._lists[number] = ParameterList.from_text(rows[0][0])
        return self._lists[number]

    @staticmethod
    def _files(link: Connection, numbers: Sequence[int]) -> dict[int, list[tuple[str, str]]]:
        """Names and hashes of the data of some calibrations."""
        out: dict[int, list[tuple[str, str]]] = {}
        chosen = sql.select(files).where(files.c.calibration.in_(numbers))
        for number, _, name, sha256 in _rows(link, chosen.order_by(files.c.calibration, files.c.position)):
            out.setdefault(number, []).append((name, sha256))
        return out

    def counts(self, type: str | None = None, robot: str | None = None) -> dict[str, tuple[int, int]]:
        """How many calibrations each robot (of a type; or one) has, and how many are from simulated measurements."""
        simulated = sql.func.sum(sql.case((calibrations.c.simulated, 1), else_=0))
        chosen = sql.select(calibrations.c.robot, sql.func.count(), simulated).join_from(calibrations, robots)
        if type is not None:
            chosen = chosen.where(robots.c.type == type)
        if robot is not None:
            chosen = chosen.where(robots.c.id == robot)
        with self.engine.connect() as link:
            rows = link.execute(chosen.group_by(calibrations.c.robot)).all()
        return {str(robot): (int(count), int(of_simulated)) for robot, count, of_simulated in rows}

    def errors(self, type: str | None = None) -> list[dict[str, Any]]:
        """Robot, type, number, date and held-out mean error of all calibrations, in the order of `numbers`."""
        c = calibrations.c
        chosen = sql.select(c.robot, robots.c.type, c.number, c.measured, c.heldout_mean_mm)
        chosen = chosen.join_from(calibrations, robots).order_by(c.robot, c.measured, c.created, c.number)
        with self.engine.connect() as link:
            return _checked(link, chosen if type is None else chosen.where(robots.c.type == type))

    def robots(self) -> list[dict[str, str]]:
        """All robots by their ids."""
        with self.engine.connect() as link:
            return _checked(link, sql.select(robots).order_by(robots.c.id))

    def frames(self, name: str) -> Iterator[pd.DataFrame]:
        """Rows of ``robots``, ``calibrations``, ``parameters`` or ``files``, some thousands at a time; one at least.

        Parameters are in rows, with robot and date, those of a calibration together; files have robot and date, too.
        """
        import pandas as pd

        if name == "parameters":
            yield from self._parameter_frames()
            return
        table = tables.tables[name]
        chosen = sql.select(*table.c).order_by(*table.primary_key.columns)
        if name == "files":
            about = calibrations.c.robot, calibrations.c.measured
            chosen = sql.select(*about, *table.c).join_from(files, calibrations, isouter=True)
            chosen = chosen.order_by(*table.primary_key.columns)  # a file of no calibration is a damage
        columns = [column.name for column in chosen.selected_columns]
        with self.engine.connect() as link:
            rows = _rows(link, chosen)
            chunk = list(islice(rows, ROWS))
            yield pd.DataFrame(chunk, columns=columns)
            while chunk := list(islice(rows, ROWS)):
                yield pd.DataFrame(chunk, columns=columns)

    def _parameter_frames(self) -> Iterator[pd.DataFrame]:
        """Parameters of some hundred calibrations at a time."""
        import pandas as pd

        with self.engine.connect() as link:
            heads = self._in_order(link, None, None, None)
            for table in estimates.values():
                of_none = sql.select(table.c.calibration).join_from(table, calibrations, isouter=True)
                for number in link.execute(of_none.where(calibrations.c.number.is_(None)).limit(1)).scalars():
                    raise _Damaged(f"table {table.name} names calibration {number!a}, which is not there")
            for k in range(0, max(len(heads), 1), READ_AT_A_TIME):
                some = heads[k : k + READ_AT_A_TIME]
                columns: dict[str, list[Any]] = {name: [] for name in PARAMETER_COLUMNS}
                for part in (*PARTS, OTHER):
                    packed = self._packed(link, part, [row[0] for row in some], factors=False)
                    for number, robot, type, measured in some:
                        if number in packed:
                            _append(columns, packed[number], (robot, type, measured, number, part))
                yield pd.DataFrame({name: np.concatenate(parts or [[]]) for name, parts in columns.items()})


PARAMETER_COLUMNS = (
    *("robot", "type", "measured", "calibration", "part"),
    *("position", "name", "value", "std", "prior", "natural", "unit", "state"),
)


def _append(columns: Mapping[str, list[Any]], packed: PackedEstimate, head: tuple[Any, ...]) -> None:
    """Rows of parameters of an estimate, column by column; what is not there or infinite is not a number."""
    p, k = packed.parameters, len(packed.parameters.names)
    prior = packed.numbers("prior") if packed.prior else np.full(k, np.nan)
    for name, value in zip(PARAMETER_COLUMNS, head, strict=False):
        columns[name].append(np.repeat(np.array([value], dtype=np.int64 if name == "calibration" else object), k))
    columns["position"].append(np.arange(k))
    for name, texts in (("name", p.names), ("unit", p.units), ("state", p.states)):
        columns[name].append(np.array(texts, dtype=object))
    columns["value"].append(packed.numbers("value"))
    columns["std"].append(packed.numbers("std"))
    columns["prior"].append(np.where(np.isfinite(prior), prior, np.nan))
    columns["natural"].append(np.array(p.natural, dtype=float))


class _Damaged(Exception):
    """What stands in a store cannot have been written by irbcal."""


def _rows(link: Connection, chosen: sql.Select[Any]) -> Iterator[Any]:
    """Rows whose values are of their columns' types: SQLite keeps anything anywhere."""
    columns = [cast("sql.Column[Any]", column) for column in chosen.exported_columns]
    kinds = [_kinds(column) for column in columns]
    floats = [k for k, column in enumerate(columns) if column.type.python_type is float]
    good: set[tuple[type, ...]] = set()
    try:
        for row in link.execute(chosen, execution_options={"yield_per": ROWS}):
            types = tuple(map(type, row))
            wrong = () if types in good else [k for k, kind in enumerate(types) if not issubclass(kind, kinds[k])]
            for k in (*wrong, *(k for k in floats if row[k] is not None and not math.isfinite(row[k]))):
                column = columns[k]
                raise _Damaged(f"table {column.table.name}, column {column.name}: {ascii(row[k])[:50]}")
            good.add(types)
            yield row
    except (ValueError, TypeError) as error:  # a date that is none
        raise _Damaged(str(error)) from None


def _kinds(column: sql.Column[Any]) -> tuple[type, ...]:
    """Types that a value of a column may have."""
    kind = column.type.python_type
    return (kind, *((int,) if kind is float else ()), *((type(None),) if column.nullable else ()))


def _checked(link: Connection, chosen: sql.Select[Any]) -> list[dict[str, Any]]:
    """The same as dicts."""
    return [dict(row._mapping) for row in _rows(link, chosen)]


@contextmanager
def opened(store: str | Path, create: bool = False) -> Iterator[Store]:
    """Open a store.

    Parameters
    ----------
    store : str or Path
        File of SQLite, or a URL such as ``postgresql+psycopg://USER@HOST/NAME``.
    create : bool
        Make its tables where there are none.

    Raises
    ------
    CalibrationError
        If it cannot be opened, is no store, or fails while it is used.
    OptionError
        If the URL is of another database.
    """
    engine, url = _engine(store, create)
    new = create and "://" not in url and not Path(url).exists()
    try:
        _check(engine, url, create)
        yield Store(engine)
        if new and not Path(url).exists():
            raise CalibrationError("the store is gone, as another writer that made it failed: add again", file=url)
    except BaseException as error:
        if new:
            _remove_if_empty(engine, Path(url))
        if isinstance(error, (_Damaged, UnicodeDecodeError)):  # SQLite's own words can hold what stands in the file
            raise CalibrationError(f"the store is damaged: {error}", file=url) from None
        if isinstance(error, DBAPIError):
            raise CalibrationError(f"the store failed: {str(error.orig).strip().splitlines()[0]}", file=url) from None
        raise
    finally:
        engine.dispose()


def _remove_if_empty(engine: Engine, path: Path) -> None:
    """Remove a file of SQLite that was made for nothing, while no other writer adds to it."""
    with suppress(DBAPIError, UnicodeDecodeError), engine.execution_options(writes=True).begin() as link:
        has_table = calibrations.name in sql.inspect(link).get_table_names()
        if not has_table or not link.execute(sql.select(sql.func.count()).select_from(calibrations)).scalar_one():
            path.unlink(missing_ok=True)
    if path.exists() and path.stat().st_size == 0:  # there was no space to look into it
        path.unlink()


def _engine(store: str | Path, create: bool) -> tuple[Engine, str]:
    """The engine, and how messages call it: never with a password."""
    text = str(store)
    if "://" not in text:
        path = Path(text)
        if path.is_dir():
            raise CalibrationError("expected a file for the store, found a folder", file=path)
        if not create and not path.is_file():
            raise CalibrationError(f"{NOT_THERE}: irbcal fleet add makes one", file=path)
        if create:
            try:
                path.parent.mkdir(parents=True, exist_ok=True)
            except OSError as error:
                raise CalibrationError(f"cannot write to this folder: {error.strerror}", file=path.parent) from None
        engine = sql.create_engine(sql.URL.create("sqlite", database=str(path)), connect_args={"timeout": 60})
        sql.event.listen(engine, "connect", _for_sqlite)
        sql.event.listen(engine, "begin", _begin_sqlite)
        return engine, text
    try:
        url = sql.make_url(text)
        if url.get_backend_name() not in DIALECTS:
            raise OptionError(
                f"store: expected a file or postgresql+psycopg://USER@HOST/NAME, found {url.get_backend_name()}",
                parameter="store",
            )
        return sql.create_engine(url, pool_pre_ping=True), url.render_as_string(hide_password=True)
    except (ArgumentError, NoSuchModuleError):
        raise OptionError("store: expected a file or postgresql+psycopg://USER@HOST/NAME", parameter="store") from None
    except ModuleNotFoundError:
        raise OptionError(
            "store: PostgreSQL needs psycopg: pip install 'irbcal[postgres]'", parameter="store"
        ) from None


def _for_sqlite(link: Any, _: object) -> None:
    """Keys are checked, a commit is on the disk when it is done, and making tables is part of a transaction."""
    link.isolation_level = None  # Python's module would begin none before tables are made
    for pragma in ("foreign_keys = on", "synchronous = full"):
        link.execute(f"pragma {pragma}")


def _begin_sqlite(link: sql.Connection) -> None:
    """Who writes waits for others before reading what there is; who reads waits for nobody."""
    link.exec_driver_sql("begin immediate" if link.get_execution_options().get("writes") else "begin")


def _check(engine: Engine, name: str, create: bool) -> None:
    """See that it is a store of this version; make it where it is to be added to."""
    if create:
        with engine.execution_options(writes=True).begin() as link:
            if engine.dialect.name == "postgresql":  # two that make it at a time wait for each other
                link.execute(sql.text("select pg_advisory_xact_lock(74728)"))
            names = set(sql.inspect(link).get_table_names())
            if about.name not in names:
                strangers = sorted(names & set(tables.tables))
                if strangers:
                    raise CalibrationError(f"{NOT_THERE}, but it has a table {strangers[0]}", file=name)
                tables.create_all(link)
                link.execute(sql.insert(about).values(version=VERSION))
    with engine.connect() as link:
        if about.name not in sql.inspect(link).get_table_names():
            raise CalibrationError(f"{NOT_THERE}: irbcal fleet add makes one", file=name)
        versions = link.execute(sql.select(about.c.version)).scalars().all()
    if len(versions) != 1 or not isinstance(versions[0], int):
        raise CalibrationError(f"{NOT_THERE}: its table {about.name} does not say its version", file=name)
    if versions != [VERSION]:
        raise CalibrationError(f"a store of version {versions[0]}, this irbcal reads {VERSION}", file=name)
