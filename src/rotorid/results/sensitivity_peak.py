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

    @cached_property
    def drives(self) -> Complexes:
        """What makes e through a polynomial over A: every r, and 1 of the ends of a record."""
        ends = np.ones((len(self.r), 0 if self.periodic else 1), dtype=np.complex128)
        return np.concatenate([self.r, ends], axis=1)

    def alone(self, place: Floats) -> LineWindow:
        """Return lines at places on which the own r is 1 and all else is 0: their e is S."""
        r = np.zeros((len(place), self.drives.shape[1]), dtype=np.complex128)
        r[:, self.own], one = 1.0, np.ones(len(place))
        none = np.zeros((len(place), self.rotation.shape[1]), dtype=np.complex128)
        return LineWindow(place, r[:, self.own], r, none, self.own, one, periodic=True)

    def columns(self, order: int, below: Complexes | float = 1.0) -> Complexes:
        """Return the columns of N, T and the rotation, as they come out."""
        powers = self.powers(order) / np.reshape(below, (-1, 1))
        return np.concatenate([_products(self.drives, powers), self.rotation], axis=1)

    def equation(self, order: int, poles: int) -> Complexes:
        """Return the columns of ``A e = sum_a N_a r_a + T``, those of A the last."""
        turned = -self.powers(poles, 1) * self.e[:, None]
        return np.concatenate([self.columns(order), turned], axis=1)

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


def _products(drives: Complexes, powers: Complexes) -> Complexes:
    return (drives[:, :, None] * powers[:, None, :]).reshape(len(powers), -1)


def svd(matrix: Complexes, loud: float = 0.0) -> tuple[Complexes, Complexes, Floats]:
    """Return a basis of the columns, what gives their factors, and how far it tells each of them.

    A column is zero beside the largest of all lines, `loud`, or else beside the others.
    """
    size = np.linalg.norm(matrix, axis=0)
    size = np.where(size > 1e-12 * (loud or size.max()), size, np.inf)
    left, values, right = np.linalg.svd(matrix / size, full_matrices=False)
    kept = values > 1e-10 * values[0]
    root = (right[kept].conj().T / values[kept]) / size[:, None]
    return left[:, kept], root, (np.abs(right[kept]) ** 2).sum(axis=0)


@frozen
class RationalCurve:
    """N / A and T / A fitted to lines."""

    part: LineWindow
    order: int  # of N and T
    below: Complexes  # factors of A, but for the first, 1
    linear: Complexes  # of N, T and the rotation
    loss: float

    @property
    def poles(self) -> int:
        return len(self.below)

    @cached_property
    def sizes(self) -> Complexes:
        """A on the lines."""
        return np.asarray(1 + self.part.powers(self.poles, 1) @ self.below)

    @cached_property
    def columns(self) -> Complexes:
        return self.part.columns(self.order, self.sizes)

    @property
    def driven(self) -> Complexes:
        """What r and the ends of the record make of e, without the rotation."""
        count = (self.order + 1) * self.part.drives.shape[1]
        return np.asarray(self.columns[:, :count] @ self.linear[:count])

    @property
    def residual(self) -> Complexes:
        """What is left of e, unweighted."""
        return np.asarray(self.part.e - self.columns @ self.linear)

    @property
    def slopes(self) -> Complexes:
        """Derivative of the lines by the linear factors and those of A, weighted."""
        return self._with_poles(self.columns, 1, self.poles)

    @property
    def beyond(self) -> Complexes:
        """Columns that a curve of more freedom has, weighted."""
        powers = self.part.powers(self.order + BEYOND, self.order + 1) / self.sizes[:, None]
        drives = self.part.drives
        own = drives[:, np.unique([self.part.own, drives.shape[1] - 1])]  # and the ends
        return self._with_poles(_products(own, powers), self.poles + 1, self.poles + 1)

    def _with_poles(self, columns: Complexes, first: int, last: int) -> Complexes:
        turned = -self.part.powers(last, first) * (self.driven / self.sizes)[:, None]
        return np.asarray(np.concatenate([columns, turned], axis=1) * self.part.weight[:, None])

    def alone(self, place: Floats) -> RationalCurve:
        """Return the curve of lines at some places that are S there."""
        return replace(self, part=self.part.alone(place))

    def at(self, place: Floats) -> Complexes:
        """Return S."""
        return self.alone(place).driven

    @property
    def roots(self) -> Complexes:
        """Poles, in places."""
        return np.asarray(np.roots([*self.below[::-1], 1.0]))

    @property
    def decays(self) -> bool:
        """Whether every pole among the lines decays within the record, as those of a loop do."""
        spacing = 2 / (len(self.part.e) - 1)
        among = self.roots[np.abs(self.roots.real) <= 1]
        least = 0.0 if self.part.periodic else NARROWEST * spacing
        return bool((among.imag > least).all())


