"""Rehearsal: whether a procedure can run, how long it takes, and how accurate it will be."""
