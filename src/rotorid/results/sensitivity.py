"""Sensitivity of the loops after ISO 14839-3, measured or predicted, with the zones of its peak.

For the axis j the sensitivity ``E = S R`` is S_jj, with the other loops closed as they are. On
lines of whole periods it follows from as many records, or from as many lines, as there are axes
excited at once; on a whole record from a polynomial in a window of lines (docs/sensitivity.md),

    e_k = [ (G_0 + .. + G_s k^s) r_k + t_0 + .. + t_s k^s ] / A(k) + a W_k,    S = G_0,

W the lines of exp(+-i phi), A a pair of poles where noise alone does not explain what they gain.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from itertools import groupby
from operator import itemgetter

import numpy as np
import scipy

from rotorid.core.errors import InputError, require_names, require_type
from rotorid.core.units import quantity
from rotorid.core.values import Complexes, Floats, Result, frozen, grouped
from rotorid.data.record import PeriodicRecord, Record
from rotorid.data.whole_record import whole_lines
from rotorid.results.sensitivity_peak import (
    LEAST,
    MOST,
    WEAK,
    LineWindow,
    LoopLines,
    Peak,
    RationalCurve,
    peak_near,
    peak_of,
    svd,
)
from rotorid.signals.covariance import choose_covariance

LIMITS = {"A": 3.0, "B": 4.0, "C": 5.0}
"""Peaks below which a machine is in a zone, ISO 14839-3: 9.5, 12 and 14 dB; D is above."""
CONFIDENCE = 0.95
"""Chance that the interval of a peak holds it."""
AT_END = 2.0
"""Deviations within which the first or the last line is as high as the highest."""
ORDER = 2
"""s of the windows: curves bend less than a parabola in the few lines of one."""
FEWEST = 4
"""Windows of an axis, at the least, of what is called excited."""
LEAST_SETTLED = 5
"""Lines of the last third, at the least, that tell what S comes to."""
LEVEL = -0.1
"""Mean of ln |S| over a band that ends below 1, under which it is that of no loop: over all
frequencies, that of a loop is 0 or more (Bode), so that it has to be above 1 beyond the band."""
UNIT = 0.03
"""Distance from 1 that is still called 1: a quarter of a dB."""
FLAT = 0.25
"""Change over the last third, beside the distance from 1, of what no longer falls: 1 / f changes
by .4 of it. The noise of the change counts as one, so that it decides what is no distance too."""
POLES, RESONANT = 2, 1e-2
"""Poles of a window, and the chance with which noise alone gives any to one of a record."""
CANDIDATES = 3
"""Peaks of an axis that are looked at, the highest by their windows."""
RIVAL = 0.1
"""Deviation over itself above which a second peak is none: noise on lines of little excitation."""
UNTOLD = "its lines do not tell the peak: record for longer, or excite more"
"""Caveat of a peak that no curve follows."""
ORDERS = 3
"""Multiples of the rotation whose lines are left out: unbalance and runout answer no excitation."""
ALONE = 1e-6
"""Share of another axis' excitation in a direction that is still called an axis' own."""
SILENT, TOLD = 1e-5, 5.0
"""Share of its own loudest line, and deviations of its own noise, below which r is none: what the
digits of its column leave on lines of other axes, or beyond the excitation. An r that never repeats
scatters as a whole, and that is no noise."""
SAME = 1e-9
"""Distance of S from 1 on every line below which e is r: rounding."""
SINGLE = 0.4
"""Height of a line beside the highest, over that, below which no loop is that has a line spacing
of half the width of its peak: there it is 0.7."""


@frozen
class AxisSensitivity(Result):
    axis: str
    frequency_hz: Floats  # (line,)
    sensitivity: Complexes  # (line,)
    std: Floats  # (line,): of each part, real and imaginary
    peak: float
    peak_hz: float
    interval: tuple[float, float]  # (float, float): holds the peak with 95 percent
    caveat: str = ""  # why the peak may be higher than what was measured, if anything does

    @property
    def peak_db(self) -> float:
        return float(20 * np.log10(self.peak))

    @property
    def doubt(self) -> str:
        """Why the peak may be higher than what was measured; empty where it is not."""
        if self.caveat:
            return self.caveat
        size = np.abs(self.sensitivity)
        if len(size) > 1:
            unsure = AT_END * self.std[[0, -1]]
            level = np.average(np.log(size.clip(1e-9)), weights=np.gradient(self.frequency_hz))
            if level < LEVEL and size[-1] + unsure[1] < 1:
                return (
                    "on average it stays below 1, as no loop does (Bode): e and r are not in one "
                    "unit or gain, or are exchanged, or the band leaves the peak out"
                )
            as_high = size[[0, -1]] + unsure >= size.max()
            settled = np.abs(size[[0, -1]] - 1) <= unsure  # S is 1 where the loop has no gain
            if size.argmax() in (0, len(size) - 1) or (as_high & ~settled).any():
                return (
                    "it is largest at an end of the lines that tell and may rise beyond: widen the "
                    "band, or record longer with more excitation"
                )
        return ""

    @property
    def zone(self) -> str:
        """A, B, C or D; "A or B" where the interval lies across a limit, "A or worse" in doubt."""
        low, high = map(zone_of, self.interval)
        return f"{low} or worse" if self.doubt and low != "D" else _from_to(low, high, "or")

    @property
    def verdict(self) -> str:
        said, why = _verdict([self])
        return f"{said}: {why[1]}" if why else said


def settles_elsewhere(frequency: Floats, values: Complexes, std: Floats) -> str:
    """Tell why S comes to another value than 1, where no loop has gain; empty where it does not.

    Over the last third of the lines, by a parabola: the gain of a loop that is still there falls
    over a third by 40 percent and more, so that what stays is the unit or the gain of r.
    """
    count = max(len(values) // 3, 1)
    ends, last = frequency[-count:], values[-count:]
    if count < LEAST_SETTLED:
        return ""
    place = 2 * (ends - ends[0]) / (ends[-1] - ends[0]) - 1
    basis, _ = np.linalg.qr(place[:, None] ** np.arange(3))
    curve = basis @ (basis.T @ last)
    left = np.abs(last - curve) ** 2
    noise = max(float(left.sum()) / (count - 3), 2 * float((std[-count:] ** 2).mean()))
    taken = float((basis**2).sum(axis=1).max())
    middle = last.mean()
    change = 2 * float(np.abs(curve - middle).max()) + AT_END * np.sqrt(noise * taken)
    away = float(abs(middle - 1))
    if away < UNIT or change > FLAT * away:
        return ""
    return (
        f"it stays at {abs(middle):.2f} at the end of the band and not at 1: e and r are not in "
        "one unit or gain, or the loop still has gain there: check their columns, or widen the band"
    )


def zone_of(peak: float) -> str:
    return next((zone for zone, limit in LIMITS.items() if peak < limit), "D")


def worst_of(found: Sequence[AxisSensitivity]) -> str:
    """Return the zone of a machine, that of its worst axis, in words."""
    said, why = _verdict(found)
    return f"{said} ({why[0]}: {why[1]})" if why else said


def _verdict(found: Sequence[AxisSensitivity]) -> tuple[str, tuple[str, str] | None]:
    """Return the zone of the worst axis, and the first axis in doubt with its reason."""
    low, high = (zone_of(max(each.interval[k] for each in found)) for k in (0, 1))
    doubts = [(e.axis, e.caveat if low == "D" else e.doubt) for e in found]  # D may be but a unit
    why = next((doubt for doubt in doubts if doubt[1]), None)
    if why and low != "D":
        return f"zone {low} or worse", why
    said = _from_to(low, high, "and")
    return f"zone {said}" if low == high else f"undecided between {said}", why


def _from_to(low: str, high: str, word: str) -> str:
    zones = "ABCD"["ABCD".index(low) : "ABCD".index(high) + 1]
    return f" {word} ".join(filter(None, (", ".join(zones[:-1]), zones[-1])))


def sensitivity(
    records: PeriodicRecord | Record | Sequence[PeriodicRecord] | Sequence[Record],
    pairs: Mapping[str, str],
    *,
    band: tuple[float | str, float | str] | None = None,
    skip: float | str = 0.0,
) -> list[AxisSensitivity]:
    """Return the sensitivity of each loop as it was measured, its peak, and the zone of this.

    ``S = E / R`` with r added at the output of the controller and e measured behind the sum, both
    in one unit. r is taken as free of noise.

    Parameters
    ----------
    records : PeriodicRecord or Record, or sequence of them
        Whole periods (`rid.average`), of which lines that were excited on several axes at once take
        as many records; or whole records of any excitation, each by itself, with a `band`.
    pairs : mapping of str to str
        The channel of e, and that of r, of each axis.
    band : (float, float), optional
        Hz, or texts with units; of whole records.
    skip : float or str
        What is left out of whole records before, in s.

    Returns
    -------
    list of AxisSensitivity

    Raises
    ------
    InputError
        For channels that are not there, and axes that were not excited, or only with others.

    References
    ----------
    ISO 14839-3.

    Examples
    --------
    >>> import numpy as np, rotorid as rid
    >>> time = np.arange(2000) / 1000.0
    >>> waves = {f: np.cos(2 * np.pi * f * time) for f in (10, 20, 30, 40)}
    >>> r = sum(waves.values())
    >>> noise = 1e-3 * np.random.default_rng(1).standard_normal(2000)
    >>> samples = np.column_stack([r + waves[20] + noise, r])
    >>> record = rid.Record([rid.Channel("e"), rid.Channel("r")], samples, sample_rate=1000.0)
    >>> periods = rid.average(record, 10.0, harmonics=[1, 2, 3, 4])
    >>> (axis,) = rid.sensitivity(periods, {"e": "r"})
    >>> f"{axis.peak:.2f}", axis.verdict
    ('2.00', 'zone A')
    """
    data = records if isinstance(records, Sequence) else [records]
    if not pairs:
        raise InputError("no axes", "a channel of e and one of r", 'name them: {"i_x": "r_x"}')
    for record in data:
        require_type(record, Record, PeriodicRecord, place="records")
        names = [channel.name for channel in record.channels]
        require_names([*pairs, *pairs.values()], names, "no channel {}", file=record.source)
    if all(isinstance(record, PeriodicRecord) for record in data):
        raw = _of_periods([r for r in data if isinstance(r, PeriodicRecord)], pairs)
        named = zip(pairs, raw, strict=True)
        return [_single(_settled(_axis(name, *each))) for name, each in named]
    if band is None:
        raise InputError("a whole record without a band", "a band", "give it in Hz")
    ends = (quantity(band[0], "Hz", place="band"), quantity(band[1], "Hz", place="band"))
    first = quantity(skip, "s", place="skip")
    whole = _of_whole([r for r in data if isinstance(r, Record)], pairs, ends, first)
    return [_settled(_located(name, each)) for name, each in whole.items()]


def _settled(axis: AxisSensitivity) -> AxisSensitivity:
    if (np.abs(axis.sensitivity - 1) < SAME).all():
        expected = "e, the command behind the sum, and r, which was added to it"
        cure = "name another column for one of them; of an open loop there is no sensitivity"
        raise InputError(f"{axis.axis} and its reference the same", expected, cure, place="pair")
    if axis.caveat or axis.interval[1] < 1:
        return axis
    why = settles_elsewhere(axis.frequency_hz, axis.sensitivity, axis.std)
    return replace(axis, caveat=why)


def _single(axis: AxisSensitivity) -> AxisSensitivity:
    size = np.abs(axis.sensitivity)
    at = int(size.argmax())
    beside = np.delete(size, at)[max(at - 1, 0) : at + 1].max(initial=0.0)
    if axis.doubt or len(size) < 3 or beside > SINGLE * size[at]:
        return axis
    why = (
        f"it is that high on the line of {axis.frequency_hz[at]:.6g} Hz alone: the rotation, if "
        "its speed is missing, another disturbance, or a peak that takes lines closer together"
    )
    return replace(axis, caveat=why)


Raw = tuple[Floats, Complexes, Floats, Floats]
"""Frequency, S, variance of the complex number, and degrees of freedom, of each line."""


@frozen
class Windowed:
    """An axis of a whole record: its lines, and what windows tell of S that are independent."""

    lines: LoopLines
    middles: Floats  # of every window, also of those that do not tell S
    raw: Raw
    candidates: Sequence[tuple[float, float]]  # how high S may be, and where


def _not_excited(axis: str) -> InputError:
    expected = "each axis on lines of its own, or as many records as axes"
    cure = "excite one axis at a time, or repeat with other signs: + +, + -"
    return InputError(f"no line on which {axis} was excited by itself", expected, cure)


def _of_periods(records: Sequence[PeriodicRecord], pairs: Mapping[str, str]) -> list[Raw]:
    lines = grouped(
        (round(hertz, 9), (r, k)) for r in records for k, hertz in enumerate(r.frequency.tolist())
    )
    added = [r.spectra[..., [r.names.index(n) for n in pairs.values()]] for r in records]
    loud = np.max([np.abs(r.mean(axis=0)).max(axis=0) for r in added], axis=0)  # of each axis
    loud[loud == 0] = 1.0
    several = [r for r in added if len(r) > 1]
    every = [abs(r.mean(axis=0)) >= TOLD * r.std(axis=0) / np.sqrt(len(r)) for r in several]
    repeats = np.any([told.any(axis=0) for told in every], axis=0) if every else True
    found: list[list[tuple[float, complex, float, float]]] = [[] for _ in pairs]
    for hertz, places in sorted(lines.items()):
        if any(_rotates(record, hertz) for record, _ in places):
            continue
        count = min(record.periods for record, _ in places)  # periods that all have
        e, r = (
            np.array(
                [[r.spectra[:count, k, r.names.index(n)] for n in names] for r, k in places]
            ).swapaxes(1, 2)
            for names in (pairs, pairs.values())
        )
        excitation, noise = r.mean(axis=1) / loud, r.std(axis=1) / loud / np.sqrt(count)
        excitation[np.abs(excitation) < np.maximum(SILENT, TOLD * noise * repeats)] = 0.0
        inverse = np.linalg.pinv(excitation, rcond=ALONE)
        alone = np.abs(inverse @ excitation - np.eye(len(pairs))).max(axis=1) <= ALONE
        inverse = inverse / loud[:, None]
        for j in np.flatnonzero(alone).tolist():
            row = inverse @ e[:, :, j].mean(axis=1)  # of S: e_j = S_j r
            # What the other records say of the noise: e less what S makes of r, period by period.
            residual = e[:, :, j] - np.einsum("rpa,a->rp", r, row)
            found[j].append((hertz, complex(row[j]), *_noise(residual, inverse[j])))
    for name, each in zip(pairs, found, strict=True):
        if not each:
            raise _not_excited(name)
    return [_raw(each) for each in found]


def _rotates(record: PeriodicRecord, hertz: float) -> bool:
    """Tell whether a line holds what the rotation does by itself."""
    place = hertz / record.fundamental - record.turns * np.arange(1, ORDERS + 1)
    return bool(record.turns) and bool((np.abs(place) < 0.5).any())


def _noise(residual: Complexes, weights: Complexes) -> tuple[float, float]:
    variance, freedom = 0.0, 1.0
    for each, weight in zip(residual, weights, strict=True):
        if len(each) < 2:
            raise InputError(
                "one period", "two periods or more, which tell the noise", "record for longer"
            )
        spectra = (each - each.mean())[:, None, None]
        covariance = choose_covariance(spectra, spectra)
        variance += abs(weight) ** 2 * float(covariance.matrices[0, 0, 0].real)
        freedom = float(covariance.dof)
    return variance, freedom


def _located(name: str, whole: Windowed) -> AxisSensitivity:
    """Return S of a whole record with its peak: the highest of those near the highest windows."""
    found: list[Peak] = []
    tried = 0
    for _, hertz in sorted(whole.candidates, reverse=True):
        if _looked_at(hertz, found):
            continue
        peak = peak_near(whole.lines, hertz)
        if peak is None or (found and peak.unsure > RIVAL):
            break
        if not _looked_at(peak.hertz, found):
            found.append(peak)
        tried += 1
        if tried == CANDIDATES:
            break
    if not found:
        return replace(_axis(name, *whole.raw), caveat=UNTOLD)
    best = max(found, key=lambda each: each.size)
    low, high = np.max([each.interval(CONFIDENCE) for each in found], axis=0).tolist()
    frequency, values, variance, _ = whole.raw
    at = int(np.searchsorted(frequency, best.hertz))
    return AxisSensitivity(
        name,
        np.insert(frequency, at, best.hertz),
        np.insert(values, at, best.value),
        np.insert(np.sqrt(variance / 2), at, best.std),
        best.size,
        best.hertz,
        (low, high),
        "" if zone_of(low) == "D" or high < 1 else _untold(whole.middles, whole.raw),
    )


def _untold(windows: Floats, raw: Raw) -> str:
    """Tell where windows of the band do not tell S; beyond the last only where S is not 1 yet."""
    frequency, values, variance, _ = raw
    told = np.isin(windows, frequency)
    if abs(abs(values[-1]) - 1) <= AT_END * np.sqrt(variance[-1] / 2):
        told |= windows > frequency[-1]
    for known, run in groupby(zip(told, windows, strict=True), key=itemgetter(0)):
        untold = [hertz for _, hertz in run]
        if not known and len(untold) >= FEWEST:
            return (
                f"nothing tells it from {untold[0]:.3g} to {untold[-1]:.3g} Hz, where it may rise: "
                "excite there for longer, after some seconds of record without excitation"
            )
    return ""


def _looked_at(hertz: float, found: Sequence[Peak]) -> bool:
    return any(abs(hertz - each.hertz) < each.reach for each in found)


def _of_whole(
    records: Sequence[Record], pairs: Mapping[str, str], band: tuple[float, float], skip: float
) -> dict[str, Windowed]:
    """Return each axis from the record that tells most of its lines."""
    found: dict[str, list[Windowed]] = {name: [] for name in pairs}
    for record in records:
        groups = (list(pairs), list(pairs.values()))
        frequency, (e, r), rotation = whole_lines(record, band, groups, skip)
        for j, name in enumerate(pairs):
            found[name].append(_windows(LoopLines(frequency, e[:, j], r, rotation, j)))
    best = {name: max(each, key=lambda one: len(one.candidates)) for name, each in found.items()}
    for name, whole in best.items():
        if len(whole.candidates) < FEWEST:
            raise _not_excited(name)
    return best


def _windows(lines: LoopLines) -> Windowed:
    """Return windows of lines, so far apart that they are independent, and S in their middles."""
    frequency, columns = lines.frequency, lines.r.shape[1] + 1
    half = -(-((ORDER + 1) * columns + lines.rotation.shape[1] + LEAST - 1) // 2)
    if 2 * half + 1 > len(frequency):
        cure = "record for longer, or widen the band"
        raise InputError(f"{len(frequency)} lines in the band", f"{2 * half + 1} or more", cure)
    middles = frequency[half : len(frequency) - half : half]
    loud, chance = float(np.abs(lines.r).max()), RESONANT * half / len(frequency)
    rows, candidates = [], []
    for hertz in middles.tolist():
        part, first = lines.part(hertz, 2 * half + 1)
        found = _middle(part, loud, chance)
        if found is not None and np.sqrt(found[1]) < WEAK * abs(found[0]):
            value, variance, freedom, highest, where = found
            rows.append((hertz, value, variance, freedom))
            sure = highest * (1 - np.sqrt(variance) / abs(value))
            here = frequency[first : first + len(part.e)]
            candidates.append((sure, float(np.interp(where, part.place, here))))
    return Windowed(lines, middles, _raw(rows), candidates)


def _raw(rows: Sequence[tuple[float, complex, float, float]]) -> Raw:
    frequency, values, variance, freedom = np.array(rows, dtype=complex).reshape(-1, 4).T.copy()
    return frequency.real, values, variance.real, freedom.real


def _middle(
    part: LineWindow, loud: float, chance: float
) -> tuple[complex, float, float, float, float] | None:
    """Return S in the middle, its variance and degrees of freedom, its largest size, where."""
    at = part.own * (ORDER + 1)
    plain, spread, freedom = _linearized(part, 0, loud)
    if not np.isfinite(spread):
        return None
    bent, wide, left = _linearized(part, POLES, loud)
    noise = bent.loss / left
    if not np.isfinite(wide) or part.chance(plain.loss - bent.loss, POLES, noise, left) > chance:
        value = complex(plain.linear[at])
        return value, plain.loss / freedom * spread, freedom, abs(value), 0.0
    fine = np.linspace(-0.6, 0.6, 241)
    size = np.abs(bent.at(fine))
    most = min(float(size.max()), MOST * float(np.abs(part.e).max() / loud))
    return complex(bent.linear[at]), noise * wide, left, most, float(fine[size.argmax()])


def _linearized(part: LineWindow, poles: int, loud: float) -> tuple[RationalCurve, float, int]:
    """Return a curve by its error of equation, the variance of S over that of noise, freedom."""
    matrix = part.equation(ORDER, poles)
    basis, root, told = svd(matrix, loud)
    found = root @ (basis.conj().T @ part.e)
    loss = float((np.abs(part.e - matrix @ found) ** 2).sum())
    linear, below = np.split(found, [len(found) - poles])
    at = part.own * (ORDER + 1)
    spread = float((np.abs(root[at]) ** 2).sum()) if told[at] > 1 - 1e-12 else np.inf  # untold
    return RationalCurve(part, ORDER, below, linear, loss), spread, len(part.e) - basis.shape[1]


def _axis(
    axis: str, frequency: Floats, found: Complexes, variance: Floats, freedom: Floats
) -> AxisSensitivity:
    peak, where, deviation = peak_of(frequency, found, np.sqrt(variance))
    reach = float(scipy.stats.t.ppf((1 + CONFIDENCE) / 2, 2 * freedom.mean())) * deviation
    interval = (max(peak - reach, 0.0), peak + reach)
    return AxisSensitivity(axis, frequency, found, np.sqrt(variance / 2), peak, where, interval)
