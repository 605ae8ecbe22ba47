import os
from pathlib import Path

import pytest
from hypothesis import settings

# the same examples every time, and no verdict on a slow moment of a shared machine
settings.register_profile("irbcal", deadline=None, derandomize=True)
settings.load_profile("irbcal")


@pytest.fixture(scope="session")
def shared_data():
    """Folder of the measured data, which are not part of the project; IRBCAL_SHARED_DATA overrides where it is."""
    default = Path(__file__).parents[2] / "shared" / "data"
    folder = Path(os.environ.get("IRBCAL_SHARED_DATA") or default)
    if not folder.is_dir():
        pytest.skip(f"no measured data: {folder} does not exist (set IRBCAL_SHARED_DATA to their folder)")
    return folder
