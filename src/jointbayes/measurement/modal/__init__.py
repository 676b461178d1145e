"""Modes fitted to measured FRFs."""
