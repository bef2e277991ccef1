"""The peak of S, by rational functions of the lines about it.

    e_j = [ sum_a N_a(j) r_a + T(j) ] / A(j) + a W_j,    S = N_own / A

with the r of all axes, T the transient of the record's ends, which has the poles of the loop as
well, and W the lines of exp(+-i phi). A curve in a window without poles is too low where the window
is wider than the peak, and no deviation shows it (McKelvey, Guerin 2012; Geerardyn, Lataire 2014).
Error of output, by Gauss and Newton from the steps of Sanathanan and Koerner. On lines of whole
periods, where S itself is known with its deviations, r is 1, and there is neither T nor W.
"""

from __future__ import annotations

from dataclasses import replace
from functools import cached_property

import numpy as np
import scipy

from rotorid.core.values import Complexes, Floats, frozen

POLES = (0, 1, 2, 3)
"""Poles of a curve, of which the least are taken that the next does not beat."""
BEYOND = 2
"""Powers of N and T beyond what the next curve has: what is left over is held against them."""
LEAST = 12
"""Degrees of freedom that a curve or a window leaves for its noise, at the least."""
CHANCE = 1e-3
"""Chance with which noise alone makes a curve miss its lines."""
GAIN = 1e-2
"""Chance with which noise alone gives a curve a pole more."""
ROUNDS, STEPS = 4, 12
"""Rounds of Sanathanan and Koerner, and steps of Gauss and Newton at the most."""
SHARES = (0.0, 0.5, 0.8, 0.95, 0.99, 1.0)
"""Shares of the noise that have the poles of the loop, as what sensors and loads send round it."""
INNER = 0.6
"""Part of the lines, about their middle, in which a curve's peak counts."""
FINE = 4
"""Points between two lines at which a peak is looked for, and again about the highest."""
WEAK = 0.3
"""Deviation of S over itself above which its lines do not tell it, or were not excited."""
MISSES = 3
"""Doublings of the lines that may tell a peak no better before the next is not tried."""
CLIMBS = 4
"""Times that lines are moved on to the highest point of a curve that leaves them."""
NARROWEST = 0.5
"""Lines by which a pole lies off the real axis, at the least: less is chance, or no decay."""
ABOUT, LEAST_ABOUT = 10, 6
"""Lines of periods that a peak is fitted to, and how many there must be: of more, the bias of the
curve is as large as the noise."""
ROUNDING = 1e-12
"""Share of S below which no line of periods is known."""
MOST = 1.5
"""A peak this much above the highest line is no peak of these lines, but a pole between two."""


@frozen
class LineWindow:
    place: Floats  # (line,): from -1 to 1
    e: Complexes  # (line,)
    # (line, ...)
    r: Complexes
    rotation: Complexes
    own: int  # which r is that of e
    weight: Floats  # (line,): one over the standard deviation of the noise, but for a factor
    periodic: bool = False  # no transient, and the factor is one

    def powers(self, order: int, first: int = 0) -> Floats:
        return np.asarray(self.place[:, None] ** np.arange(first, order + 1))

    def columns(self, order: int, below: Complexes) -> Complexes:
        """Return the columns of N, T and the rotation, as they come out."""
        powers = self.powers(order) / below[:, None]
        driven = (self.r[:, :, None] * powers[:, None, :]).reshape(len(self.e), -1)
        ends = powers[:, :0] if self.periodic else powers
        return np.concatenate([driven, ends, self.rotation], axis=1)

    def least_lines(self, poles: int) -> int:
        if self.periodic:
            return order_of(poles) + 1 + poles + 1
        return least_lines(self.r.shape[1], self.rotation.shape[1], poles)

    def chance(self, gained: float, unknowns: int, noise: float, dof: int) -> float:
        """Return the chance with which noise alone gains so much from some unknowns more."""
        if self.periodic:
            return float(scipy.special.chdtrc(2 * unknowns, 2 * gained))
        ratio = gained / unknowns / max(noise, 1e-300)
        return float(scipy.special.fdtrc(2 * unknowns, 2 * dof, ratio))


