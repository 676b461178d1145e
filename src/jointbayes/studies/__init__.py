"""Studies that make many posteriors of one case: comparison, planning, check against a reference."""
