"""Output of results: reports, replay in a browser, export to other programs."""
