"""A store of calibrations: SQLite as a file, or PostgreSQL by its URL, by SQLAlchemy Core.

A calibration is added in one transaction, whole or not at all, and once: a second time it is found.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field, replace
from datetime import date
from functools import lru_cache
from pathlib import Path
from typing import TYPE_CHECKING, Any, cast

import numpy as np

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

VERSION = 2
"""Of the tables."""
NOT_THERE = "no store of a fleet"
DIALECTS = ("sqlite", "postgresql")

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
    sql.Column("robot", sql.ForeignKey("robots.id"), nullable=False, index=True),
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
    sql.Column("fit_covariance", sql.LargeBinary, nullable=False),
    sql.Column("level_covariance", sql.LargeBinary),
    sql.Column("terms_covariance", sql.LargeBinary),
    sql.UniqueConstraint("robot", "fingerprint", "measured"),
)
parameters = sql.Table(
    "parameters",
    tables,
    sql.Column("calibration", sql.ForeignKey("calibrations.number"), primary_key=True),
    sql.Column("part", sql.String(10), primary_key=True),
    sql.Column("position", sql.Integer, primary_key=True),
    sql.Column("name", sql.String(200), nullable=False, index=True),
    sql.Column("value", sql.Float(53), nullable=False),
    sql.Column("std", sql.Float(53)),
    sql.Column("prior", sql.Float(53)),
    sql.Column("natural", sql.Float(53)),
    sql.Column("unit", sql.String(20), nullable=False),
    sql.Column("state", sql.String(20), nullable=False),
)
files = sql.Table(
    "files",
    tables,
    sql.Column("calibration", sql.ForeignKey("calibrations.number"), primary_key=True),
    sql.Column("position", sql.Integer, primary_key=True),
    sql.Column("name", sql.Text, nullable=False),
    sql.Column("sha256", sql.String(64), nullable=False),
)


TOGETHER = 200
"""Calibrations that are read at a time."""
PARTS = ("fit", "level", "terms")
"""Of the parameters: those of the calibration, those of a level fitted to its points, and those terms that robots of a
type are compared by; ``other``: base, targets, what is held."""


@dataclass(frozen=True, eq=False)
class Estimate:
    """Parameters with their covariance.

    Attributes
    ----------
    names, units : tuple of str
    values, prior, natural : ndarray, shape (k,)
        Their values, what was expected of them before (standard deviation; infinite for levels, which expect nothing)
        and what is natural on an industrial arm, SI units.
    covariance : ndarray, shape (k, k)
        Shape (0, 0) in what `without_covariance` gives.
    std : ndarray, shape (k,)
        Standard deviations.
    """

    names: tuple[str, ...]
    units: tuple[str, ...]
    values: FloatArray
    prior: FloatArray
    natural: FloatArray
    covariance: FloatArray
    std: FloatArray = field(init=False)

    def __post_init__(self) -> None:
        object.__setattr__(self, "std", np.sqrt(np.maximum(np.diagonal(self.covariance), 0.0)))

    @property
    def place(self) -> Mapping[str, int]:
        """Positions of the parameters by their names."""
        return _places(self.names)

    def without_covariance(self) -> Estimate:
        """The same with its standard deviations alone: a fleet's covariances need much memory."""
        light = replace(self, covariance=np.zeros((0, 0)))
        object.__setattr__(light, "std", self.std)
        return light

    def rows(self, part: str) -> list[dict[str, Any]]:
        """As rows of the table ``parameters``."""
        return [
            {
                "part": part,
                "position": k,
                "name": name,
                "value": float(self.values[k]),
                "std": float(self.std[k]),
                "prior": float(self.prior[k]) if np.isfinite(self.prior[k]) else None,
                "natural": float(self.natural[k]),
                "unit": self.units[k],
                "state": "identified",
            }
            for k, name in enumerate(self.names)
        ]

    @staticmethod
    def of(rows: Sequence[Mapping[str, Any]], factor: bytes) -> Estimate:
        """From rows and the covariance as `packed` gave it."""
        L = np.zeros((len(rows), len(rows)))
        L[np.tril_indices(len(rows))] = np.frombuffer(factor, "<f8")
        if not np.isfinite(L).all():
            raise ValueError("a covariance has numbers that are not finite")
        return Estimate(
            _shared(tuple(row["name"] for row in rows)),
            _shared(tuple(row["unit"] for row in rows)),
            np.array([row["value"] for row in rows]),
            np.array([np.inf if row["prior"] is None else row["prior"] for row in rows]),
            np.array([row["natural"] for row in rows]),
            L @ L.T,
        )

    def packed(self) -> bytes:
        """A factor L of the covariance ``L L'``, lower triangle row by row, little-endian floats of eight bytes."""
        values, vectors = np.linalg.eigh(self.covariance)
        R = np.linalg.qr((vectors * np.sqrt(np.maximum(values, 0.0))).T)[1]
        return bytes(R.T[np.tril_indices(len(self.names))].astype("<f8").tobytes())


