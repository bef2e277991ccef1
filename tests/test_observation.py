"""A record meets a model once: what every channel is, for every method."""

from dataclasses import replace

import numpy as np
import pytest

import rotorid as rid
from rotorid.answer.identify import by_name
from rotorid.core.linalg import SENSORS, sensor_rank
from rotorid.testing import bind

MODEL = rid.load_model("jeffcott")
METHODS = ("ls", "batch", "sequential", "ml")


def periods(sensors, extra=()):
    """Return noisy periods of the shipped rotor with some sensors and further channels."""
    waves = np.cos(2 * np.pi * np.outer(np.arange(100), [1, 3, 4, 5, 6]) / 100).sum(axis=1)
    wave = np.outer(waves, [300.0, 200.0])
    record = rid.simulate(
        MODEL,
        MODEL.values(MODEL.nominal),
        wave,
        sample_rate=1000.0,
        periods=20,
        speed=2 * np.pi * 20.0,
        noise={"F_x": 0.1, "F_y": 0.1, "x": 1e-9, "y": 1e-9},
        rng=np.random.default_rng(4),
    )
    columns = [record.column("F_x"), record.column("F_y")]
    channels = list(record.channels[:2])
    for name, reads in sensors.items():
        columns.append(sum(c * record.column(q) for q, c in reads.items()))
        channels.append(rid.Channel(name, "m", reads=reads))
    for name in extra:
        columns.append(20.0 + np.random.default_rng(5).standard_normal(len(columns[0])))
        channels.append(rid.Channel(name, "K"))
    whole = replace(record, channels=tuple(channels), samples=np.column_stack(columns))
    return rid.average(whole, 10.0, harmonics=[1, 2, 3, 4, 5, 6])


def test_sensors_that_read_the_same_hide_a_coordinate_from_every_method():
    same = periods({"a": {"x": 1.0}, "b": {"x": 1.0, "y": 1e-12}})
    assert bind(MODEL, same).hidden == ("y",)
    for method in ("ls", "batch", "sequential"):
        with pytest.raises(rid.InputError, match="no sensor of y"):
            by_name(method).estimate(MODEL, [same])
    with pytest.raises(rid.InputError, match="copied, a, b"):  # before any method
        rid.identify(MODEL, same, "ml")
    estimate = by_name("ml").estimate(MODEL, [same])
    assert estimate.value("m") == pytest.approx(MODEL.nominal["m"], rel=0.01)
    apart = periods({"a": {"x": 1.0}, "b": {"x": 1.0, "y": 1e-3}})
    assert bind(MODEL, apart).hidden == ()


def test_the_tolerance_of_sensors():
    assert sensor_rank(np.array([[1.0, 0.0], [1.0, 10 * SENSORS]])) == 2
    assert sensor_rank(np.array([[1.0, 0.0], [1.0, SENSORS / 10]])) == 1


@pytest.mark.parametrize("method", METHODS)
def test_a_channel_that_is_nothing_of_the_model_is_refused_by_every_method(method):
    warm = periods({"x": {"x": 1.0}, "y": {"y": 1.0}}, extra=["temperature"])
    with pytest.raises(rid.InputError, match="a channel that reads 'temperature'"):
        rid.identify(MODEL, warm, method)