def least_lines(axes: int, turning: int, poles: int) -> int:
    return (order_of(poles) + 1) * (axes + 1) + turning + poles + 2 * BEYOND + 1 + LEAST


def order_of(poles: int) -> int:
    """Return the order of N and T: what the poles leave is a line, and a parabola without."""
    return max(poles + 1, 2)


def _svd(matrix: Complexes) -> tuple[Complexes, Complexes]:
    """Return an orthonormal basis of the columns, and the matrix that gives their factors."""
    size = np.linalg.norm(matrix, axis=0)
    size = np.where(size > 1e-12 * size.max(), size, np.inf)
    left, values, right = np.linalg.svd(matrix / size, full_matrices=False)
    kept = values > 1e-10 * values[0]
    root = (right[kept].conj().T / values[kept]) / size[:, None]
    return np.asarray(left[:, kept]), np.asarray(root)


@frozen
class RationalCurve:
    """N / A and T / A fitted to lines."""

    part: LineWindow
    below: Complexes
    linear: Complexes
    poles: int
    loss: float

    @property
    def order(self) -> int:
        return order_of(self.poles)

    def _below(self, place: Floats) -> Complexes:
        return 1 + (place[:, None] ** np.arange(1, self.poles + 1)) @ self.below

    @cached_property
    def columns(self) -> Complexes:
        return self.part.columns(self.order, self._below(self.part.place))

    @property
    def driven(self) -> Complexes:
        """What r and the ends of the record make of e, without the rotation."""
        count = self.columns.shape[1] - self.part.rotation.shape[1]
        return np.asarray(self.columns[:, :count] @ self.linear[:count])

    @property
    def residual(self) -> Complexes:
        """What is left of e, unweighted."""
        return np.asarray(self.part.e - self.columns @ self.linear)

    @property
    def slopes(self) -> Complexes:
        """Derivative of the lines by the linear factors and those of A, weighted."""
        turned = self.driven / self._below(self.part.place)
        turned = -self.part.powers(self.poles, 1) * turned[:, None]
        matrix = np.concatenate([self.columns, turned], axis=1)
        return np.asarray(matrix * self.part.weight[:, None])

    def at(self, place: Floats) -> Complexes:
        """Return S."""
        first = self.part.own * (self.order + 1)
        above = self.linear[first : first + self.order + 1]
        powers = place[:, None] ** np.arange(self.order + 1)
        return np.asarray(powers @ above / self._below(place))

    def gradient(self, place: float) -> Complexes:
        """Return the derivative of S by the factors."""
        one = np.array([place])
        below, found = self._below(one)[0], self.at(one)[0]
        out = np.zeros(len(self.linear) + self.poles, dtype=np.complex128)
        first = self.part.own * (self.order + 1)
        out[first : first + self.order + 1] = place ** np.arange(self.order + 1) / below
        out[len(self.linear) :] = -(place ** np.arange(1, self.poles + 1)) * found / below
        return out

    @property
    def roots(self) -> Complexes:
        """Poles, in places."""
        return (
            np.asarray(np.roots([*self.below[::-1], 1.0])) if self.poles else np.zeros(0, complex)
        )

    @property
    def decays(self) -> bool:
        """Whether every pole among the lines decays within the record, as those of a loop do."""
        spacing = 2 / (len(self.part.e) - 1)
        among = self.roots[np.abs(self.roots.real) <= 1]
        least = 0.0 if self.part.periodic else NARROWEST * spacing
        return bool((among.imag > least).all())


def _linear(part: LineWindow, poles: int, below: Complexes) -> RationalCurve:
    a = 1 + part.powers(poles, 1) @ below
    columns = part.columns(order_of(poles), a) * part.weight[:, None]
    basis, root = _svd(columns)
    data = part.e * part.weight
    found = basis.conj().T @ data
    loss = float((np.abs(data - basis @ found) ** 2).sum())
    return RationalCurve(part, below, np.asarray(root @ found), poles, loss)


