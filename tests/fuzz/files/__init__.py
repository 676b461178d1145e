"""Damage to measurement files that keeps enough of their structure to get far into the readers."""
