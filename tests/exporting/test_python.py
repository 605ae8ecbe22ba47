"""The Python modules that are written: they run alone, and texts of a calibration are data in them."""

import subprocess
import sys
from dataclasses import replace

import pytest

from irbcal.exporting import batch, plain, python


def run(name, folder):
    return subprocess.run(
        [sys.executable, "-I", "-W", "error", "-X", "importtime", name], cwd=folder, capture_output=True, text=True
    )


def test_they_run_without_irbcal(sources, tmp_path):
    for name, content in python.files(sources["irb1600"]).files.items():
        (tmp_path / name).write_bytes(content)
        done = run(name, tmp_path)
        assert done.returncode == 0, done.stderr
        assert "irbcal" not in done.stderr
        assert ("numpy" in done.stderr) is ("plain" not in name)
        (tmp_path / name).write_bytes(content.replace(b"GAIN = [", b"GAIN = [1e-9 + ", 1))
        assert run(name, tmp_path).returncode == 1


@pytest.mark.parametrize("code", [batch, plain])
def test_texts_never_run(sources, tmp_path, code):
    source, canary = sources["level"], "open('canary', 'w')"
    for k, text in enumerate(
        (
            f'"""\n{canary}\n"""',
            f"'\n{canary}\n'",
            f"coding: utf-7 +AAo-{canary}+AAo-",
            f"\\\n{canary}\r{canary}\x0c{canary}",
        )
    ):
        numbers = replace(
            source.numbers,
            fingerprint=text,
            name=text,
            base_link=text,
            tip_link=text,
            notes=(text,),
            joint_names=(text, *source.numbers.joint_names[1:]),
        )
        (tmp_path / f"{k}.py").write_bytes(python.text(numbers, source.vectors, code))
        assert run(f"{k}.py", tmp_path).returncode == 0
    assert not (tmp_path / "canary").exists()
