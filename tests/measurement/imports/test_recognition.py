"""Files that are understood without a map: against generated exports with their truth, and what must be refused."""

import hashlib
import sys
from importlib.machinery import SourceFileLoader
from importlib.util import module_from_spec, spec_from_loader
from pathlib import Path

import numpy as np
import pytest
import yaml
from import_support import JOINTS, XYZ, write

import irbcal
from irbcal.errors import MeasurementError
from irbcal.io.measurement_files import measurements_of
from irbcal.io.urdf import read_urdf
from irbcal.measurement import text_files
from irbcal.measurement.imports import reader, sheets, tables
from irbcal.measurement.imports.column_map import Dialect, pattern_regex
from irbcal.measurement.imports.recognition import recognise
from irbcal.measurement.imports.trial_fit import trial_fit
from irbcal.measurement.input_table import InputTable

SCRIPT = Path(__file__).parents[3] / "scripts" / "messy_exports"


def _module():
    loader = SourceFileLoader("messy_exports", str(SCRIPT))
    module = module_from_spec(spec_from_loader("messy_exports", loader))
    sys.modules["messy_exports"] = module
    loader.exec_module(module)
    return module


MESSY = _module()
ARM = read_urdf("irb120").arm


def measured(n=20, seed=1, targets=("K1", "K2")):
    """Joints (degrees) and points (mm) of a robot that is a little wrong, with base and tool unknown to the reader."""
    rng = np.random.default_rng(seed)
    q = np.degrees(ARM.random_joints(n, seed)).round(4)
    T = ARM.forward(np.radians(q + 0.05))
    tool = rng.uniform(-0.1, 0.1, (len(targets), 3)) + np.array([0, 0, 0.1])
    points = np.einsum("nij,kj->nki", T[:, :3, :3], tool) + T[:, None, :3, 3]
    turn = np.array([[0.36, 0.48, -0.8], [-0.8, 0.6, 0.0], [0.48, 0.64, 0.6]])
    return q, (1e3 * (points @ turn.T) + [2000.0, 100.0, -300.0]).round(4)


def long_rows(q, points, names=("K1", "K2"), mark=";"):
    return [
        mark.join([f"P{i + 1}", *map(str, q[i]), name, *map(str, points[i, k])])
        for i in range(len(q))
        for k, name in enumerate(names)
    ]


HEADER = "Pose;A1;A2;A3;A4;A5;A6;Ziel;X;Y;Z"


COVER = (*range(12), 13, 14, 15, 16, 30, 40, 161, 164)
"""Of the first 200 exports some that have all layouts, defects, robots, languages, names, units and encodings."""


@pytest.mark.parametrize("number", COVER)
def test_a_messy_export_is_understood_as_its_truth_says(number, tmp_path):
    case = MESSY.Case(number)
    assert MESSY.outcome(case, tmp_path) == ("right", "")


def test_the_judge_of_the_exports_sees_wrong_tables(tmp_path):
    case = MESSY.Case(1)
    table = MESSY.understood(
        [tmp_path / name for name in case.files if (tmp_path / name).write_bytes(case.files[name])], case.robot
    )
    assert case.judge(table) == ""
    first, second = table["target"].unique()[:2]
    assert case.judge(table.assign(x_mm=table["y_mm"], y_mm=table["x_mm"])).startswith("point of row")
    assert case.judge(table.assign(q1_deg=table["q1_deg"] + 1.0)) == "joints"
    assert case.judge(table.assign(target=table["target"].replace(first, second))) == "targets"
    assert "of" in case.judge(table.iloc[:-1])


def test_the_trial_fit_finds_units_and_refuses_mirrors():
    q, points = measured()
    pose, target = np.repeat(np.arange(20), 2), np.tile([0, 1], 20)
    xyz = points.reshape(-1, 3)
    for factor in (1e-3, 1.0, 1 / 25.4):
        fit = trial_fit(ARM, np.radians(q), pose, target, factor * xyz)
        assert fit.agrees
        assert fit.scale == pytest.approx(1e-3 / factor, rel=0.02)
        assert fit.residual < 2e-3
    assert not trial_fit(ARM, q, pose, target, xyz).agrees  # degrees taken as radians
    assert not trial_fit(ARM, np.radians(q), pose, target, xyz * [1, 1, -1]).agrees
    assert not trial_fit(ARM, np.radians(q[:, ::-1]), pose, target, xyz).agrees
    assert trial_fit(ARM, np.radians(q[:2]), pose[:4], target[:4], xyz[:4]) is None
    gross = xyz.copy()
    gross[5] += 400.0
    assert trial_fit(ARM, np.radians(q), pose, target, gross).residual < 2e-3


