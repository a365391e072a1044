"""The `stand` command: the only folder that talks to a person."""

from stand.cli.app import app, guarded, main

__all__ = ["app", "guarded", "main"]
