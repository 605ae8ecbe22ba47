"""What ``calibration.json`` says of features that were touched: each of them, places left out, known lengths."""

from __future__ import annotations

import numpy as np

from irbcal.arrays import FloatArray, rms
from irbcal.section import Name, Section, Sentence, Word
from irbcal.units import MM


class FeatureRow(Section):
    """A feature: what was known of it and what was fitted.

    ``fitted`` has its unknowns in the base link (mm, degrees), ``known`` what was given of it, likewise; ``rms_mm`` is
    what its rows miss in the fit. At its rows the tool was about ``middle_mm``, within ``spread_mm`` (root mean
    square). ``imaging`` has what was given of camera and board, as in the features' file.
    """

    name: Name
    kind: Word
    target: Name
    rows: int
    place: Name
    rms_mm: float
    nominal_rms_mm: float
    fitted: dict[Name, list[float]]
    std: dict[Name, list[float]]
    known: dict[Name, list[float]]
    middle_mm: list[float]
    spread_mm: float
    imaging: dict[Name, Name]


class PlaceRow(Section):
    """A place that was left out of the fit: what its rows miss about features fitted again, mm."""

    name: Name
    rows: int
    nominal_mean_mm: float
    nominal_max_mm: float
    mean_mm: float
    rms_mm: float
    max_mm: float

    @staticmethod
    def from_misses(name: str, nominal: FloatArray, calibrated: FloatArray) -> PlaceRow:
        """The place of some rows, by what each misses with either robot, metres."""
        return PlaceRow(
            name=name,
            rows=len(nominal),
            nominal_mean_mm=float(nominal.mean()) / MM,
            nominal_max_mm=float(nominal.max()) / MM,
            mean_mm=float(calibrated.mean()) / MM,
            rms_mm=rms(calibrated) / MM,
            max_mm=float(calibrated.max()) / MM,
        )


class RelationRow(Section):
    """A known length or angle between two features, and known minus fitted ones.

    ``nominal`` and ``heldout`` are with either robot where its place was left out, null where it never was.
    """

    name: Name
    kind: Word
    first: Name
    second: Name
    unit: Word
    known: float
    fitted: float
    nominal: float | None
    heldout: float | None


class FeaturesSection(Section):
    """Features, places and what is known between features.

    ``left_out`` is what was held out in turn, null where nothing was. ``before_mm`` and ``open_mm`` are root mean
    square lengths of what was not known of the tool's place, before the rows and after them. ``feature_column``
    is the pattern of columns that names the feature of a row, empty where one column does; ``scale_from`` is what gives
    the robot its scale where that is a part of the features, as the squares of a board.
    """

    kinds: dict[Name, int]
    in_frame: bool
    scale_measured: bool
    left_out: Name | None
    before_mm: float
    open_mm: float
    features: list[FeatureRow]
    places: list[PlaceRow]
    relations: list[RelationRow]
    feature_column: Name
    scale_from: Sentence

    @property
    def scale(self) -> str:
        """Where the scale of the robot comes from, in a sentence; empty where lengths were measured."""
        if self.scale_from:
            return f"the scale rests on {self.scale_from}: were these 0.1 % longer, the robot would be, too"
        return (
            ""
            if self.scale_measured
            else "no length was measured that determines the size of the arm: the scale rests on nominal link lengths"
        )

    def length_error(self) -> tuple[float, float] | None:
        """Mean size of the errors of known lengths at left-out places, nominal and calibrated, mm."""
        pairs = self.left_out_lengths()
        if not len(pairs):
            return None
        nominal, calibrated = np.abs(pairs).mean(axis=0).tolist()
        return nominal, calibrated

    def left_out_lengths(self) -> FloatArray:
        """Known minus fitted lengths at left-out places, nominal and calibrated, shape (lengths, 2), mm."""
        rows = [(r.nominal, r.heldout) for r in self.relations if r.unit == "mm" and r.heldout is not None]
        return np.array(rows, dtype=float).reshape(-1, 2)
