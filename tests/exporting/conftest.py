"""Exports of several robots, made once."""

import exported
import pytest

from irbcal.exporting.source import Source

ROBOTS = ("irb1600", "ur10", "panda", "level", "rail", "plain")


@pytest.fixture(scope="session")
def sources(tmp_path_factory):
    """What is exported of robots with every kind of term and with none, on six and seven joints, turning and sliding."""
    folder = tmp_path_factory.mktemp("sources")
    return {name: Source.of_robot(exported.robot(name, folder)) for name in ROBOTS}


@pytest.fixture(scope="session")
def described():
    """Sources with URDF and meshes, of robots with every kind of term."""
    out = {}
    for name in ("irb1600", "ur10", "panda"):
        made, data, folder = exported.described(name)
        out[name] = Source.of_robot(made, urdf=data, folder=folder)
    return out
