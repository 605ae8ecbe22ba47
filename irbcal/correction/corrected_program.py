"""What the filter makes of a program: its new bytes, what changed, what was left and why."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from irbcal.arrays import FloatArray, IntArray, NameArray
from irbcal.correction.fake_targets import corrected_in_words
from irbcal.correction.paths import CutPath
from irbcal.correction.program import Note, Unchanged
from irbcal.correction.true_frames import NULL, TargetFrames, UnknownFrames
from irbcal.errors import ProgramError
from irbcal.modeling.arm import Arm
from irbcal.summary import Paragraph, Result, Table, remarks, values
from irbcal.units import DEG, MM
from irbcal.wording import and_more

if TYPE_CHECKING:
    import pandas as pd

LISTED_CHANGES = 10
"""Changes that are shown; all are in the frame."""

OF_TARGETS = ("targets", "lines", "q_before", "q", "shift", "turn", "residual", "positions")
"""Arrays with a row for each corrected target."""
UNCHANGED_SHOWN = 50
"""Targets left for one reason that are shown each by itself; all are in the JSON result."""


@dataclass(frozen=True, eq=False, repr=False)
class CorrectedProgram(Result):
    """A corrected program of n corrected targets.

    Attributes
    ----------
    source : str
        File name of the program.
    files : dict of str to bytes
        Contents of the new files by the names of the old ones; what could not be corrected is as it was.
    targets : ndarray of str, shape (n,)
        Names of the corrected targets.
    lines : ndarray of int, shape (n,)
        Where they stand in the file, from 1.
    q_before, q : ndarray, shape (n, joints)
        Joints that the controller would have commanded, and those that it commands now; radians (metres for prismatic
        joints).
    shift, turn : ndarray, shape (n,)
        Distance (metres) and angle (radians) from the wanted to the fake pose.
    residual : ndarray, shape (n,)
        Distance that the calibrated model still misses by, metres.
    unchanged_targets : tuple of Unchanged
        Targets and moves that were left as they were, in the order of the file.
    notes : tuple of Note
        What the corrections do not know about.
    arm : Arm
        Nominal: tables and texts hold joints as its controller counts them.
    fingerprint : str
        Of the calibration, as in the mark.
    expected_error : float or None
        Mean error of the calibration's held-out poses, metres; None where it has none.
    cautions : tuple of str
        What to doubt of all corrections: targets outside the joint ranges of the calibration's fit.
    written : Path or None
        File of the program with fake targets, if it was asked for.
    last_move_error : ndarray, shape (n,), or None
        What an unknown last move, or one from different sides, adds to the error, metres (root mean square); None
        for calibrations that do not depend on last moves.
    last_moves : tuple of two int, or None
        Stops whose last move the order of the program tells, and all stops at corrected targets.
    paths : tuple of CutPath, or None
        The straight and circular moves with what was put into them; None where no path tolerance was asked for.
    frames : TargetFrames or None
        Tool, work object and origin of each corrected target.
    unchanged : int
        Targets that need no correction: taught points.
    positions : ndarray, shape (n, 3, 3)
        Of each target the tool centre point where it is wanted, and where the calibrated robot takes it before and
        after the correction, in the base link, metres.
    visited : ndarray of int, shape (k,)
        Rows of the corrected targets in the order in which the program stops at them.
    shifts : ndarray, or None
        Of a long table, whose other arrays hold the first targets alone: ``shift`` of all corrected ones.
    simulated : bool
        Whether the calibration is from simulated data.
    refused : bool
        Whether files were asked for and none was written: see `NotWritten`.
    """

    source: str
    files: Mapping[str, bytes]
    targets: NameArray
    lines: IntArray
    q_before: FloatArray
    q: FloatArray
    shift: FloatArray
    turn: FloatArray
    residual: FloatArray
    unchanged_targets: tuple[Unchanged, ...]
    notes: tuple[Note, ...]
    arm: Arm
    fingerprint: str
    expected_error: float | None = None
    written: Path | None = None
    cautions: tuple[str, ...] = ()
    last_move_error: FloatArray | None = None
    last_moves: tuple[int, int] | None = None
    paths: tuple[CutPath, ...] | None = None
    frames: TargetFrames | None = None
    unchanged: int = 0
    positions: FloatArray = field(default_factory=lambda: np.zeros((0, 3, 3)))
    visited: IntArray = field(default_factory=lambda: np.zeros(0, dtype=int))
    shifts: FloatArray | None = None
    simulated: bool = False
    refused: bool = False

    def not_written(self, reason: str = "") -> NotWritten:
        """Why nothing of it is written: for a reason, because nothing is corrected, or because something is left."""
        if reason:
            message = f"nothing was written: {reason}"
        elif not len(self.targets):
            taught = f", and {self.unchanged} need no change" if self.unchanged else ""
            message = f"nothing was written: no target could be corrected{taught}"
        else:
            first = self.unchanged_targets[0]
            more = and_more(len(self.unchanged_targets) - 1)
            message = (
                f"nothing was written, because {first.with_line}{more} could not be corrected: "
                "correct these targets or allow a partial correction (--allow-partial)"
            )
        refusal = NotWritten(message, file=self.source)
        refusal.filtered = replace(self, refused=True)
        return refusal

    @property
    def all_shifts(self) -> FloatArray:
        """Distance from the wanted to the fake pose of every corrected target, metres."""
        return self.shift if self.shifts is None else self.shifts

    @property
    def verb(self) -> str:
        """What is said of its targets."""
        return "can be corrected" if self.refused else "corrected"

    @property
    def data(self) -> bytes:
        """Content of the new file, of the first where there are several."""
        return next(iter(self.files.values()))

    @property
    def complete(self) -> bool:
        """Whether nothing was left as it was."""
        return not self.unchanged_targets

    @property
    def unknown_frames(self) -> UnknownFrames | None:
        """Tools and work objects of unknown origin, and what is at stake; None where there are none."""
        return None if self.frames is None else self.frames.unknown()

    @property
    def expected_errors(self) -> FloatArray | None:
        """Of each target the held-out error and what an unknown last move adds, metres, (n,); None where not known."""
        if self.last_move_error is None or self.expected_error is None:
            return None
        return np.hypot(self.expected_error, self.last_move_error)

    def to_frame(self) -> pd.DataFrame:
        """A row for each corrected target, in the units of files.

        Columns ``target``, ``line``, joints before (``q1_deg_before`` …) and after (``q1_deg`` …), ``shift_mm``,
        ``turn_deg`` (from the wanted to the fake pose) and ``residual_mm`` (what the calibrated model still misses by).
        Of calibrations that depend on the last move also ``last_move_mm`` (what an unknown one adds) and
        ``expected_mm`` (with the mean error of held-out poses). Of programs with tools and work objects also ``tool``,
        ``work_object``, ``frames`` (their origin: null, measured, cell, unknown) and ``points`` (offline or taught);
        with a cell ``part_mean_mm`` and ``part_u95_mm``, the expected error of the part.
        """
        import pandas as pd

        return pd.DataFrame(
            {
                "target": self.targets,
                "line": self.lines,
                **{f"{name}_before": q for name, q in self.arm.joint_table(self.q_before).items()},
                **self.arm.joint_table(self.q),
                **values(
                    self, "shift_mm turn_deg residual_mm last_move_mm?=last_move_error expected_mm?=expected_errors"
                ),
                **({} if self.frames is None or not any(self.frames.tools) else self.frames.columns()),
            }
        )

    CONTENT = (
        "program=source written fingerprint *figures expected_error_mm targets=to_frame left=unchanged_targets notes "
        "cautions unknown_frames unchanged simulated paths?=cut_paths"
    )

    @property
    def figures(self) -> dict[str, float | None]:
        """Over all corrected targets: their number, shifts in mm, and what last moves, tools and work objects add."""
        shifts, frame = self.all_shifts / MM, self.to_frame()
        out: dict[str, float | None] = {"corrected": len(shifts), "mean_shift_mm": None, "max_shift_mm": None}
        if len(shifts):
            out |= {"mean_shift_mm": shifts.mean(), "max_shift_mm": shifts.max()}
        if "part_mean_mm" in frame:
            out |= {"part_mean_mm": frame["part_mean_mm"].mean(), "max_part_u95_mm": frame["part_u95_mm"].max()}
        if self.last_moves is not None and self.last_move_error is not None:
            errors = self.expected_errors
            out |= dict(zip(("last_moves_known", "stops"), self.last_moves, strict=True))
            out["max_last_move_mm"] = self.last_move_error.max(initial=0.0) / MM
            out["expected_with_last_moves_mm"] = None if errors is None or not errors.size else errors.mean() / MM
        return out

    @property
    def cut_paths(self) -> pd.DataFrame | None:
        """`paths_to_frame` where a path tolerance was asked for."""
        return None if self.paths is None else self.paths_to_frame()

    def report(self) -> list[Paragraph]:
        """How many targets changed by how much, the first of them, and what was left and why."""
        unknown = self.unknown_frames
        sentences: list[Paragraph] = ["Calibration from SIMULATED data"] if self.simulated else []
        sentences += [] if unknown is None else [f"WARNING: {unknown.in_words()}"]
        if not self._re_expressed:
            sentences.append(corrected_in_words(self.all_shifts, verb=self.verb))
        if self.frames is not None:
            sentences += self.frames.report(self.unchanged)
        if len(self.targets):
            sentences.append(self._first_changes())
        if len(self.all_shifts) > LISTED_CHANGES:
            sentences.append(f"… and {len(self.all_shifts) - LISTED_CHANGES} more")
        if self.expected_error is not None and not self._re_expressed:
            mean = self.expected_error / MM
            robot_only = ", of the robot alone: tools and work objects add their errors" if self._framed else ""
            sentences.append(
                f"Expected error afterwards: {mean:.3f} mm mean, that of the calibration's held-out poses{robot_only}"
            )
        sentences += [*self._last_moves_in_words(), *self._paths_in_words()]
        sentences += self._left_in_words()
        sentences += remarks("Note", self.cautions)
        sentences += remarks("Note", (f"line {note.line}: {note.text}" for note in self.notes))
        if self.written is not None:
            sentences.append(f"Written to {self.written}")
        return sentences

    @property
    def _re_expressed(self) -> bool:
        return self.frames is not None and self.frames.re_expressed

    @property
    def _framed(self) -> bool:
        """Whether a tool or work object matters."""
        return self.frames is not None and bool(set(self.frames.origins) - {"", NULL})

    def _left_in_words(self) -> list[Paragraph]:
        """What was left as it was: each by itself, of very many with the same reason the first."""
        sentences, alike = list[Paragraph](), dict[str, list[int]]()
        for target in self.unchanged_targets:
            lines = alike.setdefault(target.reason, [])
            if len(lines) < UNCHANGED_SHOWN:
                sentences.append(f"  left as it was: {target.with_line}: {target.reason}")
            lines.append(target.line)
        for reason, lines in alike.items():
            if more := lines[UNCHANGED_SHOWN:]:
                where = f"lines {min(more)} to {max(more)}" if len(more) > 1 else f"line {more[0]}"
                sentences.append(f"  left as they were: {len(more)} more in {where}: {reason}")
        return sentences

    def _last_moves_in_words(self) -> list[Paragraph]:
        if self.last_moves is None or self.last_move_error is None:
            return []
        known_count, stops = self.last_moves
        sentences: list[Paragraph] = [
            f"The order of the program tells the last move before {known_count} of {stops} stops"
        ]
        much = float(self.last_move_error.max(initial=0.0)) / MM
        if much >= 5e-4:
            errors = self.expected_errors
            mean = "" if errors is None else f"; with it the expected error is {errors.mean() / MM:.3f} mm mean"
            sentences.append(
                f"  where it is not known, or a target is reached from several sides, up to {much:.3f} mm is added "
                f"(root mean square){mean}"
            )
        return sentences

    def paths_to_frame(self) -> pd.DataFrame:
        """A row for each straight and circular move; empty where no path tolerance was asked for.

        Columns ``move``, ``line``, ``length_mm``, ``pieces``, ``deviation_mm`` (of the true path from the wanted one,
        as cut), ``uncut_mm``, ``turning_back`` (joints, with how far along the path: ``4 at 120 mm``) and ``reason``
        (why the tolerance is not kept).
        """
        import pandas as pd

        rows = []
        for cut in self.paths or ():
            turns = ", ".join(f"{turn.joint} at {turn.s * cut.length / MM:.0f} mm" for turn in cut.turns)
            numbers = cut.length / MM, cut.pieces, cut.deviation / MM, cut.uncut / MM
            rows.append((cut.move.name, cut.move.line, *numbers, turns, cut.reason))
        names = ["move", "line", "length_mm", "pieces", "deviation_mm", "uncut_mm", "turning_back", "reason"]
        return pd.DataFrame(rows, columns=names)

    def _paths_in_words(self) -> list[Paragraph]:
        if self.paths is None:
            return []
        cut = [path for path in self.paths if path.pieces > 1]
        within = [path.deviation for path in self.paths if not path.reason]
        most = f", which leave their paths by {max(within) / MM:.3f} mm at most" if within else ""
        kept = f"{len(within)} keep the tolerance{most}; {len(cut)} were cut"
        head = f"{len(self.paths)} straight and circular moves: {kept}"
        columns = ("move", "line", "length mm", "pieces", "uncut mm", "deviation mm", "joints that turn back")
        measured_paths = self.paths_to_frame().query("deviation_mm == deviation_mm").head(LISTED_CHANGES)
        rows = measured_paths[["move", "line", "length_mm", "pieces", "uncut_mm", "deviation_mm", "turning_back"]]
        return [head, *([Table.from_frame("Paths", rows, columns)] if len(rows) else [])]

    def _first_changes(self) -> Table:
        slides = self.arm.table.prismatic.any()
        changes = self.arm.joint_table(self.q[:LISTED_CHANGES] - self.q_before[:LISTED_CHANGES])
        largest = np.abs([*changes.values()]).max(axis=0)
        rows = zip(self.targets, self.lines, self.shift / MM, self.turn / DEG, largest, strict=False)
        return Table(
            "Changes",
            ("target", "line", "shift mm", "turn deg", f"largest joint change deg{' (mm)' if slides else ''}"),
            tuple((str(name), int(line), float(s), float(t), float(q)) for name, line, s, t, q in rows),
            digits=4,
        )


class NotWritten(ProgramError):
    """Files were asked for, but not everything (or nothing) could be corrected, so none was written."""

    filtered: CorrectedProgram
    """What was corrected, and what was left and why."""


def together(programs: Sequence[CorrectedProgram], places: Mapping[str, str]) -> CorrectedProgram:
    """What the filter made of several programs, as one; targets are named with their files, by their ``places``."""
    if len(programs) == 1:
        return programs[0]
    names = [places.get(program.source, Path(program.source).name) for program in programs]
    program_names = [*zip(programs, names, strict=True)]
    sizes = np.array([len(program.targets) for program in programs])

    def joined(key: str) -> Any:
        return np.concatenate([getattr(program, key) for program in programs])

    arrays = {name: joined(name) for name in OF_TARGETS}
    arrays["targets"] = np.array([f"{t} in {name}" for program, name in program_names for t in program.targets], object)
    return replace(
        programs[0],
        **arrays,
        source=", ".join(names),
        files={name: data for program in programs for name, data in program.files.items()},
        unchanged_targets=tuple(
            Unchanged(f"{t} in {name}", line, reason)
            for program, name in program_names
            for t, line, reason in program.unchanged_targets
        ),
        notes=tuple(
            Note(note.line, f"{name}: {note.text}") for program, name in program_names for note in program.notes
        ),
        last_move_error=None if programs[0].last_move_error is None else joined("last_move_error"),
        last_moves=_sum([program.last_moves for program in programs]),
        paths=None
        if programs[0].paths is None
        else tuple(path for program in programs for path in program.paths or ()),
        frames=TargetFrames.joined([program.frames for program in programs if program.frames is not None]),
        unchanged=sum(program.unchanged for program in programs),
        visited=np.concatenate(
            [program.visited + before for program, before in zip(programs, np.cumsum(sizes) - sizes, strict=True)]
        ).astype(int),
    )


def _sum(counts: Sequence[tuple[int, int] | None]) -> tuple[int, int] | None:
    counted = [count for count in counts if count is not None]
    return (sum(k for k, _ in counted), sum(n for _, n in counted)) if counted else None