def fitted(part: LineWindow, poles: int) -> RationalCurve:
    below = np.zeros(poles, dtype=np.complex128)
    curve = _linear(part, poles, below)
    if not poles:
        return curve
    scale = np.ones(len(part.e))
    for _ in range(ROUNDS):
        weight = part.weight / np.maximum(scale, 1e-3 * scale.max())
        turned = -part.powers(poles, 1) * part.e[:, None]
        matrix = np.concatenate(
            [part.columns(order_of(poles), np.ones_like(part.e)), turned], axis=1
        )
        basis, root = _svd(matrix * weight[:, None])
        below = (root @ (basis.conj().T @ (weight * part.e)))[-poles:]
        scale = np.abs(1 + part.powers(poles, 1) @ below)
        tried = _linear(part, poles, below)
        if tried.loss < curve.loss:
            curve = tried
    for _ in range(STEPS):
        basis, root = _svd(curve.slopes)
        step = (root @ (basis.conj().T @ (curve.residual * part.weight)))[-poles:]
        for share in (1.0, 0.3, 0.1, 0.02):
            tried = _linear(part, poles, curve.below + share * step)
            if tried.loss < curve.loss:
                break
        else:
            break
        gained, curve = curve.loss - tried.loss, tried
        if gained < 1e-8 * curve.loss:
            break
    return curve


def _weighed(curve: RationalCurve) -> LineWindow:
    """Weigh the lines by the noise that tells them best: a share has the poles of the loop."""
    poles = 1 / np.abs(curve._below(curve.part.place)) ** 2
    power, poles = np.abs(curve.residual) ** 2, poles / poles.mean()
    sizes = [1 - share + share * poles for share in SHARES]
    cost = [np.log(size).sum() + len(power) * np.log((power / size).sum()) for size in sizes]
    return replace(curve.part, weight=1 / np.sqrt(sizes[int(np.argmin(cost))]))


@frozen
class Peak:
    value: complex  # complex
    std: float  # of its size, what curves of more freedom have otherwise included
    place: float
    inside: bool  # whether it is none of an end
    # degrees of freedom of its deviation: two for each line that tells it, as the noise about the
    # peak may be another than elsewhere
    dof: float
    chance: float  # with which noise alone misses the curve as much
    width: float  # between the half powers of the pole beneath it, in places; inf without
    # of one in a band, in Hz: where it is, and the span of the lines that it was fitted to
    hertz: float = 0.0
    span: float = 0.0

    @property
    def size(self) -> float:
        return abs(self.value)

    @property
    def unsure(self) -> float:
        return self.std / self.size

    @property
    def reach(self) -> float:
        """Hz about it that were looked at."""
        width = self.width * self.span / 2 if np.isfinite(self.width) else 0.0
        return max(self.span * INNER / 2, 1.5 * width)

    def beside(self, fewer: Peak | None) -> Peak:
        """Return the peak with the difference to that of fewer lines, beyond chance, in its std.

        The lines are chosen for their deviation, which is the smaller where a curve misses them.
        """
        if fewer is None or abs(self.hertz - fewer.hertz) > fewer.span:
            return self
        chance = max(fewer.std**2 - self.std**2, 0.0)
        beyond = max((self.size - fewer.size) ** 2 - chance, 0.0)
        return replace(self, std=float(np.hypot(self.std, np.sqrt(beyond))))

    def interval(self, confidence: float) -> tuple[float, float]:
        times = scipy.stats.t.ppf((1 + confidence) / 2, self.dof)
        factor = float(np.exp(times * self.unsure))
        return self.size / factor, self.size * factor


def _largest(curve: RationalCurve, low: float, high: float) -> float:
    count = max(int((high - low) / 2 * len(curve.part.e) * FINE), 20)
    fine = np.linspace(low, high, count)
    roots = curve.roots.real
    fine = np.sort(np.concatenate([fine, roots[(roots > low) & (roots < high)]]))
    at = int(np.abs(curve.at(fine)).argmax())
    again = np.linspace(fine[max(at - 1, 0)], fine[min(at + 1, len(fine) - 1)], 10 * FINE + 1)
    return float(again[np.abs(curve.at(again)).argmax()])


