"""Measurements of speed and calibration; run by `make bench` and `make science`."""
