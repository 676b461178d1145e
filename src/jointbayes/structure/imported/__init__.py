"""Finite-element models of other programs: read, reduced to what a joint and sensors see, and used as bodies."""