def judged(curve: RationalCurve, low: float, high: float) -> Peak:
    """Return the highest point of a curve between two places, and what it is worth."""
    part = curve.part
    place = _largest(curve, low, high)
    value = curve.at(np.array([place]))[0]
    slopes = curve.slopes
    basis, root = _svd(slopes)
    left = curve.residual * part.weight
    dof = len(left) - basis.shape[1]
    noise = float((np.abs(left) ** 2).sum()) / dof
    if part.periodic:
        noise = max(noise, 1.0)  # more than the lines have is misfit
    gradient = curve.gradient(place)
    told = gradient @ root
    variance = noise * float((np.abs(told) ** 2).sum()) / 2
    taken = np.minimum((np.abs(basis) ** 2).sum(axis=1), 0.99)
    each = np.abs(told @ basis.conj().T) ** 2
    if not part.periodic:
        variance = max(variance, float((each * np.abs(left) ** 2 / (1 - taken)).sum()) / 2)
    telling = 2 * float(each.sum() ** 2 / (each**2).sum()) if each.any() else 2.0
    # One step towards a curve of more freedom: what it gains, and by how much it is higher.
    more, direct = _beyond(curve, place)
    shared = basis.conj().T @ more
    extra, back = _svd(more - basis @ shared)
    factors = back @ (extra.conj().T @ left)
    gained = float((np.abs(extra.conj().T @ left) ** 2).sum())
    rest = dof - extra.shape[1]
    noise_ = 1.0
    if not part.periodic:
        noise_ = max(float((np.abs(left) ** 2).sum()) - gained, 1e-300) / rest
    chance = part.chance(gained, extra.shape[1], noise_, rest)
    drift = direct - told @ shared
    moved = float((value.conj() * (drift @ factors)).real / abs(value))
    moved_std = noise_ * float((np.abs(drift @ back) ** 2).sum()) / 2
    bias = max(moved**2 - moved_std, 0.0)
    near = curve.roots[np.argmin(np.abs(curve.roots - place))].imag if curve.poles else np.inf
    inside = low + 1e-9 < place < high - 1e-9
    return Peak(
        complex(value),
        float(np.sqrt(variance + bias)),
        place,
        inside,
        min(2.0 * dof, telling),
        chance,
        2 * near,
    )


def _beyond(curve: RationalCurve, place: float) -> tuple[Complexes, Complexes]:
    """Return columns that a curve of more freedom has, weighted, and what they make of S."""
    part, order = curve.part, curve.order
    below = 1 + part.powers(curve.poles, 1) @ curve.below
    powers = part.powers(order + BEYOND, order + 1) / below[:, None]
    ends = powers[:, :0] if part.periodic else powers
    pole = -(part.place ** (curve.poles + 1)) * curve.driven / below
    own = part.r[:, [part.own]] * powers
    matrix = np.concatenate([own, ends, pole[:, None]], axis=1) * part.weight[:, None]
    here = 1 + (place ** np.arange(1, curve.poles + 1)) @ curve.below
    gives = np.zeros(matrix.shape[1], dtype=np.complex128)
    gives[:BEYOND] = place ** np.arange(order + 1, order + BEYOND + 1) / here
    gives[-1] = -(place ** (curve.poles + 1)) * curve.at(np.array([place]))[0] / here
    return np.asarray(matrix, dtype=np.complex128), gives


def best_curve(part: LineWindow) -> RationalCurve:
    """Return the curve of as few poles as noise explains."""
    held = fitted(part, 0)
    for poles in POLES[1:]:
        if len(part.e) < part.least_lines(poles):
            break
        tried = fitted(part, poles)
        unknowns = len(tried.linear) + tried.poles
        more, rest = unknowns - len(held.linear) - held.poles, len(part.e) - unknowns
        if part.chance(held.loss - tried.loss, more, tried.loss / rest, rest) > GAIN:
            break
        if not tried.decays:
            continue
        held = tried
    if part.periodic:
        return held
    again = fitted(_weighed(held), held.poles)
    return again if again.decays else held


