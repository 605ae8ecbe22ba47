"""True tools and work objects of a cell: from touches, or taught points of programs, to the files of the cell."""

from __future__ import annotations

from pathlib import Path

from irbcal.arrays import FloatArray
from irbcal.cell.cell_file import AS_URDF, TOOL, CellFile, Notation, frames_by_name
from irbcal.cell.cell_urdf import with_cell
from irbcal.cell.frames_from_touches import frames_from_touches
from irbcal.correction import declarations, languages
from irbcal.correction.cell_options import CellOptions
from irbcal.correction.opened_programs import OpenedCalibration, opened_calibration
from irbcal.correction.program_touches import with_joints
from irbcal.declared_options import takes_fields_of
from irbcal.errors import OptionError
from irbcal.modeling import frames
from irbcal.modeling.robot import carrying_payload
from irbcal.overwriting import refuse_overwriting
from irbcal.safe_files import write_set
from irbcal.units import MM


@takes_fields_of(CellOptions)
def cell_frames(options: CellOptions) -> CellFile:
    """Compute tools and work objects with the calibrated robot from touches, and how far off the controller's are.

    Raises
    ------
    MeasurementError
        If the table cannot be read, does not determine a tool, a work object or a zero, or names a point that the
        programs do not have or that tells no joints.
    ProgramError
        If a program cannot be read, holds fake targets, or needs a frame that is not known.
    CalibrationError
        If the calibration is not whole, or a file cannot be written.
    OptionError
        If the controller's frames are no transforms, or of names that no row has.
    RobotError
        If nothing is known of the robot's certainty, or of the payload.

    Examples
    --------
    >>> cell_frames("my-robot", "touches.csv", program="job.mod", out="cell.json")  # doctest: +SKIP
    """
    outputs = {name: getattr(options, name) for name in ("out", "declare", "urdf", "report")}
    read = (options.touches, options.axes, options.other_cell, options.programs, options.calibration)
    refuse_overwriting(outputs, *read)
    opened = opened_calibration(options.calibration)
    touches = options.touches
    if options.programs:
        touches, tools, work_objects = with_joints(options)
    else:
        ends = opened.ends
        tools = {name: ends.T_tip_flange @ T for name, T in frames_by_name(options.tool, "tool").items()}
        work_objects = {name: ends.T_base_world @ T for name, T in frames_by_name(options.wobj, "wobj").items()}
    cell = frames_from_touches(
        opened.record,
        touches,
        robot=carrying_payload(opened.record.robot_calibrated(), options.payload, options.payload_centre),
        tools=tools,
        work_objects=work_objects,
        axes=options.axes,
        other=options.other,
        other_cell=options.other_cell,
        refit_zeros=options.refit_zeros,
    )
    contents: dict[Path, bytes] = {}
    if options.declare is not None and options.as_ is not None:
        contents[Path(options.declare)] = _declared(options.as_, opened, cell).encode()
    if options.urdf is not None:
        if opened.urdf is None:
            raise OptionError("urdf: expected a calibration with its URDF, such as its folder", parameter="urdf")
        contents[Path(options.urdf)] = with_cell(opened.urdf, opened.record.arm(), cell)
    if options.report is not None:
        contents[Path(options.report)] = cell.page(notation=notation(opened, options.as_)).encode()
    if options.out is not None:
        contents[Path(options.out)] = cell.content(options.out)
    write_set(contents)
    return cell


def _declared(maker: str, opened: OpenedCalibration, cell: CellFile) -> str:
    """True tools and work objects as a maker declares them."""
    to_flange, to_world = (frames.inverse(T) for T in (opened.ends.T_tip_flange, opened.ends.T_base_world))
    tools, work_objects = cell.tools.items(), cell.work_objects.items()
    return declarations.declared(
        maker,
        {name: to_flange @ tool.T_true for name, tool in tools},
        {name: to_world @ work_object.T_true for name, work_object in work_objects},
        {name for name, frame in (*tools, *work_objects) if frame.fixed_tool},
    )


def notation(opened: OpenedCalibration, maker: str | None) -> Notation:
    """How a maker's controllers write frames, and what they count from; in the URDF's links without a maker."""
    if maker is None:
        return AS_URDF
    form, ends = languages.of_maker(maker).maker, opened.ends
    assert form is not None, maker

    def numbers(frame: str, T: FloatArray) -> list[float]:
        T_link_end = ends.T_tip_flange if frame == TOOL else ends.T_base_world
        return declarations.numbers(form, frames.inverse(T_link_end) @ T)

    flange = "the flange" if ends.flange_known else "the URDF's tip link"
    base = "the controller's base" if ends.base_known else "the URDF's base link"
    unit, digits = ("mm", 6 if len(form.orientation.names) == 4 else 4) if form.length == MM else ("m", 6)
    names = ("x", "y", "z", *form.orientation.names)
    return Notation(names, numbers, f"as {maker} writes them, {unit}, in {flange} and {base}", digits)
