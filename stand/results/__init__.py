"""What the Python interface gives back: results that print themselves as tables.

A module per result, so that a job imports only what it makes.
"""