@frozen
class LoopLines:
    """The lines of a whole record, and which r is the own of e."""

    frequency: Floats
    e: Complexes
    r: Complexes
    rotation: Complexes
    own: int

    def part(self, hertz: float, size: int) -> tuple[LineWindow, int]:
        """Return lines about a frequency, and the first of them."""
        count = len(self.frequency)
        first = int(np.clip(np.searchsorted(self.frequency, hertz) - size // 2, 0, count - size))
        here = slice(first, first + size)
        place = np.linspace(-1.0, 1.0, size)
        part = LineWindow(
            place, self.e[here], self.r[here], self.rotation[here], self.own, np.ones(size)
        )
        return part, first

    def climbed(self, hertz: float, size: int) -> Peak | None:
        """Return the peak next to a frequency by so many lines; None where it is none of them."""
        for _ in range(CLIMBS):
            part, first = self.part(hertz, size)
            low = -1.0 if first == 0 else -INNER
            high = 1.0 if first + size == len(self.frequency) else INNER
            curve = best_curve(part)
            peak = judged(curve, low, high)
            reach = (self.frequency[first + size - 1] - self.frequency[first]) / 2
            hertz = float(self.frequency[first] + reach * (1 + peak.place))
            if peak.inside or abs(peak.place) > 1 - 1e-9:
                return replace(peak, hertz=hertz, span=2 * float(reach))
        return None


def peak_near(band: LoopLines, hertz: float) -> Peak | None:
    """Return the peak near a frequency by the lines that tell it best; None if none does."""
    size = least_lines(band.r.shape[1], band.rotation.shape[1], 1)
    best: Peak | None = None
    before: Peak | None = None
    missed = 0
    while size <= len(band.frequency) and missed < MISSES:
        found = band.climbed(hertz, size)
        good = found is not None and found.chance > CHANCE and found.unsure < WEAK
        if found is not None and good and (best is None or found.unsure < best.unsure):
            missed = 0
            best = found.beside(before)
        elif best is not None:
            missed += 1
        before = found if good else before
        size *= 2
    return best


def peak_of(
    frequency: Floats, values: Complexes, std: Floats | None = None
) -> tuple[float, float, float]:
    """Return the largest |S|, between lines too, its frequency, its deviation; 0 without `std`."""
    at, about = int(np.abs(values).argmax()), min(ABOUT, len(values))
    size = float(np.abs(values[at]))
    highest = size, float(frequency[at]), 0.0 if std is None else float(std[at] / np.sqrt(2))
    if about < LEAST_ABOUT:
        return highest
    first = int(np.clip(at - about // 2, 0, len(values) - about))
    here = slice(first, first + about)
    nodes, ones = frequency[here], np.ones((about, 1), dtype=np.complex128)
    place = 2 * (nodes - nodes[0]) / (nodes[-1] - nodes[0]) - 1
    weight = np.ones(about) if std is None else 1 / np.maximum(std[here], ROUNDING * size)
    part = LineWindow(place, values[here], ones, ones[:, :0], 0, weight, periodic=True)
    most = max(poles for poles in POLES if part.least_lines(poles) <= about)
    curve = fitted(part, most) if std is None else best_curve(part)
    # Not beyond the neighbours of the largest line: there the fit is none of the lines.
    beside = np.clip([at - 1 - first, at + 1 - first], 0, about - 1)
    peak = judged(curve, *place[beside].tolist())
    if not size / MOST < peak.size < MOST * size:
        return highest
    hertz = float(np.interp(peak.place, [-1.0, 1.0], nodes[[0, -1]]))
    return peak.size, hertz, 0.0 if std is None else peak.std
