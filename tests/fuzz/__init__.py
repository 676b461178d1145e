"""Damaged input for every part of the package that reads files: it must be refused in one line, or taken."""
