"""The figures of a report for notebooks and files, one by one: ``calibration.plot``."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

from irbcal.errors import OptionError
from irbcal.io.schema import Record
from irbcal.plotting import pose_errors
from irbcal.plotting.charts import Chart
from irbcal.reports import evidence, model_figures, report_figures
from irbcal.reports.evidence import PoseSet


@dataclass(frozen=True, eq=False, repr=False)
class Plots:
    """The figures of a calibration; each shows itself in a notebook and has ``save(path)`` for PNG and SVG.

    Figures of poses take the held-out poses where there are any, else the fitted ones; ``fitted=True`` those.
    """

    _record: Record

    def __repr__(self) -> str:
        return f"<Figures of {self._record!r}>"

    @cached_property
    def _evidence(self) -> evidence.Evidence:
        return evidence.gather(self._record)

    def _of(self, draw: Callable[[PoseSet], Chart], fitted: bool, needs_places: bool = False) -> Chart:
        poses = self._evidence.sets[-1 if fitted else 0]
        if needs_places and poses.place is None:
            raise OptionError("this calibration was saved without the measured places")
        return draw(poses).marked(self._record.simulated)

    def before_and_after(self) -> Chart:
        """Mean error, its interval and the largest error of both models."""
        return self._of(pose_errors.before_and_after, False)

    def errors_by_pose(self, fitted: bool = False) -> Chart:
        """Mean error of each pose in order of measurement."""
        return self._of(pose_errors.errors_by_pose, fitted)

    def distribution(self, fitted: bool = False) -> Chart:
        """Histogram of the errors, and errors against normal quantiles."""
        return self._of(pose_errors.distribution, fitted)

    def workspace(self, fitted: bool = False) -> Chart:
        """Mean error of each pose where it was measured."""
        return self._of(pose_errors.workspace, fitted, True)

    def vectors(self, fitted: bool = False) -> Chart:
        """Error vectors, enlarged, where they were measured."""
        return self._of(pose_errors.vectors, fitted, True)

    def orientation(self, fitted: bool = False) -> Chart:
        """Orientation error of each pose, where orientations were measured."""
        poses = self._evidence.sets[-1 if fitted else 0]
        if any(model.rotation is None for model in poses.models.values()):
            raise OptionError("no orientations were measured")
        return self._of(pose_errors.turns_by_pose, fitted)

    def residuals_by_joint(self) -> Chart:
        """Residual of each joint against its angle, by the direction from which it came."""
        if self._evidence.approach is None:
            raise OptionError(self._evidence.approach_note)
        return report_figures.residuals_by_joint(self._evidence).marked(self._record.simulated)

    def singular_values(self) -> Chart:
        """What the poses can show of the error parameters."""
        return report_figures.singular_values(self._record.observability).marked(self._record.simulated)

    def explained(self) -> Chart:
        """What each family of terms explains, of model auto."""
        known = self._record.evidence
        if known is None or not known.explained:
            raise OptionError("only model auto, saved by this version, knows what each family of terms explains")
        return model_figures.explained(self._record).marked(self._record.simulated)

    def gear_spectrum(self) -> Chart:
        """What the gear scan of model auto saw, and found."""
        known = self._record.evidence
        if known is None or known.spectrum is None:
            raise OptionError("no gear scan was made: only model auto makes one, where no long series of harmonics do")
        return model_figures.gear_spectrum(known.spectrum, known.gears).marked(self._record.simulated)

    def corrections(self) -> Chart:
        """What the joint map adds to each joint, over its range and from both sides."""
        figure = model_figures.corrections(self._record, self._evidence)
        if figure is None:
            raise OptionError("there is no joint map, or this calibration was saved without the measured places")
        return figure.marked(self._record.simulated)
