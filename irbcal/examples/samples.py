"""Write the examples; what ``irbcal samples`` does."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

from irbcal import atomic
from irbcal.errors import CalibrationError
from irbcal.summary import Paragraph, Result, Table


@dataclass(frozen=True, eq=False, repr=False)
class Samples(Result):
    """Example files that were written: SIMULATED.

    Attributes
    ----------
    folder : Path
    about : dict of str to str
        Files in the folder, and what they are.
    tried : dict of str to str
        Files, and the command that reads them.
    """

    folder: Path
    about: dict[str, str]
    tried: dict[str, str]

    def report(self) -> list[Paragraph]:
        """See `Result.report`."""
        rows = tuple((name, about) for name, about in self.about.items())
        return [
            f"{len(self.about)} SIMULATED example files in {self.folder}; README.txt there has a command for each",
            Table("Examples", ("file", "what it is"), rows),
        ]

    def to_dict(self) -> dict[str, Any]:
        """The files with their commands, ready for JSON."""
        files = [{"file": name, "about": about, "command": self.tried[name]} for name, about in self.about.items()]
        return {"folder": str(self.folder), "simulated": True, "files": files}


def samples(folder: str | Path = "irbcal-samples") -> Samples:
    """Write a small example input for every command and every import preset, all SIMULATED.

    Parameters
    ----------
    folder : str or Path
        New or empty.

    Raises
    ------
    CalibrationError
        If there is something in the folder, or it cannot be written.

    Examples
    --------
    >>> irbcal.samples("try-irbcal")  # doctest: +SKIP
    """
    from irbcal.examples import makers
    from irbcal.examples import measurements as of

    folder = Path(folder)
    if folder.is_file() or (folder.is_dir() and any(folder.iterdir())):
        raise CalibrationError("expected a new or empty folder for the samples", file=folder)
    sources = (of.tracker_files, of.foreign_files, of.check_files, of.rail_files, of.touched_files, makers.files)
    written = [sample for make in (*sources, of.fleet_files) for sample in make()]
    contents = {folder / sample.path: sample.content for sample in written}
    contents[folder / "README.txt"] = _readme({sample.tried: sample.about for sample in written if sample.tried})
    atomic.write_set(contents)
    return Samples(folder, {s.path: s.about for s in written}, {s.path: s.tried for s in written})


def _readme(lines: dict[str, str]) -> bytes:
    head = "Examples for irbcal. All data are SIMULATED: no robot was measured.\n"
    head += "The lines work in this folder, in this order.\n\n"
    return (head + "".join(f"# {about}\n{command}\n\n" for command, about in lines.items())).encode()
