"""Fleets: what machines of one type have in common, how they differ, which stand out or changed.

Machine i has the weighted mean y_i of its results, of known variance v_i::

    y_i = c + m_i + e_i,    m_i ~ N(0, t),    e_i ~ N(0, v_i),    w_i = 1 / (v_i + t)
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from itertools import pairwise
from typing import NamedTuple

import numpy as np
import scipy

from rotorid.answer.estimate import ERR, assuming_table, figures, two_digits
from rotorid.core.distributions import HALF_WIDTH
from rotorid.core.frozen import frozen
from rotorid.core.values import Floats
from rotorid.report.drawn import BLUE, GREY, RED, Axis, Curve, Panel, label
from rotorid.report.html import Passage

ALARM = 0.01
"""Chance that a parameter names any machine where none stands out, and any where none changed."""
MOST_NAMES = 24
"""Serial numbers that an axis has room for."""


class FleetResult(NamedTuple):
    date: str  # empty where the experiment file states none
    case: int
    value: float
    std: float
    std_assumed: float | None = None  # if what is assumed is wrong; None where nobody asked


class Deviation(NamedTuple):
    size: float  # in std
    p_value: float  # that any machine of the fleet has one as large
    dates: tuple[str, ...] = ()  # between which it came


@frozen
class FleetMember:
    """A parameter of one machine."""

    serial: str
    results: tuple[FleetResult, ...]  # by date
    mean: float  # weighted, of the results
    std: float
    shrunk: float  # best estimate, knowing the others
    shrunk_std: float
    away: Deviation  # from what the others predict
    change: Deviation  # largest, of the mean up to a date to that from the next one on

    @property
    def rows(self) -> Iterator[tuple[str, ...]]:
        said = [figures(self.mean, self.std), figures(self.shrunk, self.shrunk_std)]
        said += two_digits(self.shrunk_std), f"{self.away.size:+.2f}", f"{self.away.p_value:.2g}"
        for date, _, value, std, assumed in self.results:
            own = figures(value, std), two_digits(std), _assumed(assumed)
            yield self.serial, date, *own, *said
            said = [""] * len(said)


@frozen
class FleetParameter:
    """A parameter over a fleet: what its machines have in common, and how they scatter."""

    name: str
    common: float
    interval: tuple[float, float]  # 95 %
    scatter: float
    scatter_interval: tuple[float, float]  # 95 %
    machines: tuple[FleetMember, ...]

    @property
    def row(self) -> tuple[str, ...]:
        half = (self.interval[1] - self.interval[0]) / 2
        count = len(self.machines), sum(len(each.results) for each in self.machines)
        scatter, low, high = (figures(x, x) for x in (self.scatter, *self.scatter_interval))
        every = [r.std_assumed for each in self.machines for r in each.results if r.std_assumed]
        said = figures(self.common, half), two_digits(half), _assumed(max(every, default=None))
        return self.name, *map(str, count), *said, scatter, f"{low} to {high}"

    @property
    def remarks(self) -> Iterator[str]:
        if not self.scatter_interval[1]:  # no scatter, however small, has a chance of 2.5 %
            squares = sum(((each.mean - self.common) / each.std) ** 2 for each in self.machines)
            chance = _told(float(scipy.special.chdtr(len(self.machines) - 1, squares)))
            told = f"{self.name}: machines scatter less than the std of results say ({chance})"
            yield f"{told}: these are too large, or results depend on each other"
        for machine in self.machines:
            for found, did in ((machine.away, "differs"), (machine.change, "changed")):
                if found.p_value < ALARM:
                    told = f"{self.name} of serial {machine.serial} {did} by {found.size:+.1f} std"
                    where = " and ".join(found.dates)
                    where = f"between {where}" if where else "from what the others predict"
                    yield f"{told} {where} ({_told(found.p_value)})"

    @property
    def passage(self) -> Passage:
        """Its table, and its picture: machines side by side, the results of one by date."""
        heads = "serial", "date", "value", "std", ERR, "mean", "shrunk", "its std", "away in std"
        every = [row for machine in self.machines for row in machine.rows]
        rows = assuming_table((*heads, "p"), every)
        ends, reach = np.array([-0.5, len(self.machines) - 0.5]), HALF_WIDTH * self.scatter
        low, high = (np.full(2, self.common + side) for side in (-reach, reach))
        curves = [Curve(ends, high, "95 % of machines", GREY, "band", base=low)]
        for place, machine in enumerate(self.machines):
            y, half = np.array([(each.value, HALF_WIDTH * each.std) for each in machine.results]).T
            x = place - 0.3 + 0.6 * (np.arange(len(y)) + 0.5) / len(y)
            named = min(machine.away.p_value, machine.change.p_value) < ALARM
            key, colour = ("differs, or changed", RED) if named else ("with 95 %", BLUE)
            told = tuple(f"{machine.serial} {r.date}: {r.value:.6g}" for r in machine.results)
            curves.append(Curve(x, y, "", colour, "thin"))
            curves.append(Curve(x, y + half, "", colour, "stems", base=y - half))
            curves.append(Curve(x, y, key, colour, "dots", told=told))
        names = tuple(each.serial for each in self.machines) * (len(self.machines) <= MOST_NAMES)
        y = Axis(f"{label(self.name)} in SI units")
        panel = Panel("", Axis("serial", names=names), y, tuple(curves))
        return Passage(self.name, table=rows, panels=(panel,))


def fleet_parameter(name: str, told: Mapping[str, Sequence[FleetResult]]) -> FleetParameter:
    """Return what the results of two machines or more say, by serial number, of a parameter.

    A machine is drawn to the common value, ``c + (1 - b) (y - c)`` with ``b = v w``. The mean
    square error of that is ``v (1 - b) + b^2 / sum w``, and ``4 v^2 w^3 / sum w^2`` since t is
    estimated (Prasad and Rao 1990); more than v is not taken.
    """
    serials = sorted(told, key=lambda serial: (len(serial), serial))  # 9 before 10
    results = [tuple(sorted(told[serial])) for serial in serials]
    y, v = np.array([_mean(each) for each in results]).T
    t = variance_between(y, v)
    w, c, rest = _weighed(y, v, t)
    half = float(scipy.special.stdtrit(len(y) - 1, 0.975) / np.sqrt(w.sum()))
    b = v * w
    error = v * (1 - b) + b**2 / w.sum() + 4 * v**2 * w**3 / (w**2).sum()
    said = np.array([y, np.sqrt(v), c + (1 - b) * rest, np.sqrt(np.minimum(error, v))])
    parts = zip(serials, results, said.T.tolist(), _away(y, v), _changes(results), strict=True)
    machines = tuple(FleetMember(one, each, *own, *found) for one, each, own, *found in parts)
    interval = float(c) - half, float(c) + half
    return FleetParameter(name, float(c), interval, math.sqrt(t), _limits(y, v), machines)


def _assumed(std: float | None) -> str:
    return "-" if std is None else two_digits(std)


def _told(p_value: float) -> str:
    return f"p = {p_value:.1g}" if p_value > 1e-6 else "p < 1e-6"


def _weighed(y: Floats, v: Floats, t: float | Floats) -> tuple[Floats, Floats, Floats]:
    """Return weights, the weighted mean, and values less it; of several t, (k, 1), for each."""
    w = 1 / (v + t)
    c = (w * y).sum(axis=-1, keepdims=True) / w.sum(axis=-1, keepdims=True)
    return w, c[..., 0], y - c


def variance_between(y: Floats, v: Floats) -> float:
    """Return t of the largest restricted likelihood, found on a grid and refined.

    Twice its logarithm is ``sum log w - log sum w - sum w (y - c)^2``.
    """

    def slope(t: float) -> float:
        w, _, rest = _weighed(y, v, t)
        return float(((w * rest) ** 2).sum() - w.sum() + (w**2).sum() / w.sum())

    most = max(2 * np.ptp(y) ** 2, v.max())
    grid = np.concatenate([[0.0], np.geomspace(1e-3 * v.min(), most, 40)])
    w, _, rest = _weighed(y, v, grid[:, None])
    best = int(np.argmax((np.log(w) - w * rest**2).sum(axis=-1) - np.log(w.sum(axis=-1))))
    low, high = grid[max(best - 1, 0)], grid[min(best + 1, 40)]
    rises = slope(low) > 0 > slope(high)
    return float(scipy.optimize.brentq(slope, low, high, xtol=1e-14 * high) if rises else 0.0)


def _limits(y: Floats, v: Floats) -> tuple[float, float]:
    """Return what holds the scatter with 95 %: ``sum w (y - c)^2`` at the true one is chi^2."""

    def end(chance: float) -> float:
        limit = float(scipy.special.chdtri(len(y) - 1, chance))

        def excess(t: float) -> float:
            w, _, rest = _weighed(y, v, t)
            return float((w * rest**2).sum()) - limit

        most = len(y) * np.ptp(y) ** 2 / limit
        if excess(0.0) <= 0:
            return 0.0
        return math.sqrt(scipy.optimize.brentq(excess, 0.0, most, xtol=1e-12 * most))

    return end(0.025), end(0.975)


def _away(y: Floats, v: Floats) -> Iterator[Deviation]:
    """Yield how far each machine is from what the others predict: t distributed, if v are alike."""
    for one, (value, variance) in enumerate(zip(y, v, strict=True)):
        others = np.delete(y, one), np.delete(v, one)
        t = variance_between(*others)
        w, c, _ = _weighed(*others, t)
        size = float((value - c) / math.sqrt(variance + t + 1 / w.sum()))
        freedom = max(len(y) - 2, 1e-6)  # one machine tells nothing of another
        yield Deviation(size, _any(float(scipy.special.stdtr(freedom, -abs(size))), len(y)))


def _changes(histories: Sequence[Sequence[FleetResult]]) -> Iterator[Deviation]:
    """Yield the largest change of each machine between two dates in a row."""
    found = list[dict[tuple[str, ...], float]]()
    for results in histories:
        found.append({(): 0.0})
        for dates in pairwise(sorted({each.date for each in results if each.date})):
            old, old_variance = _mean([each for each in results if "" < each.date <= dates[0]])
            new, new_variance = _mean([each for each in results if each.date >= dates[1]])
            found[-1][dates] = (new - old) / math.sqrt(old_variance + new_variance)
    count = sum(map(len, found)) - len(found)
    for sizes in found:
        between, size = max(sizes.items(), key=lambda item: abs(item[1]))
        yield Deviation(size, _any(float(scipy.special.ndtr(-abs(size))), count), between)


def _any(tail: float, count: int) -> float:
    """Bound the chance that any of so many variables is as far out, on either side (Sidak 1967)."""
    return 1.0 if tail == 0.5 else -math.expm1(count * math.log1p(-2 * tail))


def _mean(results: Sequence[FleetResult]) -> tuple[float, float]:
    """Return the weighted mean of independent results, and its variance."""
    y, v = np.array([(each.value, each.std**2) for each in results]).T
    w, mean, _ = _weighed(y, v, 0.0)
    return float(mean), 1 / float(w.sum())
