"""Flight: act, sense, act."""
