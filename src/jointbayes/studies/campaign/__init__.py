"""Campaigns: many cases, one file each, and what they say together."""