@lru_cache(maxsize=1000)
def _places(names: tuple[str, ...]) -> Mapping[str, int]:
    return {name: k for k, name in enumerate(names)}


@lru_cache(maxsize=1000)
def _shared(texts: tuple[str, ...]) -> tuple[str, ...]:
    """The same tuple for equal ones: robots of a type have the same parameters."""
    return texts


@dataclass(frozen=True, eq=False)
class Stored:
    """A calibration as the store has it.

    Attributes
    ----------
    robot : dict
        ``id``, ``serial`` and ``type``.
    calibration : dict
        The columns of the table ``calibrations``, covariances left out.
    fit : Estimate or None
        Error parameters and terms of the calibration; None, as the next two, where it was not asked for.
    level : Estimate or None
        Those of the arm's own level, fitted to the calibration's points: the same parameters in every calibration;
        None where the calibration was saved without its points.
    terms : Estimate or None
        What its measurements show of the terms by which a type's prior is made (`irbcal.identification.term_sets`).
    other : tuple of dict
        Base, targets and what is held: rows of the table ``parameters``.
    files : tuple of (str, str)
        Names and hashes of the data.
    """

    robot: Mapping[str, str]
    calibration: Mapping[str, Any]
    fit: Estimate | None
    level: Estimate | None
    terms: Estimate | None = None
    other: tuple[Mapping[str, Any], ...] = ()
    files: tuple[tuple[str, str], ...] = ()

    @property
    def measured(self) -> date:
        """When it was measured; when it was calibrated, where that was not told."""
        return cast(date, self.calibration["measured"])


