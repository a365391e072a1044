"""Campaigns: thousands of runs over any parameter, kept as they come, and what they say."""
