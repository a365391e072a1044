"""The shortest test that reaches a required accuracy: `stand propose`."""
