"""What every case gives, kept, so that a change says what it changed: `python -m tests.same`."""
