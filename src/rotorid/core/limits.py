"""How much of a file is read: decided here, and held against a file before it is read.

Each bound lies far above what a laboratory writes and far below what hurts a laptop: a file that
passes all of them costs seconds and less than a gigabyte beyond the numbers that it really holds.
"""

from __future__ import annotations

TOML_BYTES = 1_000_000
"""Of a model, an experiment or a rig: people write them, a few kB at most."""

TOML_VALUES = 20_000
"""Keys and members of lists of a TOML file: a hundred records with twenty channels of their own
each; a wrong one takes 0.1 ms to be told."""

RESULT_BYTES = 32_000_000
"""Of a result file: one of a thousand lines has 1 MB, and reading takes 20 bytes for each."""

RESULT_VALUES, RESULT_OBJECTS = 1_500_000, 300_000
"""Commas and braces of a result file: a covariance of 500 unknowns beside 1e5 lines; each that is
wrong takes half a kilobyte before the first is told."""

DIGITS = 400
"""Of a number in TOML, or characters of a field of a table: a double ends at 309 digits, and
turning n digits into a number costs n^2."""

LINE_CHARACTERS = 1 << 20
"""Of a line of a text table: ten thousand columns of a hundred characters."""

SMALL_TEXT = 16_000_000
"""Bytes of a text table of which one line may be all: it takes a tenth of a second to refuse."""

COLUMNS = 10_000
"""Of a text table: loggers have hundreds of channels."""

NAMES, NAME_CHARACTERS = 500, 100
"""Names of a file, and characters of each, among which the nearest to a misspelt one is sought:
likeness takes the product of two lengths, 10 us for two of ten letters."""

UNIT_CHARACTERS = 64
"""Of a unit in the head of a column: ``kg m^2 s^-2`` has eleven."""

PREAMBLE_CHARACTERS = 500
"""Of a line above the numbers that is searched for the sample rate."""

RATES = (1e-9, 1e12)
"""Hz, of a sample rate that a file states: once in thirty years, and beyond any oscilloscope."""

COMPRESSION = 250
"""Bytes that one byte of a file may stand for: measured samples pack to a half, simulated ones
without noise to a hundredth; more is damage, or meant to fill the memory."""

UNPACKED_BYTES = 64_000_000
"""That any file may ask for, however small it is: a channel at rest packs without bound."""

FOOTER_BYTES = 16_000_000
"""What describes the columns of a Parquet file: ten thousand columns in ten groups of rows."""

CHUNK_BYTES = 256_000_000
"""Of a chunk of HDF5, which is unpacked whole: writers choose from 10 kB to 10 MB."""

NODES = 10_000
"""Groups and data sets of a file that are looked through for a name: each takes 0.1 ms. A data set
that is named by its whole path is found among any number."""

DEPTH = 64
"""Groups in groups, and structures in structures: loggers nest up to five."""

PARTS = 5_000
"""Files of a virtual data set, each of which is opened: one a second, for an hour."""

REFERENCES = 4
"""Files that refer to files: a virtual data set of virtual data sets is two."""

HASHED_BYTES = 16_000_000_000
"""Of a file whose sha256 is kept with a result: ten to twenty seconds. Of a larger one, or one of
holes for the most part, a fraction was read, and to hash the rest would take longer than to answer.
"""

MAGNITUDE = 1e60
"""Of samples in SI, and one over it: no machine comes near, and the fourth powers of a million
samples, which variances of variances are made of, stay within what doubles hold (1e308)."""

RIG_SAMPLES = 5_000_000
"""Of a record that a rig makes, with the settling before it: eight minutes at 10 kHz, a third of
a kilobyte each for the columns and the truth beside them."""
