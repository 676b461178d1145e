"""Measurement files: one way in and one way out, whatever the format."""

from jointbayes.measurement.formats.grid import cut_to_band, excluded_lines, join_frfs, measured_lines
from jointbayes.measurement.formats.read import detect_format, iter_records, read_frf
from jointbayes.measurement.formats.write import FORMATS, records_of_frf, write_frf, write_records

__all__ = [
    "FORMATS",
    "detect_format",
    "excluded_lines",
    "cut_to_band",
    "iter_records",
    "join_frfs",
    "measured_lines",
    "read_frf",
    "records_of_frf",
    "write_frf",
    "write_records",
]
