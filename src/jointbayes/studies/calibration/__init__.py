"""Is the analysis of a case calibrated? Truths from its priors, data from its likelihood, ranks of the truths."""
