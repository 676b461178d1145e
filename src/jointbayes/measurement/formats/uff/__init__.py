"""Universal files, dataset 58."""
