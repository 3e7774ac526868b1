"""Names of columns: the words they are made of, their units, column maps, and the joints that they belong to."""
