"""A vehicle: its path and the scenario of a drive."""
