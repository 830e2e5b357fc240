"""Biosonar: what a bat-like sonar hears of leaves, wood and ground."""