def refusal(*paths, robot="irb120", **options):
    with pytest.raises(MeasurementError) as caught:
        irbcal.import_measurements(*paths, robot=robot, **options)
    text = str(caught.value)
    assert "\n" not in text
    return text


def test_what_contradicts_the_robot_is_refused(tmp_path):
    q, points = measured()
    path = write(tmp_path / "a.csv", HEADER, *long_rows(q, points))
    assert "none that agree with it" in refusal(path, robot="ur10")
    swapped = write(tmp_path / "b.csv", HEADER, *long_rows(q[:, [1, 0, 2, 3, 4, 5]], points))
    assert "none that agree with it" in refusal(swapped)
    lying = write(tmp_path / "c.csv", HEADER.replace("X;Y;Z", "X [m];Y [m];Z [m]"), *long_rows(q, points))
    assert "units.lengths=mm" in refusal(lying)
    stretched = write(tmp_path / "d.csv", HEADER, *long_rows(q, 3.0 * points))
    assert "by the trial fit" in refusal(stretched)
    T = ARM.forward(np.radians(q))
    computed = 1e3 * T[:, None, :3, 3]
    log = write(tmp_path / "e.csv", HEADER, *long_rows(q, np.repeat(computed, 2, axis=1).round(6)))
    assert "a controller computed them" in refusal(log)


def test_a_short_table_in_a_long_log_is_seen(tmp_path, monkeypatch):
    """None of its lines is among those that are looked at first: 100, and each 65th."""
    monkeypatch.setattr(sheets, "SAMPLE", 100)
    q, points = measured()
    log = ["axis warm, waiting"] * 6_000
    path = write(tmp_path / "log.txt", "\n".join([*log[:525], HEADER, *long_rows(q, points), *log]))
    imported = irbcal.import_measurements(path, robot="irb120")
    np.testing.assert_allclose(imported.table[JOINTS].to_numpy()[::2], q, rtol=0, atol=1e-9)


def test_a_row_with_values_too_many_is_refused_and_not_left_out(tmp_path):
    rows = long_rows(*measured())
    rows[7] += ";9"
    path = write(tmp_path / "a.csv", HEADER, *rows)
    assert "row 9" in refusal(path)
    rows[7] = "Mittelwert;1;2;3;4;5;6;;7;8;9;10"
    imported = irbcal.import_measurements(write(tmp_path / "b.csv", HEADER, *rows), robot="irb120")
    assert len(imported.table) == 39
    assert any("Mittelwert" in note for note in imported.notes)


def test_without_a_robot_units_are_declared_or_asked_for(tmp_path):
    q, points = measured()
    path = write(tmp_path / "a.csv", HEADER, *long_rows(q, points))
    text = refusal(path, robot=None)
    assert "--robot" in text
    assert "units.lengths=mm" in text
    declared = irbcal.import_measurements(path, set_=["units.lengths=mm", "units.joints=deg"])
    preamble = write(tmp_path / "b.csv", "Einheiten: mm, Grad", HEADER, *long_rows(q, points))
    for imported in (declared, irbcal.import_measurements(preamble)):
        assert np.abs(imported.table[XYZ].to_numpy() - points.reshape(-1, 3)).max() < 1e-9
        assert np.abs(imported.table[JOINTS].to_numpy() - np.repeat(q, 2, axis=0)).max() < 1e-9
    small = write(tmp_path / "c.csv", HEADER.replace("X;Y;Z", "X_mm;Y_mm;Z_mm"), *long_rows(q / 60, points))
    assert "units.joints=deg" in refusal(small, robot=None)


def test_names_keep_their_case_and_still_targets_are_references(tmp_path):
    q, points = measured(targets=("K1", "Ref1", "Boden"))
    points[:, 2] = [3000.0, 20.0, 10.0]
    points[:, 2] += np.random.default_rng(2).normal(0, 0.01, (20, 3))
    path = write(tmp_path / "a.csv", HEADER, *long_rows(q, points, ("K1", "Ref1", "Boden")))
    imported = irbcal.import_measurements(path, robot="irb120", out=tmp_path / "m.csv")
    assert set(imported.table["target"]) == {"K1", "smr_Ref1", "ref_Boden"}
    assert irbcal.read_measurements(tmp_path / "m.csv").table["target"].nunique() == 3
    again = irbcal.import_measurements(path, as_=tmp_path / "m.map.yaml")
    assert again.table.equals(imported.table)
    assert "trust_units" not in yaml.safe_load((tmp_path / "m.map.yaml").read_text(encoding="utf-8"))


