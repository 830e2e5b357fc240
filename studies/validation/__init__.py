"""Simulations held to measurements: ``python -m studies validate``, a module a subject.

Each subject's module has ``TITLE``, perhaps ``SUMMARY`` and ``TERMS`` (what a page says of it before and
after its table), and ``validate(data, out, arguments) -> list[Comparison]``; ``run`` prints, draws and keeps
what they return.
"""
