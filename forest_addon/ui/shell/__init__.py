"""Shell: drawing, lists, running, words and help that all panels share."""
