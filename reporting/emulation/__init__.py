"""Emulators: cheap predictions of what new runs would give, with their own error; calibration and what-ifs on them."""