def test_calibrate_reads_files_of_other_programs(tmp_path):
    q, points = measured(n=40, targets=("K1", "K2", "K3"))
    names = [f"A::R::P{i:03d}_K{k + 1}, " + ", ".join(map(str, points[i, k])) for i in range(40) for k in range(3)]
    cloud = write(tmp_path / "points.txt", "// points", *names)
    joints = write(
        tmp_path / "joints.csv", "Nr;A1;A2;A3;A4;A5;A6", *(f"XP{i};" + ";".join(map(str, q[i])) for i in range(40))
    )
    calibration = irbcal.calibrate([cloud, joints], "irb120", model="placement")
    assert any("points.txt + joints.csv was understood without a map" in note for note in calibration.record.notes)
    assert any("XP" in str(note) or "trial fit" in note for note in calibration.record.notes)
    plain = irbcal.import_measurements(cloud, joints, robot="irb120", out=tmp_path / "m.csv")
    same = irbcal.calibrate(tmp_path / "m.csv", "irb120", model="placement")
    assert plain.poses == 40
    assert np.allclose(
        [value.value for value in same.record.parameters],
        [value.value for value in calibration.record.parameters],
        rtol=0,
    )


def test_columns_with_names_of_irbcal_are_taken_and_unused_ones_named(tmp_path):
    q, points = measured(n=40)
    own = "payload_kg;payload_x_mm;payload_y_mm;payload_z_mm;time_s;group;session;u95_mm"
    pose = np.repeat(np.arange(40), 2)
    rows = [
        f"{row};{1 + pose[k] % 2};10;20;30;{1.5 * k};{'ab'[pose[k] % 2]};{1 + k // 40};0.02;good"
        for k, row in enumerate(long_rows(q, points / 1e3))
    ]
    path = write(tmp_path / "a.csv", f"{HEADER};{own};Bemerkung", *rows)
    imported = irbcal.import_measurements(path, robot="irb120", out=tmp_path / "m.csv")
    table = imported.table
    assert set(table["target"]) == {"K1", "K2"}
    numbers = {"payload_kg": 1.0 + pose % 2, "payload_z_mm": 30.0, "time_s": 1.5 * np.arange(80), "u95_mm": 0.02}
    for name, values in numbers.items():
        np.testing.assert_allclose(table[name].to_numpy(dtype=float), np.broadcast_to(values, 80), rtol=0, atol=1e-9)
    assert table["group"].tolist() == ["ab"[k % 2] for k in pose]
    assert table["session"].tolist() == ["1"] * 40 + ["2"] * 40
    assert irbcal.import_measurements(path, as_=tmp_path / "m.map.yaml").table.equals(table)
    (note, *_) = measurements_of(path, ARM).notes
    assert "as named: payload_kg, payload_x_mm" in note
    assert "not used: Bemerkung)" in note
    wide = [";".join(map(str, [*q[i], *points[i].ravel(), 2, 10, 20, 30])) for i in range(40)]
    header = "A1;A2;A3;A4;A5;A6;X K1;Y K1;Z K1;X K2;Y K2;Z K2;" + own[: own.index(";time_s")]
    in_one_row = irbcal.import_measurements(write(tmp_path / "w.csv", header, *wide), robot="irb120").table
    assert set(in_one_row["target"]) == {"K1", "K2"}
    bad = path.read_text().replace(";1;10;20;30;", ";-1;10;20;30;", 1)
    assert "b.csv: row 2, column payload_kg: expected a mass from 0" in refusal(write(tmp_path / "b.csv", bad.rstrip()))


