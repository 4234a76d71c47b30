"""Where methods fail: maps of stability."""
