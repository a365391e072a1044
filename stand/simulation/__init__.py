"""A run as it goes: settings, plan, truth and readings, block by block, once or many times."""
