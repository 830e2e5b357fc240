"""Ears with directions: ambisonics and heads, and what is heard where source or receiver move."""
