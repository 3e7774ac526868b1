"""Results -> files and pages: reports, the replay in a browser, exports to other programs."""
