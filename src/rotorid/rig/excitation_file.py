"""Multisines as tables that a controller can play: CSV, HDF5, WAV."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from scipy.io import wavfile

from rotorid.errors import InputError
from rotorid.rig.export import write_columns
from rotorid.rig.logger import Column
from rotorid.signals.multisine import Multisine


def write_excitation(
    signals: Multisine, path: str | Path, sample_rate: float, *, full_scale: float | None = None
) -> None:
    """Write one period of a multisine, to be played over and over."""
    path = Path(path)
    samples = signals.samples(sample_rate)
    match path.suffix.lower():
        case ".csv":
            _write_csv(signals, samples, path, sample_rate)
        case ".h5" | ".hdf5":
            time = np.arange(len(samples)) / sample_rate
            columns = [Column("t", "s", time)]
            for name, column in zip(signals.names, samples.T, strict=True):
                columns.append(Column(name, signals.unit, column))
            write_columns(path, columns)
        case ".wav":
            _write_wav(samples, path, sample_rate, full_scale)
        case ending:
            raise InputError(
                f"the ending {ending!r}", ".csv, .h5, .hdf5 or .wav", "name it so", file=str(path)
            )


def _write_csv(signals: Multisine, samples: np.ndarray, path: Path, sample_rate: float) -> None:
    time = np.arange(len(samples)) / sample_rate
    heading = ",".join(["t [s]", *(f"{name} [{signals.unit}]" for name in signals.names)])
    rows = "\n".join(",".join(map(repr, row)) for row in np.column_stack([time, samples]).tolist())
    path.write_text(f"{heading}\n{rows}\n", encoding="utf-8")


def _write_wav(
    samples: np.ndarray, path: Path, sample_rate: float, full_scale: float | None
) -> None:
    peak = float(np.abs(samples).max())
    if full_scale is None or not full_scale > 0:
        raise InputError(
            f"a full scale of {full_scale}",
            "what 1 stands for in the WAV file",
            f"give full_scale; the peak is {peak:.6g}",
            file=str(path),
        )
    if peak > full_scale:
        raise InputError(
            f"a peak of {peak:.6g}",
            f"at most the full scale of {full_scale:.6g}",
            "raise full_scale, or lower the crest factor",
            file=str(path),
        )
    if sample_rate != int(sample_rate):
        raise InputError(
            f"{sample_rate} Hz", "a whole number of Hz in a WAV file", "use CSV", file=str(path)
        )
    wavfile.write(path, int(sample_rate), (samples / full_scale).astype(np.float32))
