"""A unit's calibration at the doors: its file, its units, and logs corrected by it."""
