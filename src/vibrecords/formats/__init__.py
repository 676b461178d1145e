"""Measurement files: one way in and one way out, for any format."""

from vibrecords.formats.grid import cut_to_band as cut_to_band
from vibrecords.formats.grid import join_frfs as join_frfs
from vibrecords.formats.read import detect_format as detect_format
from vibrecords.formats.read import iter_records as iter_records
from vibrecords.formats.read import read_frf as read_frf
from vibrecords.formats.write import records_of_frf as records_of_frf
from vibrecords.formats.write import write_frf as write_frf
from vibrecords.formats.write import write_records as write_records
