"""What came out: estimates against truth, methods side by side, noise against data sheets."""
