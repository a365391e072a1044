"""The table: its class and limits, its errors, its joints and where they carry the unit."""
