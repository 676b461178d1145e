"""Studies that make many posteriors: comparison, planning, calibration, campaigns, check against a reference."""
