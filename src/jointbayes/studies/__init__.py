"""Studies that make many posteriors: comparison, planning, campaigns, check against a reference."""
