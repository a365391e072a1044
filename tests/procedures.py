"""Procedures that several tests share, and any data as the text of one."""

import json
import math

HALF_TURN = """
title = "Half a turn"
table = "mid-class"
[site]
latitude_deg = 48.5
[estimate]
methods = ["triad"]
[[step]]
kind = "dwell"
label = "first"
duration_s = 24
[[step]]
kind = "move"
label = "half a turn"
joints_deg = { outer = 180 }
[[step]]
kind = "dwell"
label = "second"
duration_s = 24
"""


def document(data: dict) -> str:
    """Data as a TOML document, nested tables inline."""
    return "".join(f"{json.dumps(k)} = {value(v)}\n" for k, v in data.items())


def value(item: object) -> str:
    """A value as TOML."""
    if isinstance(item, dict):
        return "{" + ", ".join(f"{json.dumps(k)} = {value(v)}" for k, v in item.items()) + "}"
    if isinstance(item, list):
        return "[" + ", ".join(map(value, item)) + "]"
    if isinstance(item, float) and not math.isfinite(item):
        return {math.inf: "inf", -math.inf: "-inf"}.get(item, "nan")
    return json.dumps(item, ensure_ascii=False)


def resting(seconds: float) -> str:
    """One rest, whose attitude `triad` tells."""
    return f"""
title = "Rest"
[site]
latitude_deg = 48.5
[estimate]
methods = ["triad"]
[[step]]
kind = "dwell"
label = "up"
duration_s = {seconds}
"""
