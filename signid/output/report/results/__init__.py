"""One file for each kind of result: its JSON document and its tables."""