def test_sessions_of_a_file_have_a_base_and_references_each(tmp_path):
    q, points = measured(n=40, targets=("K1", "K2", "R"))
    points[:, 2] = [3000.0, 20.0, 10.0]
    points[20:] = points[20:] @ np.array([[0.0, -1, 0], [1, 0, 0], [0, 0, 1]]).T + [4000.0, -700.0, 60.0]
    rows = [f"{row};{'Mo' if k < 60 else 'Tu'}" for k, row in enumerate(long_rows(q, points, ("K1", "K2", "R")))]
    path = write(tmp_path / "a.csv", f"{HEADER};session", *rows)
    table = irbcal.import_measurements(path, robot="irb120").table
    assert set(table["target"]) == {"K1", "K2", "ref_R"}
    np.testing.assert_allclose(table[XYZ].to_numpy(), points.reshape(-1, 3), rtol=0, atol=1e-9)
    other = write(tmp_path / "b.csv", f"{HEADER};Tag", *rows)
    assert "found none that agree with it" in refusal(other)


@pytest.mark.parametrize("unit", ["deg", "rad"])
@pytest.mark.parametrize(("cell", "expected"), [("-1,1,0,0,0", "payload_kg: expected a mass"), ("2,1,0,0,1", "qw")])
def test_a_bad_cell_of_a_measurement_file_is_refused_in_either_unit_of_joints(tmp_path, unit, cell, expected):
    q, points = measured()
    joints = q if unit == "deg" else np.radians(q)
    rows = [f"{row},{cell if k == 7 else '2,1,0,0,0'}" for k, row in enumerate(long_rows(joints, points, mark=","))]
    header = ["pose", *(f"q{k}_{unit}" for k in range(1, 7)), "target", *XYZ, "payload_kg", "qw", "qx", "qy", "qz"]
    path = write(tmp_path / "own.csv", ",".join(header), *rows)
    with pytest.raises(MeasurementError, match=rf"own\.csv: row 9, columns? {expected}"):
        measurements_of(path, ARM)


def test_spherical_coordinates_are_refused_by_name(tmp_path):
    """Surveyors count azimuths clockwise, trackers mostly the other way: a mirror image fits no robot."""
    rows = [";".join(f"{value:.3f}" for value in [*row, 2500, 10, 80]) for row in measured()[0]]
    header = "A1;A2;A3;A4;A5;A6;Range;Azimuth;Zenith"
    assert "Azimuth and Zenith are of spherical coordinates" in refusal(write(tmp_path / "a.csv", header, *rows))
    own = ",".join(["pose", *(f"q{k}_deg" for k in range(1, 7)), "target", "range_mm", "azimuth_deg"])
    with pytest.raises(MeasurementError, match="azimuth_deg are of spherical coordinates"):
        measurements_of(write(tmp_path / "b.csv", own, "1,2,3,4,5,6,7,smr1,2500,10"), ARM)


def test_several_measurement_files_of_irbcal_are_not_one_table(tmp_path):
    """Tracker and tool may have moved between them."""
    rows = long_rows(*measured(), mark=",")
    header = ",".join(["pose", *(f"q{k}_deg" for k in range(1, 7)), "target", *XYZ])
    paths = [write(tmp_path / name, header, *rows) for name in ("a.csv", "b.csv")]
    assert "each of these files is a whole measurement file of irbcal" in refusal(*paths)
    with pytest.raises(MeasurementError, match="a column session"):
        measurements_of(paths, ARM)


def test_points_and_joints_that_do_not_belong_together_are_refused(tmp_path):
    q, points = measured()
    cloud = write(
        tmp_path / "p.csv", "Name;X;Y;Z", *(f"P{i}_K1;" + ";".join(map(str, points[i, 0])) for i in range(20))
    )
    text = refusal(cloud)
    assert "points only" in text
    with pytest.raises(MeasurementError, match="--joints is an option of irbcal import"):
        measurements_of(cloud, ARM)
    other = write(
        tmp_path / "j.csv", "Nr;A1;A2;A3;A4;A5;A6", *(f"{i};" + ";".join(map(str, q[19 - i])) for i in range(20))
    )
    assert "none that agree with it" in refusal(cloud, other)


@pytest.mark.parametrize(
    ("encoding", "text"),
    [("cp1252", "Prüfer"), ("gbk", "测点 实测"), ("shift_jis", "測定点 実測"), ("utf-16", "Prüfer"), ("utf-8", "测点")],
)
def test_encodings(encoding, text, tmp_path):
    from irbcal.measurement.imports.header_words import KNOWN_WORDS

    data = f"{text};X;Y\n1;2;3\n".encode(encoding)
    codec = text_files.encoding_of(data, KNOWN_WORDS)
    assert data.decode(codec).startswith(text)


