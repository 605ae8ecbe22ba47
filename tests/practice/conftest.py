"""All samples, written once."""

import pytest

from irbcal.practice.samples import samples


@pytest.fixture(scope="session")
def written(tmp_path_factory):
    folder = tmp_path_factory.mktemp("practice") / "samples"
    return samples(folder)
