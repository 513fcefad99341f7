"""What tolerances may become: advice, allocation, worst case, reweighted what-if."""
