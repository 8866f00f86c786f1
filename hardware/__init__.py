"""The bench: bytes to Measurements."""
