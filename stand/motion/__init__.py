"""Motion of the table as exact functions of time: planned moves, waves, sway, profiles."""
