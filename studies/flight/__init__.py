"""Flights and experiments with them."""
