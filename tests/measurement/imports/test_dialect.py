"""Text files: any dialect back to the numbers, and files that are none."""

import numpy as np
import yaml
from hypothesis import given, settings
from hypothesis import strategies as st
from import_support import FOUR_JOINTS, JOINTS, ROW, XYZ, make_map, refused, understood, write

from irbcal.measurement import text_files

LENGTHS = {"mm": 1.0, "m": 1e3, "inch": 25.4}


@settings(max_examples=20)
@given(data=st.data())
def test_numbers_come_back_from_any_dialect(data, tmp_path_factory):
    delimiter = data.draw(st.sampled_from([",", ";", "\t", "|", "space"]))
    decimal = data.draw(st.sampled_from([".", ","] if delimiter != "," else ["."]))
    encoding = data.draw(st.sampled_from(["utf-8", "latin-1", "utf-16"]))
    newline = data.draw(st.sampled_from(["\n", "\r\n", "\r"]))
    skip = data.draw(st.integers(0, 3))
    header = data.draw(st.booleans())
    angle = data.draw(st.sampled_from(["deg", "rad"]))
    length = data.draw(st.sampled_from(sorted(LENGTHS)))
    n = data.draw(st.integers(1, 6))
    reals = st.floats(-170, 170).map(lambda v: round(v, 6))
    q = np.array(data.draw(st.lists(st.lists(reals, min_size=6, max_size=6), min_size=n, max_size=n)))
    q[0, 0] = 100.0  # else small angles look like radians
    xyz = np.array(data.draw(st.lists(st.lists(reals, min_size=3, max_size=3), min_size=n, max_size=n))) * 7
    xyz[0, 0] = 3000.0
    lost = np.array(data.draw(st.lists(st.booleans(), min_size=n, max_size=n)))
    lost[0] = False
    names = [*(f"Ä{k}" for k in range(1, 7)), "X", "Y", "Z", "Punkt"]
    places = data.draw(st.permutations(range(len(names))))

    def text(value):
        return repr(float(value)).replace(".", decimal)

    columns = [[text(v) for v in (q[:, k] if angle == "deg" else np.radians(q[:, k]))] for k in range(6)]
    for k in range(3):
        columns.append(["LOST" if gone else text(v / LENGTHS[length]) for v, gone in zip(xyz[:, k], lost, strict=True)])
    columns.append([f"smr{k % 2 + 1}" for k in range(n)])
    rows = [list(cells) for cells in zip(*columns, strict=True)]
    mark = " " if delimiter == "space" else delimiter
    lines = ["x" * k for k in range(skip)] + (["// a comment"] if data.draw(st.booleans()) else [])
    for cells in ([names] if header else []) + rows:
        lines.append(mark.join(cells[k] for k in places))
    where = {name: (name if header else places.index(k) + 1) for k, name in enumerate(names)}
    chosen = {
        "file": {"delimiter": data.draw(st.sampled_from([delimiter, "auto"])), "encoding": encoding, "header": header}
        | {"decimal": decimal, "skip_rows": skip, "comment": "//"},
        "columns": {
            "joints": [where[name] for name in names[:6]],
            "position": [where[name] for name in "XYZ"],
            "target": where["Punkt"],
        },
        "units": {"joints": angle, "lengths": length},
        "lost": {"markers": ["lost"]},
    }
    folder = tmp_path_factory.mktemp("dialect")
    (folder / "f.txt").write_bytes(newline.join(lines).encode(encoding))
    seen = understood(folder / "f.txt", make_map(folder, yaml.safe_dump(chosen, allow_unicode=True))).table
    assert np.abs(seen[JOINTS].to_numpy() - q).max() < 1e-8
    assert np.array_equal(seen["x_mm"].isna(), lost | (xyz == 0).all(axis=1))
    have = seen["x_mm"].notna().to_numpy()
    assert np.abs(seen[XYZ].to_numpy() - xyz)[have].max() < 1e-8
    assert seen["target"].tolist() == columns[9]


def test_decimal_marks_are_not_guessed_where_they_could_be_thousands(tmp_path):
    joints = write(tmp_path / "joints.csv", FOUR_JOINTS.rstrip())
    for cells in (["1,975", "2,508", "1,111"], ["1.975,5", "25,5", "1,5"]):
        path = write(tmp_path / "smr1.csv", "x;y;z", ";".join(cells), ";".join(cells))
        assert "declare file.decimal" in refused(path, "per-target", "units.lengths=mm", joints=joints)
    path = write(tmp_path / "smr1.csv", "x;y;z", "1.975,5;2;3", "1;2;3")
    text = refused(path, "per-target", "units.lengths=mm", "file.decimal=,", joints=joints)
    assert "row 2, column x: expected a position in mm or a mark of a lost point, found '1.975,5'" in text
    path = write(tmp_path / "smr1.csv", "x;y;z", "1975,5;2;3", "1;2.125;3")
    text = refused(path, "per-target", "units.lengths=mm", "file.decimal=,", joints=joints)
    assert "row 3, column y: expected" in text
    assert "found '2.125'; the map says file.decimal: ','" in text
    path = write(tmp_path / "smr1.csv", "x;y;z", "1975,5;2;3", "1;2;3")
    assert "the map says file.decimal: '.'" in refused(
        path, "per-target", "units.lengths=mm", "file.decimal=.", joints=joints
    )


def test_files_that_are_no_text_tables(tmp_path, monkeypatch):
    path = tmp_path / "x.csv"
    path.write_bytes(b"h\n1,2\x00,3\n")
    assert "row 2: expected a text file, found binary data" in refused(path, "robodk")
    path.write_bytes("h\n\nGröße,1".encode("latin-1"))
    text = refused(path, "robodk")
    assert "row 3: expected text in utf-8 (file.encoding), found other bytes" in text
    assert "latin-1" in text
    path.write_bytes(b" \n\n")
    assert "the file is empty" in refused(path, "robodk")
    assert "expected a file, found a folder" in refused(tmp_path, "robodk")
    assert "there is no such file" in refused(tmp_path / "none.csv", "robodk")
    path.write_bytes(b"h\n" + b"1," * 5000)
    assert "expected at most 2000 columns, found 5001" in refused(path, "robodk")
    monkeypatch.setattr(text_files, "LARGEST_FILE", 10)
    path.write_bytes(b"h\n" + ROW.encode())
    assert "a file of at most" in refused(path, "robodk")
