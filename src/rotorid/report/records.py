"""Pages of inspection and validation."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from markupsafe import Markup

from rotorid.answer.contents import RecordEvidence
from rotorid.answer.estimate import Estimate
from rotorid.answer.validation import ChannelError, verdict_of
from rotorid.core.tables import Page, by_hand, table
from rotorid.data.line_inspection import LineInspection
from rotorid.models import Model
from rotorid.report import drawn
from rotorid.report.estimate_report import METHODS, record_pictures, records_table
from rotorid.report.html import Passage, answer, render
from rotorid.report.record_tables import told_table, validation_table
from rotorid.signals.inspection import ChannelFacts, Inspection

_LEVELS = ("channel", "unit", "low", "high", "rms", "S/N dB", "least coherence", "crest")
_HEADINGS = (*_LEVELS, "odd %", "even %", "1x", "2x", "3x")


def inspection_page(found: Inspection | LineInspection) -> Page:
    graver = [check for check in found.checks if check.severity != "passes"]
    fine = [check.about for check in found.checks if check.severity == "passes"]
    return [
        f"{found.source}: {found.verdict}. {found.sentence}",
        _recorded(found) if isinstance(found, Inspection) else _tabled(found),
        *(f"{check.verdict}: {check}" for check in graver),
        f"in order: {', '.join(fine)}" if fine else "",
        *(_measured(found) if isinstance(found, Inspection) else _amplitudes(found)),
    ]


def _measured(found: Inspection) -> Page:
    return [told_table(_HEADINGS, [_row(facts) for facts in found.channels]), *_noise(found)]


def _tabled(found: LineInspection) -> str:
    lines, count = found.lines, len(found.lines.frequency)
    if not found.turning:
        low, high = lines.frequency.min(), lines.frequency.max()
        driven = lines.channels[0].name
        return f"{count} lines of responses to {driven}, from {low:.6g} to {high:.6g} Hz"
    rpm = lines.speed * 30 / np.pi
    return f"{count} rows of 1x phasors, from {rpm.min():.6g} to {rpm.max():.6g} rpm"


def _amplitudes(found: LineInspection) -> Page:
    unit = "rpm" if found.turning else "Hz"
    rows = [
        (
            f.name,
            by_hand(f.unit)[0],
            *(f"{by_hand(f.unit)[1] * level:.4g}" for level in (f.low, f.high)),
            f"{f.at:.6g}",
            _shown(f.snr_db, 1, ".1f"),
        )
        for f in found.channels
    ]
    headings = ("channel", "unit", "least", "largest", f"at {unit}", "S/N dB")
    return [table(headings, rows), *found.lines.warnings]


def _recorded(found: Inspection) -> str:
    record, periods = found.record, found.periods
    length = len(record.samples) / record.sample_rate
    told = [f"{len(record.samples)} samples at {record.sample_rate:.8g} Hz, {length:.6g} s"]
    if periods is None:
        told.append("no period")
    else:
        how = "found" if found.found else "given"
        told.append(
            f"{periods.periods} periods of {periods.samples} samples ({how}: "
            f"{1 / periods.fundamental:.6g} s, {periods.fundamental:.6g} Hz), "
            f"{len(periods.harmonics)} lines from {periods.frequency[0]:.5g} to "
            f"{periods.frequency[-1]:.5g} Hz"
        )
    turning = record.speed / (2 * np.pi) * 60
    told.append(f"speed {turning:.6g} rpm" if turning else "standstill, or no speed given")
    return "; ".join(told)


def _row(facts: ChannelFacts) -> tuple[str, ...]:
    unit, factor = by_hand(facts.unit)
    orders = [f"{factor * a:.3g}" for a in facts.orders] or ["", "", ""]
    return (
        facts.name,
        unit,
        *(f"{factor * level:.4g}" for level in (facts.low, facts.high, facts.rms)),
        _shown(facts.snr_db, 1, ".1f"),
        _shown(facts.coherence, 1, ".3f"),
        _shown(facts.crest_factor, 1, ".2f"),
        _shown(facts.odd, 100, ".2g"),
        _shown(facts.even, 100, ".2g"),
        *orders,
    )


def _shown(value: float | None, factor: float, form: str) -> str:
    return "" if value is None else format(factor * value, form)


def _noise(found: Inspection) -> list[str]:
    """Say which noises go together: in closed loop the controller makes it so."""
    if found.noise_correlation is None or len(found.channels) < 2:
        return []
    size = np.triu(found.noise_correlation, 1)
    i, j = np.unravel_index(int(np.argmax(size)), size.shape)
    names = [facts.name for facts in found.channels]
    return [
        f"noise of {names[i]} and {names[j]}: correlation {size[i, j]:.2f}"
        + (" (maximum likelihood uses it)" if size[i, j] > 0.3 else "")
    ]


def inspection_report(
    name: str, found: Sequence[Inspection | LineInspection], told: str, done: Sequence[str] = ()
) -> str:
    """Return the page: one part for each record."""
    parts = []
    for number, one in enumerate(found):
        title = f", record {number + 1}" if len(found) > 1 else ""
        shown = _pictures(one, title) if isinstance(one, Inspection) else _lines(one, title)
        parts.append((inspection_page(one), one, shown))
    return render("inspection.html", name=name, told=told, records=parts, done=done)


def _lines(one: LineInspection, title: str) -> list[Passage]:
    told = "Amplitude of each row, channel by channel, with the noise where something tells it."
    panels = tuple(drawn.rows(one.lines, turning=one.turning))
    return [Passage(f"Rows of the table{title}", told, panels=panels)]


def _pictures(one: Inspection, title: str) -> list[Passage]:
    periods = one.periods
    size = 1 if periods is None else periods.samples
    pictures = [
        Passage(
            f"Samples{title}",
            "The whole record, where it is long as a band from its lowest to its highest sample; a "
            "flat edge is a limit, a spike a knock, a slope a drift.",
            panels=tuple(drawn.samples(one.record, size)),
        )
    ]
    if periods is None:
        return pictures
    pictures += [
        Passage(
            f"Spectrum of the mean period{title}",
            "Multiples of the fundamental: those that are used, and the others, odd and even, with "
            "the noise of the mean. What stands above the noise and is not used is distortion, "
            "rotation, or excitation left out.",
            panels=tuple(drawn.spectra(periods)),
        ),
        Passage(
            f"From period to period{title}",
            "Deviation of each period from the mean of all, over its scatter. It falls at "
            "the start while the machine settles, stands out where something knocked, and "
            "bends like a bow where it drifts.",
            panels=(drawn.each_period(periods),),
        ),
    ]
    if one.noise_correlation is not None:
        names = [facts.name for facts in one.channels]
        pictures.append(
            Passage(
                f"Noise that goes together{title}",
                "Correlation between the noises of two channels on the lines that are used. In "
                "closed loop the controller feeds the noise of sensors into the forces.",
                panels=(drawn.noise_correlation(names, one.noise_correlation),),
            )
        )
    return pictures


BY = Markup('By a result of <code>{}</code>, {} <span class="status {}">{}</span>')
CHANCE = (
    "How far the prediction is off, and how much of that the noise of this record and the "
    "deviations of the result's values make; the chance that the two together make an error at "
    "least as large. Below one in a million it fails."
)


def validation_report(
    estimate: Estimate,
    model: Model,
    found: Sequence[Sequence[ChannelError]],
    records: Sequence[RecordEvidence],
    notes: Sequence[str] = (),
) -> str:
    reached = verdict_of(found)
    mood = "ok" if reached.verdict == "predicts" else "not_converged"
    method = METHODS.get(estimate.method, estimate.method)
    return answer(
        f"{estimate.model}, {estimate.method}: {reached.verdict}",
        f"{reached.sentence[:1].upper()}{reached.sentence[1:]}.",
        mood,
        [
            Passage("Channel by channel", CHANCE, validation_table(found)),
            *record_pictures(records, another=True),
            Passage("Records", table=records_table(records)),
        ],
        heading="Another record, predicted",
        lead=BY.format(estimate.model, method, mood, reached.verdict),
        urge="What to do next:",
        steps=reached.cures,
        model=model,
        done=notes,
    )
