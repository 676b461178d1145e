"""Distributions to propose from, fitted to a density."""
