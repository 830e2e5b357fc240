"""Thousands of labelled forests from one plan, on one machine or many."""
