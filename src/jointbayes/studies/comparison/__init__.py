"""Comparison of cases by evidence."""
