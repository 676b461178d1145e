"""Measurement files: one way in and one way out, whatever the format."""

from jointbayes.measurement.formats.grid import cut_to_band as cut_to_band
from jointbayes.measurement.formats.grid import join_frfs as join_frfs
from jointbayes.measurement.formats.read import detect_format as detect_format
from jointbayes.measurement.formats.read import iter_records as iter_records
from jointbayes.measurement.formats.read import read_frf as read_frf
from jointbayes.measurement.formats.write import FORMATS as FORMATS
from jointbayes.measurement.formats.write import records_of_frf as records_of_frf
from jointbayes.measurement.formats.write import write_frf as write_frf
from jointbayes.measurement.formats.write import write_records as write_records
