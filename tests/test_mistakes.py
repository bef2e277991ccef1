"""Deliberate mistakes in an experiment file are named by the first suspect, check or warning."""

import pytest
from mistakes import MISTAKES, MISTAKES_IN_LEVERS, THREE, judge

pytestmark = pytest.mark.filterwarnings("ignore::RuntimeWarning")  # estimates astray overflow


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    return tmp_path_factory.mktemp("mistakes")


HERE = [mistake for mistake in MISTAKES if mistake.rig == THREE]
"""Those of the rigid rig are made where its sensors read parameters, and asked for more."""


def test_mistakes_are_many():
    assert len(HERE) >= 40
    assert len(MISTAKES_IN_LEVERS) >= 40


def slow_but_one(mistake):
    marks = () if mistake.what == "k_i of F_x1 100 N/A" else pytest.mark.slow
    return pytest.param(mistake, marks=marks, id=mistake.what)


@pytest.mark.parametrize("mistake", [slow_but_one(mistake) for mistake in HERE])
def test_a_mistake_is_named(mistake, folder):
    verdict = judge(mistake, folder)
    assert verdict.named, verdict
    assert verdict.status != "ok"


@pytest.mark.slow
@pytest.mark.parametrize("mistake", MISTAKES_IN_LEVERS, ids=lambda mistake: mistake.what)
def test_a_mistake_is_named_first_where_sensors_read_parameters(mistake, folder):
    """As in drafts: by the first suspect, or by those that fit as well as it."""
    verdict = judge(mistake, folder)
    assert verdict.by in ("first suspect", "told with the first"), verdict
    assert verdict.status != "ok"
