"""The shipped rig as it is, without noise, and on magnets."""

import pytest
from rigs import with_magnets, without_noise

from rotorid import load_rig
from rotorid.testing import parse_rig


@pytest.fixture(scope="session")
def shipped():
    return load_rig("three-mass").rig


@pytest.fixture(scope="session")
def quiet(shipped):
    return without_noise(shipped)


@pytest.fixture(scope="session")
def magnetic():
    """The shipped rig on opposed magnets, without noise; its controller made for them."""
    return without_noise(parse_rig(with_magnets(more='limit = "1.5 A"')).rig)
