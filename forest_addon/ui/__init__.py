"""The panel and its operators."""
