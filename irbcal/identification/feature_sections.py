"""What ``calibration.json`` says of features that were touched: each of them, places left out, known lengths."""

from __future__ import annotations

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


class LengthRow(Section):
    """A known length: residuals (known minus fitted), mm; left out where its place was, null where it never was."""

    name: Name
    first: Name
    second: Name
    length_mm: float
    fitted_mm: float
    nominal_mm: float | None
    heldout_mm: float | None


class FeaturesSection(Section):
    """Features, places and lengths.

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
    lengths: list[LengthRow]
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
        pairs = [
            (abs(r.nominal_mm), abs(r.heldout_mm))
            for r in self.lengths
            if r.nominal_mm is not None and r.heldout_mm is not None
        ]
        if not pairs:
            return None
        return sum(a for a, _ in pairs) / len(pairs), sum(b for _, b in pairs) / len(pairs)
