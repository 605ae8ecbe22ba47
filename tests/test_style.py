import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).parents[1]


def python_scripts():
    """Scripts without an ending, which ruff would not find by itself."""
    files = [path for path in sorted((ROOT / "scripts").iterdir()) if path.is_file() and not path.suffix]
    return [path for path in files if "python" in path.read_text(encoding="utf-8").partition("\n")[0]]


def test_ruff_finds_nothing():
    command = [sys.executable, "-m", "ruff", "check", "--no-cache", "--output-format", "concise"]
    paths = [".", *(str(path.relative_to(ROOT)) for path in python_scripts())]
    done = subprocess.run([*command, *paths], cwd=ROOT, capture_output=True, text=True)
    assert done.returncode == 0, f"\n{done.stdout}{done.stderr}"
