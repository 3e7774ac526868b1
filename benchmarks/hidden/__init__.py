"""Physics concealed from the diagnosis, and the judge of what it says."""