def test_sheets_members_and_fixed_columns(tmp_path):
    book = tmp_path / "b.xlsx"
    book.write_bytes(MESSY.xlsx({"One": [["a", "b"], ["1.25", "2"]], "Two": [["c"], ["3"]]}))
    assert text_files.parts_of(book) == [f"{book}!One", f"{book}!Two"]
    table = tables.read(book, Dialect(sheet="One", delimiter="tab"))
    assert table.names == ("a", "b")
    assert table.cells.to_numpy().tolist() == [["1.25", "2"]]
    for read in (lambda: tables.read(book, Dialect()), lambda: InputTable.read(book)):
        with pytest.raises(MeasurementError, match=r"expected one sheet: One, Two; name it as FILE!SHEET"):
            read()
    sheet = InputTable.read(f"{book}!One", ["a", "b"])
    assert sheet.numbers("a").tolist() == [1.25]
    assert sheet.sha256 == hashlib.sha256(book.read_bytes()).hexdigest()
    with pytest.raises(MeasurementError, match="expected a sheet of One, Two, found 'Three'"):
        tables.read(book, Dialect(sheet="Three"))
    with pytest.raises(MeasurementError, match="not a workbook"):
        text_files.parts_of(write(tmp_path / "c.xlsx", "no workbook"))
    with pytest.raises(MeasurementError, match="not a zip archive"):
        text_files.parts_of(write(tmp_path / "c.zip", "no archive"))
    fixed = write(tmp_path / "f.txt", "name    value", "P 1       1.5", "P 2          ", "P 3      -2.5")
    table = tables.read(fixed, Dialect(delimiter="fixed", starts=[0, 7]))
    assert table.cells.to_numpy().tolist() == [["P 1", "1.5"], ["P 2", ""], ["P 3", "-2.5"]]


