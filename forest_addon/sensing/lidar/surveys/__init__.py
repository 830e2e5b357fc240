"""Legs of surveys as patterns of pulses."""
