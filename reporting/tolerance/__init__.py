"""Choice of tolerances: advice, allocation, worst case, reweighted what-if."""
