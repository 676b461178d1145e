"""The tables of a case file, one module each."""
