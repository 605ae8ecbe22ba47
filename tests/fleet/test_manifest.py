"""Lists of robots are read, or refused with row and column."""

import pytest

from irbcal.errors import MeasurementError
from irbcal.fleet import manifest

HEADER = "id,measurements,robot,date,options\n"


def read(folder, text):
    (folder / "m.csv").write_text(text)
    return manifest.read(folder / "m.csv")


def test_a_row_is_a_robot(tmp_path):
    (tmp_path / "own.urdf").write_text("<robot/>")
    text = "id,serial,measurements,robot,date,options\nA-1,SN 7,a.csv,own.urdf,2026-03-17,"
    text += '"model=34 free=gain3,gain2 power=6 as-poses=yes verify=v.csv"\n'
    (entry,) = read(tmp_path, text)
    assert (entry.id, entry.serial, entry.date) == ("A-1", "SN 7", "2026-03-17")
    assert entry.robot == str(tmp_path / "own.urdf")
    assert entry.measurements == str(tmp_path / "a.csv")
    assert entry.options == {
        "model": "34",
        "power": 6.0,
        "free": ["gain3", "gain2"],
        "as_poses": True,
        "verify": str(tmp_path / "v.csv"),
    }


def test_the_fingerprint_is_of_contents_not_of_places(tmp_path):
    for name in ("one", "two"):
        (tmp_path / name).mkdir()
        (tmp_path / name / "a.csv").write_text("same")
    one, two = (read(tmp_path / name, HEADER + "A,a.csv,irb1600,,model=34\n")[0] for name in ("one", "two"))
    assert one.sha256() == two.sha256()
    (tmp_path / "two" / "a.csv").write_text("other")
    assert one.sha256() != two.sha256()
    assert one.sha256() != read(tmp_path / "one", HEADER + "A,a.csv,irb1600,,model=26\n")[0].sha256()


@pytest.mark.parametrize(
    ("rows", "sentence"),
    [
        ("A,a.csv,irb1600,,\na,b.csv,irb1600,,\n", "row 3, column id: the id 'a' stands in row 2, too"),
        ("../x,a.csv,irb1600,,\n", "row 2, column id: expected letters, digits"),
        (".,a.csv,irb1600,,\n", "row 2, column id: expected letters, digits"),
        ("fleet.csv,a.csv,irb1600,,\n", "row 2, column id: expected letters, digits"),
        ("A,,irb1600,,\n", "row 2, column measurements: expected a text, found nothing"),
        ("A,a.csv,irb1600,17.3.2026,\n", "row 2, column date: expected a date such as 2026-03-17, found '17.3.2026'"),
        ("A,a.csv,irb1600,,colour=red\n", "row 2, column options: expected OPTION=VALUE with one of"),
        ("A,a.csv,irb1600,,seed=x\n", "row 2, column options: seed: expected a whole number, found 'x'"),
        ("A,a.csv,irb1600,,torques=x\n", "row 2, column options: torques: expected yes or no, found 'x'"),
        ("A,a.csv,irb1600,,model=35\n", "row 2, column options: model: expected"),
    ],
)
def test_what_is_no_robot_is_refused(tmp_path, rows, sentence):
    with pytest.raises(MeasurementError) as caught:
        read(tmp_path, HEADER + rows)
    assert str(caught.value).startswith(f"{tmp_path}/m.csv: {sentence}")


def test_strange_columns_are_refused(tmp_path):
    with pytest.raises(MeasurementError, match="column colour: expected the columns id, measurements, robot, serial"):
        read(tmp_path, "id,measurements,robot,colour\nA,a.csv,irb1600,red\n")