class Store:
    """A store that is open."""

    def __init__(self, engine: Engine) -> None:
        self.engine = engine

    def add(self, stored: Stored) -> bool:
        """Add a calibration, whole or not at all.

        Returns
        -------
        bool
            Whether it was not there yet.

        Raises
        ------
        CalibrationError
            If its robot is there with another serial number or of another type.
        """
        estimates: dict[str, Estimate | None] = {part_name: getattr(stored, part_name) for part_name in PARTS}
        with self.engine.execution_options(writes=True).begin() as link:
            link.execute(self._insert(robots).values(**stored.robot).on_conflict_do_nothing())
            head = link.execute(sql.select(robots).where(robots.c.id == stored.robot["id"])).mappings().one()
            for column in ("serial", "type"):
                if head[column] != stored.robot[column]:
                    raise CalibrationError(
                        f"robot {head['id']} is in the store with {column} {head[column]}, not {stored.robot[column]}",
                        file=stored.calibration["folder"],
                    )
            number = link.execute(
                self._insert(calibrations)
                .values(
                    **stored.calibration,
                    **{
                        f"{section}_covariance": None if estimate is None else estimate.packed()
                        for section, estimate in estimates.items()
                    },
                )
                .on_conflict_do_nothing()
                .returning(calibrations.c.number)
            ).scalar_one_or_none()
            if number is None:
                return False
            rows = [
                row for section, estimate in estimates.items() if estimate is not None for row in estimate.rows(section)
            ]
            link.execute(sql.insert(parameters), [{"calibration": number, **row} for row in (*rows, *stored.other)])
            if stored.files:
                file_rows = [
                    {"calibration": number, "position": k, "name": name, "sha256": sha256}
                    for k, (name, sha256) in enumerate(stored.files)
                ]
                link.execute(sql.insert(files), file_rows)
            return True

    def _insert(self, table: sql.Table) -> Any:
        """An insertion that may find its row there already, in words of this database."""
        if self.engine.dialect.name == "postgresql":
            from sqlalchemy.dialects.postgresql import insert

            return insert(table)
        from sqlalchemy.dialects.sqlite import insert as insert_here

        return insert_here(table)

    def calibrations(
        self,
        robot: str | None = None,
        type: str | None = None,
        *,
        last: int | None = None,
        parts: Sequence[str] = PARTS,
    ) -> Iterator[Stored]:
        """Calibrations, robots by their ids, each in the order of its dates; read while they are asked for.

        Parameters
        ----------
        robot, type : str, optional
            Of one robot, of one type.
        last : int, optional
            So many of each robot; all unless given.
        parts : sequence of str
            The estimates that are read, of `PARTS`; other rows of parameters and the files come with all of them.
        """
        rank = sql.func.row_number().over(
            partition_by=calibrations.c.robot,
            order_by=(calibrations.c.measured.desc(), calibrations.c.created.desc(), calibrations.c.number.desc()),
        )
        chosen = sql.select(calibrations.c.number, rank.label("rank")).join_from(calibrations, robots)
        if robot is not None:
            chosen = chosen.where(robots.c.id == robot)
        if type is not None:
            chosen = chosen.where(robots.c.type == type)
        ranked = chosen.subquery()
        numbered = sql.select(ranked.c.number).join(calibrations, calibrations.c.number == ranked.c.number)
        if last is not None:
            numbered = numbered.where(ranked.c.rank <= last)
        order = calibrations.c.robot, calibrations.c.measured, calibrations.c.created, calibrations.c.number
        with self.engine.connect() as link:
            try:
                numbers = list(link.execute(numbered.order_by(*order)).scalars())
            except (ValueError, TypeError) as error:  # a date that is none
                raise _Damaged(str(error)) from None
            for k in range(0, len(numbers), TOGETHER):
                yield from self._of_numbers(link, numbers[k : k + TOGETHER], parts)

    @staticmethod
    def _of_numbers(link: Connection, numbers: Sequence[int], parts: Sequence[str]) -> Iterator[Stored]:
        """Some calibrations, in this order."""
        absent = {f"{section}_covariance" for section in PARTS if section not in parts}
        heads = [column for column in calibrations.c if column.name not in absent]
        rows = _checked(
            link,
            sql.select(robots.c.serial, robots.c.type, *heads)
            .join_from(calibrations, robots)
            .where(calibrations.c.number.in_(numbers)),
        )
        everything = set(parts) == set(PARTS)
        of_parts = parameters.c.part.in_((*parts, "other") if everything else parts)
        of_parameters = Store._by_calibration(link, sql.select(parameters).where(of_parts), numbers) if parts else {}
        of_files = Store._by_calibration(link, sql.select(files), numbers) if everything else {}
        by_number = {row["number"]: row for row in rows}
        for number in numbers:
            if number in by_number:
                data = of_files.get(number, [])
                yield Store._stored(by_number[number], of_parameters.get(number, []), data, parts)

    @staticmethod
    def _by_calibration(
        link: Connection, chosen: sql.Select[Any], numbers: Sequence[int]
    ) -> dict[int, list[dict[str, Any]]]:
        """Rows of a table that belong to calibrations, by their numbers."""
        columns = chosen.selected_columns
        wanted = chosen.where(columns.calibration.in_(numbers)).order_by(columns.calibration, columns.position)
        out: dict[int, list[dict[str, Any]]] = {}
        for row in _checked(link, wanted):
            out.setdefault(row["calibration"], []).append(row)
        return out

    @staticmethod
    def _stored(
        head: dict[str, Any], rows: list[dict[str, Any]], data: list[dict[str, Any]], parts: Sequence[str]
    ) -> Stored:
        robot = {"id": head["robot"], "serial": head.pop("serial"), "type": head.pop("type")}
        rows_of = {section: [row for row in rows if row["part"] == section] for section in (*PARTS, "other")}
        estimates: dict[str, Estimate | None] = dict.fromkeys(PARTS)
        for section in parts:
            factor = head.pop(f"{section}_covariance")
            try:
                estimates[section] = None if factor is None else Estimate.of(rows_of[section], factor)
            except ValueError:
                raise _Damaged(f"calibration {head['number']} has not the parameters of its covariance") from None
        files_of = tuple((row["name"], row["sha256"]) for row in data)
        fit, level, terms = (estimates[section] for section in PARTS)
        return Stored(robot, head, fit, level, terms, tuple(rows_of["other"]), files_of)

    def counts(self, type: str | None = None) -> dict[str, tuple[int, int]]:
        """How many calibrations each robot (of a type) has, and how many of them are from simulated measurements."""
        simulated = sql.func.sum(sql.case((calibrations.c.simulated, 1), else_=0))
        chosen = sql.select(calibrations.c.robot, sql.func.count(), simulated).join_from(calibrations, robots)
        if type is not None:
            chosen = chosen.where(robots.c.type == type)
        with self.engine.connect() as link:
            rows = link.execute(chosen.group_by(calibrations.c.robot)).all()
        return {str(robot): (int(count), int(of_simulated)) for robot, count, of_simulated in rows}

    def robots(self) -> list[dict[str, str]]:
        """All robots by their ids."""
        with self.engine.connect() as link:
            return _checked(link, sql.select(robots).order_by(robots.c.id))

    def table(self, name: str) -> pd.DataFrame:
        """A table as it is: ``robots``, ``calibrations`` (without covariances), ``parameters`` or ``files``."""
        import pandas as pd

        chosen = [column for column in tables.tables[name].c if not column.name.endswith("_covariance")]
        with self.engine.connect() as link:
            rows = _checked(link, sql.select(*chosen).order_by(*tables.tables[name].primary_key.columns))
        return pd.DataFrame(rows, columns=[column.name for column in chosen])


class _Damaged(Exception):
    """What stands in a store cannot have been written by irbcal."""


def _checked(link: Connection, chosen: sql.Select[Any]) -> list[dict[str, Any]]:
    """Rows whose values are of their columns' types: SQLite keeps anything anywhere."""
    columns = [cast("sql.Column[Any]", column) for column in chosen.exported_columns]
    kinds = [(int, float) if column.type.python_type is float else column.type.python_type for column in columns]
    out = []
    try:
        for row in link.execute(chosen):
            for column, kind, value in zip(columns, kinds, row, strict=True):
                infinite = isinstance(value, float) and not math.isfinite(value)
                if infinite or not (isinstance(value, kind) or (value is None and column.nullable)):
                    raise _Damaged(f"table {column.table.name}, column {column.name}: {ascii(value)[:50]}")
            out.append(dict(row._mapping))
    except (ValueError, TypeError) as error:  # a date that is none
        raise _Damaged(str(error)) from None
    return out


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
    """See that it is a store of this version; make it where that is wanted."""
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
    version = versions[0]
    if version != VERSION:
        raise CalibrationError(f"a store of version {version}, this irbcal reads {VERSION}", file=name)
