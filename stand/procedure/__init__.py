"""A procedure as data: its steps, site, what to estimate, what is required."""
