"""Studies that make many posteriors: comparison, plan, campaigns, check against a reference."""
