"""Coordinates in which a density is nearer to Gaussian."""
