"""Emulators: cheap predictions of what new runs would give, with their own error; calibration on them."""