def test_an_archive_larger_than_files_may_be_is_refused(tmp_path, monkeypatch):
    import zipfile

    with zipfile.ZipFile(tmp_path / "z.zip", "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("zeros.csv", b"0" * 100_000)
    monkeypatch.setattr(text_files, "LARGEST_FILE", 50_000)
    with pytest.raises(MeasurementError, match="together 50000 bytes in the archive, found 1 of 100000"):
        text_files.parts_of(tmp_path / "z.zip")
    monkeypatch.undo()
    monkeypatch.setattr(text_files, "MOST_MEMBERS", 0)
    with pytest.raises(MeasurementError, match="expected at most 0 files, found 1"):
        text_files.parts_of(tmp_path / "z.zip")


def test_fields_that_begin_with_letters():
    import re

    assert re.fullmatch(pattern_regex("{pose=P}{target=K}"), "P12K3").groupdict() == {"pose": "P12", "target": "K3"}
    assert re.fullmatch(pattern_regex("{pose=P}_{target=K}"), "REF1_P12") is None
    with pytest.raises(ValueError, match="something between"):
        pattern_regex("{pose=P}{target}")


def test_several_patterns_of_names_in_one_file(tmp_path):
    q, points = measured(targets=("K1", "K2"))
    names = [(f"P{i}_K1", f"K2@P{i}") for i in range(20)]
    cloud = write(
        tmp_path / "p.csv",
        "Name;X;Y;Z",
        *(f"{names[i][k]};" + ";".join(map(str, points[i, k])) for i in range(20) for k in range(2)),
    )
    joints = write(
        tmp_path / "j.csv", "Nr;A1;A2;A3;A4;A5;A6", *(f"P{i};" + ";".join(map(str, q[i])) for i in range(20))
    )
    recognised = recognise([cloud, joints], ARM)
    assert recognised.map.names == ["{pose=P}_{target=K}", "{target=K}@{pose=P}"]
    imported = irbcal.import_measurements(cloud, joints, robot="irb120")
    assert set(imported.table["target"]) == {"K1", "K2"}


@pytest.mark.parametrize(
    ("cell", "mark", "decimal", "expected"),
    [
        ("1'234.5", "'", ".", "1234.5"),
        ("-12\u2019345\u2019678", "'", ".", "-12345678"),
        ("1.234,5 mm", ".", ",", "1234,5 mm"),
        ("X=1,234.5", ",", ".", "X=1234.5"),
        ("1,23.5", ",", ".", "1,23.5"),  # no thousand
        ("1234,567", ",", ".", "1234,567"),
        ("P1,234", ",", ".", "P1,234"),
        ("1,234", ",", ",", "1,234"),  # the decimal mark
    ],
)
def test_marks_of_thousands(cell, mark, decimal, expected):
    assert tables.without_thousands(cell, mark, decimal) == expected


def test_a_comma_with_three_digits_proves_no_thousands(tmp_path):
    """``1,234`` alone is a length with a decimal comma: the robot's size tells."""
    q, points = measured(targets=("K1",))
    rows = [
        f"P{i + 1};" + ";".join(f"{v:.3f}".replace(".", ",") for v in [*q[i], *points[i, 0] / 1e3]) for i in range(20)
    ]
    table = irbcal.import_measurements(
        write(tmp_path / "a.csv", "Pose;A1;A2;A3;A4;A5;A6;X;Y;Z", *rows), robot="irb120"
    ).table
    assert np.allclose(table[XYZ], points[:, 0], rtol=0, atol=0.6)
    assert np.allclose(table[JOINTS], q, rtol=0, atol=6e-4)


def test_columns_of_one_name_are_targets_after_one_another(tmp_path):
    q, points = measured()
    rows = [";".join([f"P{i + 1}", *map(str, q[i]), *map(str, points[i].ravel())]) for i in range(20)]
    path = write(tmp_path / "a.csv", "Pose;A1;A2;A3;A4;A5;A6;X;Y;Z;X;Y;Z", *rows)
    table = irbcal.import_measurements(path, robot="irb120").table
    assert table.groupby("target", sort=False).size().to_dict() == {"smr1": 20, "smr2": 20}
    assert np.allclose(table[XYZ].to_numpy().reshape(20, 2, 3), points, rtol=0, atol=1e-3)


def test_three_rows_a_point_are_complete(tmp_path):
    q, points = measured(targets=("K1",))
    rows = [f"P{i + 1};{axis};0;{value};0" for i in range(20) for axis, value in zip("XYZ", points[i, 0], strict=True)]
    joints = write(
        tmp_path / "j.csv", "Pose;A1;A2;A3;A4;A5;A6", *(f"P{i + 1};" + ";".join(map(str, q[i])) for i in range(20))
    )
    path = write(tmp_path / "a.csv", "Name;Axis;Nominal;Actual;Dev", *rows)
    assert len(irbcal.import_measurements(path, joints, robot="irb120").table) == 20
    del rows[4]
    broken = write(tmp_path / "b.csv", "Name;Axis;Nominal;Actual;Dev", *rows)
    dialect = Dialect(delimiter=";", axis="Axis")
    with pytest.raises(
        MeasurementError, match=r"row 6 .*expected the axis Y, found 'Z'|expected the axis Y, found 'Z'"
    ):
        tables.read(broken, dialect)
    refusal(broken, joints)


def recognised_table(paths):
    known = recognise(paths, ARM)
    return reader.understand(known.sources, known.map, known.joints).table


def _book(path, q, points, as_text):
    """A sheet of numbers; ``as_text`` says which of them are text with a decimal comma."""
    rows = [line.split(";") for line in long_rows(q, points)]
    rows = [[as_text(r, c, cell) for c, cell in enumerate(row)] for r, row in enumerate(rows)]
    path.write_bytes(MESSY.xlsx({"Data": [HEADER.split(";"), *rows]}))
    return path


def test_numbers_stored_as_text_with_a_comma_are_numbers_of_a_workbook(tmp_path):
    q, points = measured(20)
    plain = _book(tmp_path / "plain.xlsx", q, points, lambda r, c, cell: cell)
    mixed = lambda r, c, cell: cell.replace(".", ",") if c != 6 and r % 3 == c % 3 else cell  # noqa: E731
    book = _book(tmp_path / "mixed.xlsx", q, points, mixed)
    tables_of = [recognised_table([path]) for path in (plain, book)]
    np.testing.assert_allclose(*(table[[*JOINTS, *XYZ]] for table in tables_of), rtol=0, atol=1e-9)


def test_text_that_may_be_thousands_is_refused_and_never_a_lost_point(tmp_path):
    q, points = measured(20)
    book = _book(tmp_path / "b.xlsx", q, points, lambda r, c, cell: "1,234" if (r, c) == (7, 9) else cell)
    with pytest.raises(MeasurementError, match=r"b\.xlsx!Data: row 9, column Y: expected a number .* found '1,234'"):
        recognise([book], ARM)


def test_a_number_written_unlike_the_others_is_refused_with_its_row(tmp_path):
    q, points = measured(20)
    rows = long_rows(q, points)
    cells = rows[4].split(";")
    cells[8] = cells[8].replace(".", ",")
    path = write(tmp_path / "m.csv", HEADER, *rows[:4], ";".join(cells), *rows[5:])
    with pytest.raises(MeasurementError, match=r"m\.csv: row 6, column X: expected a number with a decimal point"):
        recognise([path], ARM)
    cells = rows[4].split(";")
    cells[3] = "gone"
    path = write(tmp_path / "j.csv", HEADER, *rows[:4], ";".join(cells), *rows[5:])
    with pytest.raises(MeasurementError, match=r"j\.csv: row 6, column A3: expected a joint in each row.*'gone'"):
        recognise([path], ARM)


def test_what_is_said_of_columns_goes_before_their_names(tmp_path):
    q, points = measured(targets=("K1", "K2"))
    letters = "ABCDEFabcdef"
    rows = [";".join(map(str, [*q[i], *points[i].ravel()])) for i in range(len(q))]
    nameless = write(tmp_path / "a.csv", ";".join(letters), *rows)
    assert "expected columns of points" in refusal(nameless)
    said = ["columns.joints=[A, B, C, D, E, F]", "columns.position={left: [a, b, c], right: [d, e, f]}"]
    with pytest.raises(MeasurementError, match="expected columns of points"):
        irbcal.import_measurements(nameless, robot="irb120", set_=said[:1])
    # names that lie: two joints exchanged
    lying = write(tmp_path / "b.csv", "A1;A3;A2;A4;A5;A6;X1;Y1;Z1;X2;Y2;Z2", *rows)
    assert "none that agree with it" in refusal(lying)
    in_order = {"columns.joints": ["A1", "A3", "A2", "A4", "A5", "A6"]}
    mended = irbcal.import_measurements(lying, robot="irb120", set_=in_order)
    # points in a file, joints in another
    cloud = write(tmp_path / "c.csv", "u;v;w;s;t;r", *(";".join(map(str, points[i].ravel())) for i in range(len(q))))
    turns = write(tmp_path / "d.csv", "k;l;m;n;o;p", *(";".join(map(str, row)) for row in q))
    elsewhere = {"columns.joints": list("klmnop"), "columns.position": {"left": list("uvw"), "right": list("str")}}
    apart = irbcal.import_measurements(cloud, turns, robot="irb120", set_=elsewhere)
    for imported in (irbcal.import_measurements(nameless, robot="irb120", set_=said), mended, apart):
        assert np.abs(imported.table[XYZ].to_numpy() - points.reshape(-1, 3)).max() < 1e-9
        assert np.abs(imported.table[JOINTS].to_numpy() - np.repeat(q, 2, axis=0)).max() < 1e-9
    with pytest.raises(MeasurementError, match="there is no column 'Q'"):
        irbcal.import_measurements(nameless, robot="irb120", set_={"columns.joints": list("QBCDEF")})
    with pytest.raises(MeasurementError, match="joints: expected a valid list"):
        irbcal.import_measurements(nameless, robot="irb120", set_=["columns.joints=seven"])


def test_a_comment_with_commas_is_no_header(tmp_path):
    q, points = measured()
    names = [f"P{i}_K{k + 1}, " + ", ".join(map(str, points[i, k])) for i in range(len(q)) for k in range(2)]
    cloud = write(tmp_path / "points.txt", "// SIMULATED points, working frame: tracker, millimetres", *names)
    turns = write(
        tmp_path / "joints.csv", "pose,A1,A2,A3,A4,A5,A6", *(f"P{i}," + ",".join(map(str, q[i])) for i in range(20))
    )
    imported = irbcal.import_measurements(cloud, turns, robot="irb120")
    assert np.abs(imported.table[XYZ].to_numpy() - points.reshape(-1, 3)).max() < 1e-9


def test_points_without_names_are_refused_in_a_sentence(tmp_path):
    q = np.degrees(irbcal.read_urdf("irb1600").arm.random_joints(20, 1))
    rows = [[*of_pose, 900.0 + 10 * k, 20.0 * j, 500.0 + k * j, j + 1] for k, of_pose in enumerate(q) for j in range(3)]
    lines = [",".join(f"{value:.10g}" for value in row) for row in rows]
    path = write(tmp_path / "t.csv", "J1,J2,J3,J4,J5,J6,X,Y,Z,TCP", *lines)
    assert "no column says which target" in refusal(path, robot="irb1600")