def _linear(part: LineWindow, below: Complexes) -> RationalCurve:
    poles = len(below)
    order = order_of(poles)
    columns = part.columns(order, 1 + part.powers(poles, 1) @ below)
    basis, root, _ = svd(columns * part.weight[:, None])
    data = part.e * part.weight
    found = basis.conj().T @ data
    loss = float((np.abs(data - basis @ found) ** 2).sum())
    return RationalCurve(part, order, below, root @ found, loss)


def fitted(part: LineWindow, poles: int) -> RationalCurve:
    curve = _linear(part, np.zeros(poles, dtype=np.complex128))
    if not poles:
        return curve
    scale = np.ones(len(part.e))
    for _ in range(ROUNDS):
        weight = part.weight / np.maximum(scale, 1e-3 * scale.max())
        basis, root, _ = svd(part.equation(order_of(poles), poles) * weight[:, None])
        below = (root @ (basis.conj().T @ (weight * part.e)))[-poles:]
        scale = np.abs(1 + part.powers(poles, 1) @ below)
        curve = min(curve, _linear(part, below), key=lambda tried: tried.loss)
    for _ in range(STEPS):
        basis, root, _ = svd(curve.slopes)
        step = (root @ (basis.conj().T @ (curve.residual * part.weight)))[-poles:]
        for share in (1.0, 0.3, 0.1, 0.02):
            tried = _linear(part, curve.below + share * step)
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
    poles = 1 / np.abs(curve.sizes) ** 2
    power, poles = np.abs(curve.residual) ** 2, poles / poles.mean()
    sizes = [1 - share + share * poles for share in SHARES]
    cost = [np.log(size).sum() + len(power) * np.log((power / size).sum()) for size in sizes]
    return replace(curve.part, weight=1 / np.sqrt(sizes[int(np.argmin(cost))]))


@frozen
class Peak:
    value: complex
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
    there = curve.alone(np.array([place]))
    value = complex(there.driven[0])
    basis, root, _ = svd(curve.slopes)
    left = curve.residual * part.weight
    lost, dof = float((np.abs(left) ** 2).sum()), len(left) - basis.shape[1]
    noise = max(lost / dof, 1.0) if part.periodic else lost / dof  # more than lines have is misfit
    told = there.slopes[0] @ root
    variance = noise * float((np.abs(told) ** 2).sum()) / 2
    taken = np.minimum((np.abs(basis) ** 2).sum(axis=1), 0.99)
    each = np.abs(told @ basis.conj().T) ** 2
    if not part.periodic:
        variance = max(variance, float((each * np.abs(left) ** 2 / (1 - taken)).sum()) / 2)
    telling = 2 * float(each.sum() ** 2 / (each**2).sum()) if each.any() else 2.0
    # One step towards a curve of more freedom: what it gains, and by how much it is higher.
    more = curve.beyond
    shared = basis.conj().T @ more
    extra, back, _ = svd(more - basis @ shared)
    gains = extra.conj().T @ left
    gained, rest = float((np.abs(gains) ** 2).sum()), dof - extra.shape[1]
    noise = 1.0 if part.periodic else max(lost - gained, 1e-300) / rest
    drift = (there.beyond[0] - told @ shared) @ back
    moved = float((value.conjugate() * (drift @ gains)).real / abs(value))
    bias = max(moved**2 - noise * float((np.abs(drift) ** 2).sum()) / 2, 0.0)
    near = curve.roots[np.argmin(np.abs(curve.roots - place))].imag if curve.poles else np.inf
    return Peak(
        value,
        float(np.sqrt(variance + bias)),
        place,
        low + 1e-9 < place < high - 1e-9,
        min(2.0 * dof, telling),
        part.chance(gained, extra.shape[1], noise, rest),
        2 * near,
    )


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
